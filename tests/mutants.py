"""Small faults put into the sources one at a time: which of them do the quick tests notice?

`python -m tests.mutants` tries the faults of `mutants.json` in a copy of the tree and writes what became of each:
the first test that fails, "timeout", or "" if none does or it was never tried; "equivalent" and why is written by
hand. Each room has its sources and the tests that belong to them, quick ones first.
"""

import argparse
import ast
import copy
import importlib
import json
import os
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from hashlib import sha256
from pathlib import Path

ROOT, RECORD, LIMIT, MEMORY = Path(__file__).parent.parent, Path(__file__).with_suffix(".json"), 400.0, 8 << 30
SWAPS = ["Lt LtE", "Gt GtE", "Eq NotEq", "In NotIn", "Is IsNot", "And Or", "Add Sub", "Mult Div", "BitAnd BitOr"]
SWAPS += ["min max", "minimum maximum", "any all", "floor ceil", "argmin argmax", "sin cos"]
OTHER = {a: b for pair in SWAPS for a, b in (pair.split(), pair.split()[::-1])}
OTHER |= {"Pow": "Mult", "FloorDiv": "Mult", "Mod": "Add"}
LIBRARIES = ("hypothesis", "numba", "pandas", "pytest", "scipy.sparse.linalg", "xarray")
COMPILES = re.compile("fivcore.jit import .*(kernel|called|inlined|contracted|reordered)")
OPTIONS = ["-x", "-q", "-n", "0", "--tb=line", "-p", "no:cacheprovider", "-m", "not slow"]


def variants(node):
    """What a node can become."""

    def changed(**fields):
        twin = copy.copy(node)
        vars(twin).update(fields)
        return twin

    def swapped(op):
        return getattr(ast, OTHER[type(op).__name__])()

    match node:
        case ast.Compare(ops=[op]):
            yield changed(ops=[swapped(op)])
        case ast.BinOp(op=op) | ast.BoolOp(op=op) if type(op).__name__ in OTHER:
            yield changed(op=swapped(op))
        case ast.UnaryOp(op=ast.Not() | ast.USub()):
            yield node.operand
        case ast.Constant(value=bool()):
            yield changed(value=not node.value)
        case ast.Constant(value=int()):
            yield from (changed(value=node.value + 1), changed(value=node.value - 1))
        case ast.Constant(value=float()):
            yield changed(value=2.0 * node.value or 1.0)
        case ast.Name(id=name) if name in OTHER:
            yield changed(id=OTHER[name])
        case ast.Attribute(attr=name) if name in OTHER:
            yield changed(attr=OTHER[name])
        case ast.Assign(targets=[ast.Attribute() | ast.Subscript()]) | ast.Expr(value=ast.Call()):
            yield ast.Pass()
        case ast.AugAssign() | ast.Raise() | ast.Continue() | ast.Break():
            yield ast.Pass()


def faults(path):
    """Faults of a file by name: path, function, what becomes what, how many such before; and the text of each."""
    text, found = (ROOT / path).read_bytes(), {}
    starts = [0, *(end.end() for end in re.finditer(b"\n", text))]

    def visit(node, owner):
        for twin in variants(node):
            start = starts[node.lineno - 1] + node.col_offset
            end = starts[node.end_lineno - 1] + node.end_col_offset
            old, new = " ".join(text[start:end].decode().split()), ast.unparse(ast.fix_missing_locations(twin))
            # A message may be worded anew.
            old = old.partition("(")[0] if isinstance(node, ast.Raise) else old
            name = path, owner, *(each if len(each) < 80 else f"{each[:77]}..." for each in (old, new))
            put = new if isinstance(node, ast.stmt) else f"({new})"
            found[*name, sum(other[:4] == name for other in found)] = text[:start] + put.encode() + text[end:]
        # Texts of messages, and types, are nothing that runs.
        if not isinstance(node, (ast.Raise, ast.JoinedStr, ast.arg)):
            named = isinstance(node, (ast.FunctionDef, ast.ClassDef))
            own = f"{owner}.{node.name}".lstrip(".") if named else owner
            for field, value in ast.iter_fields(node):
                for child in value if isinstance(value, list) else [value]:
                    if isinstance(child, ast.AST) and field not in ("decorator_list", "annotation", "returns"):
                        visit(child, own)

    visit(ast.parse(text), "")
    return found


def kernels(copied, path=""):
    """Give a fault the compiled kernels of the sources, unless it is where kernels are; return their folder."""
    content = b"".join(file.read_bytes() for file in sorted((copied / "fivcore").rglob("*.py")))
    home = copied.with_suffix(".kernels")
    new = home / f"fiv/kernels-{sha256(content).hexdigest()[:16]}"  # as `fivcore.kernel_store` calls it
    shutil.rmtree(new, ignore_errors=True)
    if (home / "good").exists() and not (path and COMPILES.search((copied / path).read_text())):
        shutil.copytree(home / "good", new)
    return new


def outcome(copied, asked, limit=LIMIT):
    """Run tests in the copy: "" if all pass, else the first that fails, or how the run ended."""
    log, end, code = copied / "log", time.monotonic() + limit, None
    # Forked, so that the libraries are imported once.
    if not (child := os.fork()):
        os.setsid()
        os.chdir(copied)
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        with log.open("w") as file:
            os.dup2(file.fileno(), 1)
            os.dup2(file.fileno(), 2)
        for name in [name for name in sys.modules if name.partition(".")[0] == "tests"]:
            del sys.modules[name]
        sys.path[:] = [str(copied), *(each for each in sys.path if Path(each).resolve() != ROOT)]
        os._exit(sys.modules["pytest"].main([*OPTIONS, *(f"tests/{each}" for each in asked)]))
    while code is None and time.monotonic() < end:
        time.sleep(0.05)
        done, status = os.waitpid(child, os.WNOHANG)
        code = os.waitstatus_to_exitcode(status) if done else None
    if code is None:
        os.killpg(child, signal.SIGKILL)
        os.waitpid(child, 0)
        return "timeout"
    first = re.search(r"^(?:FAILED|ERROR) tests/(.+?)(?: - .*)?$", log.read_text(errors="replace"), re.MULTILINE)
    return "" if code == 0 else first[1] if first else f"exit {code}"


def tried(copied, asked, path, text, known, limit):
    """What becomes of a fault; the test that is known to kill it comes first."""
    file, folder = copied / path, None
    good, stat = file.read_bytes(), file.stat()
    file.write_bytes(text)
    try:
        folder = kernels(copied, path) if path.startswith("fivcore") else None
        return ("::" in known and outcome(copied, [known], limit)) or outcome(copied, asked, limit)
    finally:
        file.write_bytes(good)
        os.utime(file, ns=(stat.st_atime_ns, stat.st_mtime_ns))  # Numba compares it
        shutil.rmtree(folder or copied / "none", ignore_errors=True)


def main():
    """Repeat the record, or draw; print each fault as it is tried."""
    record = json.loads(RECORD.read_text())
    parser = argparse.ArgumentParser(prog="python -m tests.mutants", description=__doc__)
    parser.add_argument("--room", choices=record, help="one room; all by default")
    parser.add_argument("--seed", type=int, help="draw others in place of those of the record")
    parser.add_argument("--survivors", action="store_true", help="only survivors, and those never tried")
    options = parser.parse_args()
    copied = Path(tempfile.gettempdir()) / f"fiv-mutants-{os.getuid()}"
    shutil.rmtree(copied, ignore_errors=True)
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    for name in filter(None, listed.split("\0")):
        (copied / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, copied / name)
    os.environ |= {"PYTHONPATH": str(copied), "NUMBA_CACHE_DIR": str(copied.with_suffix(".kernels"))}
    for name in LIBRARIES:
        importlib.import_module(name)
    for room in [options.room] if options.room else record:
        plan, start, asked = record[room], time.monotonic(), record[room]["tests"].split()
        files = [file.relative_to(ROOT) for each in plan["sources"].split() for file in sorted(ROOT.glob(each))]
        texts = {json.dumps(name): text for path in files for name, text in faults(path.as_posix()).items()}
        if options.seed is not None:
            drawn = random.Random(f"{room} {options.seed}").sample(sorted(texts), len(plan["faults"]))  # noqa: S311
            plan["faults"] = dict.fromkeys(sorted(drawn), "")
        # A test that kills one may be in no file of the room's.
        killers = {each for each in plan["faults"].values() if "::" in each and not each.startswith(tuple(asked))}
        folder = kernels(copied)
        if failure := outcome(copied, [*asked, *sorted(killers)]):
            sys.exit(f"{room}: without a fault, {failure}")
        if folder.exists():
            shutil.copytree(folder, copied.with_suffix(".kernels") / "good", dirs_exist_ok=True)
        limit = 30.0 + 3.0 * (took := time.monotonic() - start)
        print(f"{room}: of {len(texts)} faults; without one the tests take {took:.0f} s", flush=True)
        for name, known in plan["faults"].items():
            if known.startswith("equivalent") or (options.survivors and known):
                continue
            if name not in texts:
                sys.exit(f"{name}: it is no longer in the sources; draw the room again with --seed")
            plan["faults"][name] = tried(copied, asked, json.loads(name)[0], texts[name], known, limit)
            print(name, plan["faults"][name] or "SURVIVED", flush=True)
            RECORD.write_text(json.dumps(record, indent=0, ensure_ascii=False) + "\n")


if __name__ == "__main__":
    main()
