"""What is shown on a terminal; what where there is none, `tests/cli/test_cli.py` has."""

import os
import pty
import re
import subprocess
import sys
from contextlib import suppress

COMMAND = (sys.executable, "-m", "studies", "run", "table4", "--yes")


def test_a_bar_in_colour(tmp_path):
    ours, theirs = pty.openpty()
    given = {name: value for name, value in os.environ.items() if name != "NO_COLOR"}
    given |= {"TERM": "xterm-256color", "FIV_RESULTS": str(tmp_path)}
    with subprocess.Popen(COMMAND, stdin=theirs, stdout=theirs, stderr=theirs, env=given) as program:
        os.close(theirs)
        seen = b""
        with suppress(OSError):  # the program has gone
            while piece := os.read(ours, 4096):
                seen += piece
    os.close(ours)
    assert program.returncode == 0, seen.decode()
    assert "━".encode() in seen
    assert re.search(rb"\x1b\[[0-9;]*m", seen)
