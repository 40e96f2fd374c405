"""The command as whole processes, and what it leaves behind."""

import os
import subprocess
import sys
from pathlib import Path

FIV = str(Path(sys.executable).with_name("fiv"))


def fiv(folder, *arguments, command=(FIV,)):
    environment = {k: v for k, v in os.environ.items() if k != "FIV_RESULTS"}
    return subprocess.run([*command, *arguments], cwd=folder, capture_output=True, text=True, env=environment)


def written(folder) -> list[str]:
    return sorted(str(p.relative_to(folder)) for p in Path(folder).rglob("*") if p.is_file())
