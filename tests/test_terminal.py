"""What is shown on a terminal, and what where there is none."""

import os
import pty
import re
import subprocess
import sys

COLOUR = re.compile(rb"\x1b\[[0-9;]*m")
# Enough to do that a bar is seen.
COMMAND = (sys.executable, "-m", "studies", "run", "fig5", "--set", "mu=0:0.5:201", "--yes")


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


def test_quiet_where_it_is_piped(tmp_path):
    given = os.environ | {"FIV_RESULTS": str(tmp_path)}
    done = subprocess.run(COMMAND, env=given, capture_output=True)
    assert done.returncode == 0
    assert b"\x1b" not in done.stdout + done.stderr
    assert "━".encode() not in done.stderr
    quiet = subprocess.run((*COMMAND, "-q", "--fresh"), env=given, capture_output=True)
    assert quiet.stderr == b""
    assert quiet.stdout == done.stdout
