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
  "+": (a, b) => a + b, "-": (a, b) => a - b, "*": (a, b) => a * b, "/": (a, b) => a / b, "**": (a, b) => a ** b,
};
const KINDS = { number: "a number", text: "a text", words: "a word", truth: "true or false", missing: "nan", list: "a list" };

// A tree of {type, text, ...}, by recursive descent: or, and, not, comparison, sum, product, sign, power, atom.
class Parser {
  constructor(text) {
    if (text.length > LONGEST) throw new Error(`it has ${text.length} letters; it may have ${LONGEST}`);
    this.text = text;
    this.tokens = [...this.cut()];
    this.place = 0;
    this.brackets = 0;
    this.levels = 0;
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
    const what = token.text ? `${token.text} at letter ${token.start + 1} cannot stand there` : "something is missing at its end";
    throw new Error(what + (token.text === "=" ? "; to compare is ==" : ""));
  }

  get now() { return this.tokens[this.place]; }

  is(...texts) { return (this.now.kind === "sign" || this.now.kind === "name") && texts.includes(this.now.text); }

  take() { return this.tokens[this.place++]; }

  node(type, begin, rest) {
    return { type, text: this.text.slice(this.tokens[begin].start, this.tokens[this.place - 1].end), ...rest };
  }

  whole() {
    const tree = this.logic("or");
    if (this.now.kind !== "end") this.refuse(this.now);
    return tree;
  }

  deeper(counter, part) {
    this[counter] += 1;
    if (this[counter] > DEEPEST) throw new Error(`more than ${DEEPEST} levels are within each other`);
    const node = part();
    this[counter] -= 1;
    return node;
  }

  logic(word) {
    const part = () => (word === "or" ? this.logic("and") : this.negation());
    const begin = this.place, parts = [part()];
    while (this.is(word)) { this.take(); parts.push(part()); }
    return parts.length === 1 ? parts[0] : this.node("logic", begin, { word, parts });
  }

  negation() {
    const begin = this.place;
    if (!this.is("not")) return this.comparison();
    this.take();
    const part = this.deeper("levels", () => this.negation());
    return this.node("not", begin, { part });
  }

  comparison() {
    const begin = this.place, parts = [this.chain(["+", "-"])], signs = [];
    for (let sign = this.comparing(); sign; sign = this.comparing()) {
      signs.push(sign);
      parts.push(this.chain(["+", "-"]));
    }
    return signs.length ? this.node("comparison", begin, { parts, signs }) : parts[0];
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
    const begin = this.place;
    let node = part();
    while (this.is(...signs)) {
      const sign = this.take().text;
      const right = part();
      node = this.node("arithmetic", begin, { sign, left: node, right });
    }
    return node;
  }

  signed() {
    const begin = this.place;
    if (!this.is("+", "-")) return this.power();
    const sign = this.take().text;
    const part = this.deeper("levels", () => this.signed());
    return this.node("sign", begin, { sign, part });
  }

  power() {
    const begin = this.place, left = this.atom();
    if (!this.is("**")) return left;
    this.take();
    const right = this.deeper("levels", () => this.signed());
    return this.node("arithmetic", begin, { sign: "**", left, right });
  }

  atom() {
    const begin = this.place, token = this.take();
    if (token.kind === "sign" && token.text === "(") return this.deeper("brackets", () => this.bracket(begin));
    const { kind, text } = token;
    // As in Python no whole number begins with 0, and letters of other widths name nothing.
    if (kind === "number" && !/^0+[1-9][0-9]*$/.test(text)) return this.node("number", begin, { value: Number(text) });
    if (kind === "text") return this.node("text", begin, { value: text.slice(1, -1) });
    if (kind === "name" && !RESERVED.has(text) && text.normalize("NFKC") === text) {
      return this.node(text === "nan" ? "missing" : "name", begin);
    }
    return this.refuse(token);
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
    return listed ? this.node("list", begin, { parts }) : parts[0];
  }
}

// Gives each node its kind and what it is for a row: {kind, text, of, column, constant}.
class Meaning {
  constructor(points) {
    this.points = points;
    this.notes = [];
  }

  of(node) {
    const { type, text } = node;
    if (type === "number") return constant(node.value, text);
    if (type === "text") return { kind: "text", text, of: () => node.value, constant: node.value };
    if (type === "missing") return { kind: "missing", text, of: () => NaN };
    if (type === "name") return this.named(text);
    if (type === "list") throw new Error(`${text}: a list has its place after in, like mu in (0.1, 0.2)`);
    if (type === "sign") {
      const part = this.number(node.part);
      return numeric(text, (row) => (node.sign === "-" ? -part.of(row) : part.of(row)), [part]);
    }
    if (type === "arithmetic") return this.arithmetic(node);
    if (type === "not") {
      const part = this.truth(node.part, "not");
      return { kind: "truth", text, of: (row) => !part.of(row) };
    }
    if (type === "logic") {
      const parts = node.parts.map((part) => this.truth(part, node.word));
      const of = node.word === "and" ? (row) => parts.every((part) => part.of(row)) : (row) => parts.some((part) => part.of(row));
      return { kind: "truth", text, of };
    }
    return this.comparison(node);
  }

  named(text) {
    const { points } = this;
    if (points.place.has(text)) {
      const place = points.place.get(text), column = points.columns[place];
      const number = (value) => (value === null ? NaN : Number(value));
      const value = (row) => points.value(row, place);
      return { kind: column.kind, text, of: column.kind === "number" ? (row) => number(value(row)) : value, column };
    }
    if (Object.hasOwn(points.settings, text)) {
      const value = points.settings[text];
      if (typeof value === "string") return { kind: "text", text, of: () => value };
      const number = value === null ? NaN : Number(value);
      return { kind: "number", text, of: () => number };
    }
    const known = [...points.place.keys(), ...Object.keys(points.settings)];
    throw new Error(`there is no column ${text}; there are ${known.join(", ")}`);
  }

  truth(node, word) {
    const term = this.of(node);
    if (term.kind !== "truth") throw new Error(`${term.text} is ${KINDS[term.kind]}; ${word} is for what is true or false`);
    return term;
  }

  number(node) {
    const term = this.of(node);
    if (term.kind !== "number") throw new Error(`${term.text} is ${KINDS[term.kind]}; only numbers can be calculated with`);
    return term;
  }

  arithmetic(node) {
    // A long sum leans to the left, node within node; it is read without recursion.
    const steps = [];
    let first = node;
    for (; first.type === "arithmetic"; first = first.left) {
      const right = this.number(first.right);
      if (first.sign === "**" && !(Math.abs(right.constant) <= MOST_POWER)) {
        throw new Error(`the power ${right.text} must be a number from -${MOST_POWER} to ${MOST_POWER}`);
      }
      steps.unshift([ARITHMETIC[first.sign], right]);
    }
    const start = this.number(first);
    const of = (row) => steps.reduce((result, [calculate, right]) => calculate(result, right.of(row)), start.of(row));
    return numeric(node.text, of, [start, ...steps.map(([, right]) => right)]);
  }

  comparison(node) {
    let left = this.of(node.parts[0]);
    const pairs = node.signs.map((sign, k) => {
      const right = node.parts[k + 1];
      if (!sign.endsWith("in")) {
        const term = this.of(right), before = left;
        left = term;
        return this.compared(before, sign, term);
      }
      if (right.type !== "list") {
        throw new Error(`${node.text}: after in comes a list in brackets, like (0.1, 0.2); one of a single value has a comma too: (0.1,)`);
      }
      if (k + 1 < node.signs.length) throw new Error(`${node.text}: nothing is compared with a list; join comparisons by and`);
      const equal = right.parts.map((part) => this.compared(left, sign === "in" ? "==" : "!=", this.of(part)));
      return sign === "in" ? (row) => equal.some((each) => each(row)) : (row) => equal.every((each) => each(row));
    });
    return { kind: "truth", text: node.text, of: (row) => pairs.every((pair) => pair(row)) };
  }

  compared(left, sign, right) {
    const text = `${left.text} ${sign} ${right.text}`;
    const kinds = [left.kind, right.kind], equality = sign === "==" || sign === "!=";
    const [one, other] = left.column ? [left, right] : [right, left];
    if (kinds.includes("truth")) throw new Error(`${text}: what is true or false is joined by and, or`);
    const numbers = kinds.every((kind) => kind === "number");
    if (!equality && !numbers) throw new Error(`${text}: only numbers are above or below each other`);
    if (kinds.includes("missing")) {
      const term = right.kind === "missing" ? left : right;
      if (term.kind === "text" || term.kind === "missing") throw new Error(`${text}: of texts the missing one is ''`);
      return (row) => isMissing(term.of(row)) === (sign === "==");
    }
    if (numbers) {
      if (equality && one.column && one.column.axis && typeof other.constant === "number") return this.at(one, sign, other.constant, text);
      return (row) => {
        const [a, b] = [left.of(row), right.of(row)];
        return COMPARISONS[sign](a, b) && !Number.isNaN(a) && !Number.isNaN(b);
      };
    }
    if (kinds.includes("number")) throw new Error(`${text}: a number is no ${one.kind === "words" ? "word" : "text"}`);
    const known = one.column && one.column.words;
    if (known && typeof other.constant === "string" && !known.some((word) => spaced(word) === spaced(other.constant))) {
      throw new Error(`${one.text} is never ${other.text}; its words are ${known.join(", ")}`);
    }
    const plain = (term, row) => (known && term.constant !== undefined ? spaced(term.constant) : term.of(row));
    return (row) => {
      const [a, b] = [plain(left, row), plain(right, row)];
      return a !== null && b !== null && COMPARISONS[sign](a, b);
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

function constant(value, text) { return { kind: "number", text, of: () => value, constant: value }; }

function numeric(text, of, terms) {
  return terms.every((term) => typeof term.constant === "number") ? constant(of(), text) : { kind: "number", text, of };
}

function isMissing(value) { return value === null || Number.isNaN(value); }

// Words as they are shown.
function spaced(word) { return word.replaceAll("_", " "); }

// Which rows an expression chooses, and what a reader should know of it; an Error, of one line, where it is none.
function filter(points, text) {
  const meaning = new Meaning(points);
  const term = meaning.of(new Parser(text).whole());
  if (term.kind !== "truth") throw new Error(`${term.text} is ${KINDS[term.kind]}; compare it, like ${term.text} == 0`);
  return { test: term.of, notes: meaning.notes };
}
