// Expressions that choose points: the language of `fiv query` (studies/query/language.py and evaluate.py), which the
// shared list tests/studies/query/expressions.json holds this to. What is missing is null; a number then is NaN.

const LONGEST = 4000, DEEPEST = 40, MOST_POWER = 100;
const TOKENS = new RegExp([
  "[ \\t\\r\\n]+",
  "(?<number>(?:[0-9]+\\.?[0-9]*|\\.[0-9]+)(?:[eE][+-]?[0-9]+)?(?![\\p{L}\\p{N}_.]))",
  "(?<text>'[^'\\r\\n]*'|\"[^\"\\r\\n]*\")",
  "(?<name>[\\p{L}\\p{Nl}_][\\p{L}\\p{N}\\p{M}_]*)",
  "(?<sign>\\*\\*|==|!=|<=|>=|[-+*/()<>,])",
].join("|"), "uy");
// Words of Python that name nothing.
const RESERVED = new Set(("False None True and as assert async await break class continue def del elif else except " +
  "finally for from global if import in is lambda nonlocal not or pass raise return try while with yield").split(" "));
const COMPARISONS = {
  "==": (a, b) => a === b, "!=": (a, b) => a !== b,
  "<": (a, b) => a < b, "<=": (a, b) => a <= b, ">": (a, b) => a > b, ">=": (a, b) => a >= b,
};
const ARITHMETIC = {
  "+": (a, b) => a + b, "-": (a, b) => a - b, "*": (a, b) => a * b, "/": (a, b) => a / b,
};

// Reads an expression, by recursive descent, into terms {kind, text, of, column, constant, parts}: `of` gives the value
// for a row, a term of one column has that, one that is the same for all rows a constant, and a list its parts.
class Reader {
  constructor(points, text) {
    if (text.length > LONGEST) throw new Error(`it has ${text.length} letters; it may have ${LONGEST}`);
    Object.assign(this, { points, text, place: 0, brackets: 0, levels: 0, notes: [], used: new Set() });
    this.tokens = [...this.cut()];
  }

  *cut() {
    TOKENS.lastIndex = 0;
    while (TOKENS.lastIndex < this.text.length) {
      const start = TOKENS.lastIndex;
      const match = TOKENS.exec(this.text);
      if (!match) this.refuse({ text: String.fromCodePoint(this.text.codePointAt(start)), start });
      const [kind, text] = Object.entries(match.groups).find(([, each]) => each !== undefined) || [];
      if (kind) yield { kind, text, start, end: TOKENS.lastIndex };
    }
    yield { kind: "end", text: "", start: this.text.length, end: this.text.length };
  }

  refuse(token) {
    const what = token.text ? `unexpected '${token.text}'` : "unexpected end";
    throw new Error(`${what} at column ${token.start + 1}${token.text === "=" ? "; to compare is ==" : ""}`);
  }

  get now() { return this.tokens[this.place]; }

  is(...texts) { return (this.now.kind === "sign" || this.now.kind === "name") && texts.includes(this.now.text); }

  take() { return this.tokens[this.place++]; }

  textFrom(begin) { return this.text.slice(this.tokens[begin].start, this.tokens[this.place - 1].end); }

  term(begin, kind, of, more) { return { kind, text: this.textFrom(begin), of, ...more }; }

  // What is calculated; a constant where all that it is made of is constant.
  number(begin, of, terms) {
    const other = terms.find((term) => term.kind !== "number");
    if (other) throw new Error(`${other.text}: only numbers can be calculated with`);
    return this.term(begin, "number", of, terms.every((term) => term.constant !== undefined) ? { constant: of() } : {});
  }

  truth(term, why) {
    if (term.kind !== "truth") throw new Error(`${term.text}: ${why}`);
    return term;
  }

  whole() {
    const term = this.logic("or");
    if (this.now.kind !== "end") this.refuse(this.now);
    return this.truth(term, `compare it, like ${term.text} == 0`);
  }

  deeper(counter, part) {
    this[counter] += 1;
    if (this[counter] > DEEPEST) throw new Error(`more than ${DEEPEST} levels are within each other`);
    const term = part();
    this[counter] -= 1;
    return term;
  }

  logic(word) {
    const part = () => (word === "or" ? this.logic("and") : this.negation());
    const begin = this.place, parts = [part()];
    while (this.is(word)) { this.take(); parts.push(part()); }
    if (parts.length === 1) return parts[0];
    for (const each of parts) this.truth(each, `${word} is for what is true or false`);
    const all = word === "and" ? "every" : "some";
    return this.term(begin, "truth", (row) => parts[all]((each) => each.of(row)));
  }

  negation() {
    const begin = this.place;
    if (!this.is("not")) return this.comparison();
    this.take();
    const part = this.truth(this.deeper("levels", () => this.negation()), "not is for what is true or false");
    return this.term(begin, "truth", (row) => !part.of(row));
  }

  comparison() {
    const begin = this.place, pairs = [];
    let left = this.chain(["+", "-"]), listed = false;
    for (let sign = this.comparing(); sign; sign = this.comparing()) {
      const right = this.chain(["+", "-"]);
      if (listed) throw new Error(`${this.textFrom(begin)}: nothing is compared with a list; join comparisons by and`);
      listed = sign.endsWith("in");
      pairs.push(listed ? this.member(left, sign === "in", right) : this.compared(left, sign, right));
      left = right;
    }
    return pairs.length ? this.term(begin, "truth", (row) => pairs.every((pair) => pair(row))) : left;
  }

  comparing() {
    if (this.is("in", ...Object.keys(COMPARISONS))) return this.take().text;
    const next = this.tokens[this.place + 1];
    if (!this.is("not") || next.kind !== "name" || next.text !== "in") return "";
    this.place += 2;
    return "not in";
  }

  chain(signs) {
    const part = () => (signs[0] === "+" ? this.chain(["*", "/"]) : this.signed());
    const begin = this.place, start = part(), steps = [];
    while (this.is(...signs)) steps.push([ARITHMETIC[this.take().text], part()]);
    if (!steps.length) return start;
    const of = (row) => steps.reduce((result, [calculate, right]) => calculate(result, right.of(row)), start.of(row));
    return this.number(begin, of, [start, ...steps.map(([, right]) => right)]);
  }

  signed() {
    const begin = this.place;
    if (!this.is("+", "-")) return this.power();
    const sign = this.take().text === "-" ? -1 : 1, part = this.deeper("levels", () => this.signed());
    return this.number(begin, (row) => sign * part.of(row), [part]);
  }

  power() {
    const begin = this.place, left = this.atom();
    if (!this.is("**")) return left;
    this.take();
    const right = this.deeper("levels", () => this.signed());
    if (!(Math.abs(right.constant) <= MOST_POWER)) {
      throw new Error(`the power ${right.text} must be a number from -${MOST_POWER} to ${MOST_POWER}`);
    }
    return this.number(begin, (row) => left.of(row) ** right.of(row), [left, right]);
  }

  atom() {
    const begin = this.place, token = this.take(), { kind, text } = token;
    if (kind === "sign" && text === "(") return this.deeper("brackets", () => this.bracket(begin));
    // As in Python no whole number begins with 0, and letters of other widths name nothing.
    if (kind === "number" && !/^0+[1-9][0-9]*$/.test(text)) return this.number(begin, () => Number(text), []);
    if (kind === "text") return this.term(begin, "text", () => text.slice(1, -1), { constant: text.slice(1, -1) });
    if (kind !== "name" || RESERVED.has(text) || text.normalize("NFKC") !== text) return this.refuse(token);
    return text === "nan" ? this.term(begin, "missing", () => NaN) : this.named(begin, text);
  }

  // What is in brackets; with a comma it is a list.
  bracket(begin) {
    const parts = [];
    let listed = false;
    while (!this.is(")")) {
      parts.push(this.logic("or"));
      if (!this.is(",")) break;
      this.take();
      listed = true;
    }
    if (!this.is(")") || parts.length === 0) this.refuse(this.now);
    this.take();
    return listed ? this.term(begin, "list", null, { parts }) : parts[0];
  }

  named(begin, name) {
    const { place, columns, settings } = this.points, number = (value) => (value === null ? NaN : Number(value));
    if (place.has(name)) {
      this.used.add(name);
      const column = columns[place.get(name)], value = (row) => this.points.named(row, name);
      return this.term(begin, column.kind, column.kind === "number" ? (row) => number(value(row)) : value, { column });
    }
    if (!Object.hasOwn(settings, name)) {
      throw new Error(`no such column: ${name}; there are ${[...place.keys(), ...Object.keys(settings)].join(", ")}`);
    }
    const value = settings[name], text = typeof value === "string";
    return this.term(begin, text ? "text" : "number", () => (text ? value : number(value)));
  }

  member(left, inside, list) {
    if (list.kind !== "list") {
      throw new Error("after in comes a list in brackets, like (0.1, 0.2); one of a single value has a comma too: (0.1,)");
    }
    const each = list.parts.map((part) => this.compared(left, inside ? "==" : "!=", part));
    return (row) => each[inside ? "some" : "every"]((pair) => pair(row));
  }

  compared(left, sign, right) {
    const text = `${left.text} ${sign} ${right.text}`;
    const kinds = [left.kind, right.kind], equality = sign === "==" || sign === "!=";
    const [one, other] = left.column ? [left, right] : [right, left];
    if (kinds.includes("list")) throw new Error(`${text}: a list has its place after in, like mu in (0.1, 0.2)`);
    if (kinds.includes("truth")) throw new Error(`${text}: what is true or false is joined by and, or`);
    const numbers = kinds.every((kind) => kind === "number");
    if (!equality && !numbers) throw new Error(`${text}: only numbers are above or below each other`);
    if (kinds.includes("missing")) {
      const term = right.kind === "missing" ? left : right;
      if (term.kind === "text" || term.kind === "missing") throw new Error(`${text}: of texts the missing one is ''`);
      return (row) => isMissing(term.of(row)) === (sign === "==");
    }
    if (!numbers && kinds.includes("number")) throw new Error(`${text}: a number is no ${one.kind === "words" ? "word" : "text"}`);
    if (numbers && equality && one.column && one.column.axis && other.constant !== undefined) {
      return this.at(one, sign, other.constant, text);
    }
    let [first, second] = [left.of, right.of];
    const known = one.column && one.column.words;
    if (known && other.constant !== undefined) {
      const word = known.find((each) => spaced(each) === spaced(other.constant));
      if (word === undefined) throw new Error(`${one.text} is never ${other.text}; its words are ${known.join(", ")}`);
      [first, second] = [one.of, () => word];
    }
    return (row) => {
      const [a, b] = [first(row), second(row)];
      return !isMissing(a) && !isMissing(b) && COMPARISONS[sign](a, b);
    };
  }

  // Where an axis has the value nearest to a number, if that is near enough: the rule of studies/query/nearest.py.
  at(one, sign, number, text) {
    const values = [...new Set(one.column.values)].sort((a, b) => a - b);
    const away = values.map((value) => Math.abs(value - number));
    const place = away.reduce((best, each, k) => (each < away[best] ? k : best), 0);
    const gaps = [place - 1, place].filter((k) => k >= 0 && k + 1 < values.length).map((k) => values[k + 1] - values[k]);
    const allowed = gaps.length ? 1e-3 * Math.min(...gaps) : 1e-6 * Math.abs(values[place]);
    if (away[place] <= allowed) return (row) => COMPARISONS[sign](one.of(row), values[place]);
    if (sign === "==") this.notes.push(`${text}: ${one.text} has no such value; the nearest is ${shown(values[place])}`);
    return () => sign === "!=";
  }
}

function isMissing(value) { return value === null || Number.isNaN(value); }

// Words as they are shown.
function spaced(word) { return word.replaceAll("_", " "); }

// Which rows an expression chooses, what a reader should know of it, and which columns it names; an Error, of one line,
// where it is none.
function filter(points, text) {
  const reader = new Reader(points, text);
  return { test: reader.whole().of, notes: reader.notes, used: reader.used };
}
