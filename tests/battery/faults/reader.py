"""A process that reads what may be damaged: where it hangs or dies that is noted, and another takes its place."""

import json
import multiprocessing
import resource
import shutil
import signal
from contextlib import contextmanager
from pathlib import Path

from studies import registry
from sweeps import StoreError, open_results
from sweeps.plan import batches
from sweeps.storage import assemble, existing, netcdf
from tests.battery.surfaces import commands
from tests.battery.surfaces.commands import Done
from tests.helpers.tiny import STUDY

# s until a reader counts as one that hangs, also on a busy machine, and the memory that it may have.
PATIENCE, MEMORY = 120.0, 12 << 30
# Bytes of a variable that nobody made.
LARGE = 1 << 24
FILE = "results/tiny/tiny.nc"
COMMANDS = [
    ("status", "tiny"),
    ("query", "tiny", "--format", "csv"),
    ("plan", "tiny"),
    ("run", "tiny", "-q"),
    ("status", "tiny", "--json"),
    ("query", "tiny", "--where", "word == 'wild'", "--show", "x,row,gain,status,error"),
    ("plan", "tiny", "--set", "x=1:9:9"),
    ("plot", "tiny"),
    ("status", "tiny", "--toml"),
    ("query", FILE, "--by", "kind", "--show", "count,mean:y,share:word"),
    ("plan", FILE, "--fresh"),
    ("run", "tiny", "-q", "--set", "x=1:6:6"),
    ("report", "tiny"),
]
# A message may tell of a value in the file by what it is the value of.
NAMES = ("tiny.nc", "x = ", "kind = ", "gain = ", "STUDY = ", "show = ", "where = ", "by = ")

PARTS = "half/tiny/tiny.nc.parts"
OF_HALF = [(*command, "--out", "half") for command in COMMANDS if FILE not in command]
TABLE = ("query", "tiny", "--format", "csv", "--show", "x,kind,y,word,status,error")


def prepare():
    """A process knows the study, and computes a point at a time."""
    registry._registered, batches.BATCH_BYTES = {"tiny": STUDY}, 1.0


def prepare_large():
    """A process for which every file is a large one."""
    prepare()
    netcdf.CHECKED = existing.CHECKED = existing.READ_AT_ONCE = netcdf.LARGE = assemble.LARGE = 100


def fiv(folder, *arguments):
    """Run a command there."""
    return commands.fiv(folder, *arguments)


def opened(folder, path):
    """Whatever a result holds, by `open_results`; what it refuses ends as the command would."""
    try:
        with open_results(folder / path) as data:
            held = {name: values(data[name]) for name in map(str, data.variables) if name != "wall_time"}
            attributes = {name: each.attrs for name, each in data.variables.items()} | {"": data.attrs}
    except ValueError as problem:
        return Done(2, "", f"fiv: {problem}\n")
    except StoreError as problem:
        return Done(3, "", f"fiv: {problem}\n")
    except RuntimeError as problem:
        # Of a large file, where its values are used.
        if not str(problem).startswith("NetCDF: "):
            raise
        return Done(2, "", f"fiv: {path}: {problem}\n")
    return Done(0, json.dumps({"values": held, "attributes": repr(attributes)}), "")


def values(variable):
    """The values of a variable, each as a text."""
    return [str(each) for each in variable.values.ravel().tolist()] if variable.nbytes < LARGE else []


def serve(pipe, begin):
    """Answer whatever is asked, until the other side closes."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    begin()
    # Whatever is slow to import or to compile.
    commands.fiv(".", "plan", "scenes")
    pipe.send("ready")
    while True:
        try:
            how, folder, arguments = pipe.recv()
        except EOFError:
            return
        pipe.send(how(folder, *arguments))


class Reader:
    """Runs commands, and opens results, in a process that `begin` has prepared."""

    def __init__(self, begin=prepare):
        self.begin, self.process = begin, None

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.end()

    def ask(self, folder, *arguments, how=fiv):
        """How it ended there."""
        if self.process is None:
            context = multiprocessing.get_context("spawn")
            self.pipe, theirs = context.Pipe()
            self.process = context.Process(target=serve, args=(theirs, self.begin), daemon=True)
            self.process.start()
            theirs.close()
            self.pipe.recv()
        try:
            self.pipe.send((how, folder, arguments))
            if self.pipe.poll(PATIENCE):
                return self.pipe.recv()
        except (EOFError, ConnectionError):
            self.process.join()
            return Done(self.end() or -1, "", "the process died")
        self.end()
        return Done(-signal.SIGKILL, "", f"it did not end within {PATIENCE:g} s")

    def end(self):
        """End the process; how it ended, if it has."""
        if self.process is None:
            return None
        code = self.process.exitcode
        self.pipe.close()
        self.process.kill()
        self.process.join()
        self.process = None
        return code


class Trial:
    """A folder of which a file is replaced, what is asked of it, and what is wrong with the answers."""

    def __init__(self, reader, kept: Path, folder: Path) -> None:
        self.reader, self.kept, self.folder = reader, kept, folder
        self.failures, self._good = [], {}

    @contextmanager
    def place(self, file):
        """A copy of the folder, and the path of a file in it."""
        shutil.copytree(self.kept, self.folder, symlinks=True)
        try:
            yield self.folder / file
        finally:
            shutil.rmtree(self.folder)

    def ask(self, case, command, *names, codes=(0, 1, 2, 3)):
        """Ask, None for `open_results`; an answer, or one line that names one of these."""
        done = self._ask(command)
        told = [line for line in done.err.splitlines() if "compiling once" not in line]
        if done.code not in codes or "Traceback" in done.err:
            self.note(case, command, done, "a wrong end")
        elif done.code > 1 and not (len(told) == 1 and told[0].startswith("fiv: ")):
            self.note(case, command, done, "not one line")
        elif done.code > 1 and not any(name in told[0] for name in names):
            self.note(case, command, done, "nothing is named")
        return done

    def _ask(self, command):
        return self.reader.ask(self.folder, *(command or [FILE]), how=fiv if command else opened)

    def note(self, case, command, done, what):
        """Keep a failure, so that all are seen in one run."""
        line = f"{what}: {case}: {command or 'open_results'}: {done.code} {done.out[-300:]} {done.err[-800:]}"
        print(line, flush=True)
        self.failures.append(line)

    def asked_of(self, path, content, case, command, *names):
        """Ask with this content in the place of the file, which stays as it is where it is refused."""
        path.write_bytes(content)
        done = self.ask(case, command, *names)
        if done.code > 1 and path.read_bytes() != content:
            self.note(case, command, done, "the file has changed")
        return done

    def good(self, command):
        """The answer where nothing is damaged."""
        if command not in self._good:
            with self.place(FILE):
                self._good[command] = self._ask(command)
        return self._good[command]
