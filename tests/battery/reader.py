"""A process that reads what may be damaged: one that hangs or dies is an answer too, and another takes its place."""

import hashlib
import json
import multiprocessing
import resource
import signal

import tests.battery.commands
from sweeps import StoreError, open_results
from tests.battery.commands import Done

# s until a reader counts as one that hangs, and the memory that it may have.
PATIENCE, MEMORY = 60.0, 12 << 30
# Bytes of a variable that nobody made.
LARGE = 1 << 24


def fiv(folder, *arguments):
    """Run a command there."""
    return tests.battery.commands.fiv(folder, *arguments)


def opened(folder, path):
    """A digest of whatever a result holds, by `open_results`; what it refuses ends as the command would."""
    try:
        data = open_results(folder / path)
        found = digest(data)
        data.close()
    except ValueError as problem:
        return Done(2, "", f"fiv: {problem}\n")
    except StoreError as problem:
        return Done(3, "", f"fiv: {problem}\n")
    return Done(0, found, "")


def digest(data):
    """What is in a dataset, to the last bit, but for the times that its points took."""
    found = hashlib.sha256(json.dumps(data.attrs, default=str, sort_keys=True).encode())
    for name in sorted(map(str, set(data.variables) - {"wall_time"})):
        each = data[name]
        found.update(f"{name} {each.dims} {each.shape} {each.dtype} {each.attrs}".encode())
        if each.nbytes < LARGE:
            found.update(repr(each.values.tolist()).encode())
    return found.hexdigest()


def serve(pipe, prepare):
    """Answer whatever is asked, until the other side closes."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    prepare()
    while True:
        try:
            how, folder, arguments = pipe.recv()
        except EOFError:
            return
        pipe.send(how(folder, *arguments))


class Reader:
    """Runs commands, and opens results, elsewhere.

    Parameters
    ----------
    prepare : callable
        Run at the beginning of the process.
    """

    def __init__(self, prepare):
        self.prepare = prepare
        self.process = None

    def ask(self, folder, *arguments, how=fiv):
        """How it ended there."""
        if self.process is None:
            context = multiprocessing.get_context("spawn")
            self.pipe, theirs = context.Pipe()
            self.process = context.Process(target=serve, args=(theirs, self.prepare), daemon=True)
            self.process.start()
            theirs.close()
        try:
            self.pipe.send((how, folder, arguments))
            if self.pipe.poll(PATIENCE):
                return self.pipe.recv()
            return Done(-signal.SIGKILL, "", self.end() or f"it did not end within {PATIENCE:g} s")
        except (EOFError, ConnectionError):
            self.process.join()
            code = self.process.exitcode
            return Done(code, "", self.end() or f"the process died with {code}")

    def end(self):
        """End the process."""
        if self.process is not None:
            self.pipe.close()
            self.process.kill()
            self.process.join()
            self.process = None
