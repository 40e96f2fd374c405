"""What is shown on a terminal; what where there is none, `tests/cli/test_cli.py` has."""

import os
import pty
import re
import subprocess
import sys

COLOUR = re.compile(rb"\x1b\[[0-9;]*m")
COMMAND = (sys.executable, "-m", "studies", "run", "table4", "--yes")


def on_a_terminal(folder, **environment):
    """Everything that a terminal was sent."""
    ours, theirs = pty.openpty()
    given = {name: value for name, value in os.environ.items() if name != "NO_COLOR"}
    given |= {"TERM": "xterm-256color", "FIV_RESULTS": str(folder)} | environment
    with subprocess.Popen(COMMAND, stdin=theirs, stdout=theirs, stderr=theirs, env=given) as program:
        os.close(theirs)
        seen = b""
        while True:
            try:
                piece = os.read(ours, 4096)
            except OSError:  # the program has gone
                break
            if not piece:
                break
            seen += piece
    os.close(ours)
    assert program.returncode == 0, seen.decode()
    return seen


def test_a_bar_in_colour_only_where_it_is_wanted(tmp_path):
    shown = on_a_terminal(tmp_path / "with")
    assert "━".encode() in shown
    assert COLOUR.search(shown)
    plain = on_a_terminal(tmp_path / "without", NO_COLOR="1")
    assert "━".encode() in plain
    assert not [code for code in COLOUR.findall(plain) if re.search(rb"[34]\d|38|48", code)]


def test_output_that_cannot_be_written_is_one_line():
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "studies", "completion", "zsh"], stdout=full, stderr=subprocess.PIPE, text=True
        )
    assert done.returncode == 3
    assert done.stderr == "fiv: standard output could not be written: No space left on device\n"
