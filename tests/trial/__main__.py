"""A new user's day in a fresh clone: `python -m tests.trial [--out FOLDER]` plays the requests of `requests.toml`.

The checkout's last commit is cloned into a temporary folder and used by this process's environment, with an empty
cache of compiled kernels. `sheet.html` then has all that each request printed, its exit code, its time and its
pictures, to be read aloud and looked at. The exit status is 1 where an exit code is not the expected one.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack
from html import escape
from pathlib import Path
from typing import Any, NamedTuple

from tests import HOME
from tests.helpers import browser

PHONE, LONGEST = (375, 812), 900.0  # pixels; s
STYLE = "body { font: 15px sans-serif } pre { white-space: pre-wrap; background: #eee } img { max-width: 38em }"


class Played(NamedTuple):
    """A request, what it printed, its exit code, its time in s, and names of its pictures."""

    request: dict[str, Any]
    text: str
    code: int
    seconds: float
    pictures: list[str]

    @property
    def wrong(self) -> bool:
        """Whether the exit code is not the expected one."""
        return bool(self.code != self.request.get("code", 0))

    def __str__(self) -> str:
        expected = f" instead of {self.request.get('code', 0)}" if self.wrong else ""
        return f"{self.request['kind']}: {self.request['wish']} (exit {self.code}{expected}; {self.seconds:.1f} s)"


def environment(folder: Path) -> dict[str, str]:
    """The environment of the user's shell: `fiv` and `python` use the clone."""
    command = folder / "bin" / "fiv"
    command.parent.mkdir()
    command.write_text(f'#!/bin/sh\nexec {sys.executable} -m studies "$@"\n')
    command.chmod(0o755)
    path = os.pathsep.join((str(command.parent), str(Path(sys.executable).parent), os.environ["PATH"]))
    own = {"PATH": path, "PYTHONPATH": str(folder / "fiv"), "NUMBA_CACHE_DIR": str(folder / "kernels")}
    given = {name: value for name, value in os.environ.items() if name != "FIV_RESULTS"}
    return {"DATA": str(HOME.parent / "shared" / "data")} | given | own


def typed(command: str, clone: Path, env: dict[str, str]) -> tuple[str, int]:
    """Run a command as it is typed in the clone; what it printed, and its exit code."""
    options: dict[str, Any] = {"stdin": subprocess.DEVNULL, "stderr": subprocess.STDOUT, "timeout": LONGEST}
    done = subprocess.run(["bash", "-c", command], cwd=clone, env=env, stdout=subprocess.PIPE, **options)
    return done.stdout.decode(errors="replace"), done.returncode


def touched(request: dict[str, Any], driver: Any) -> tuple[str, int]:
    """Click, type and ask on the page; its answer, and 1 where it throws an error."""
    from selenium.webdriver import ActionChains

    browser.resize(driver, *PHONE, request.get("colours", "light"))
    if css := request.get("click"):
        place = driver.find_element("css selector", css)
        driver.execute_script("arguments[0].scrollIntoView({block: 'center'})", place)
        ActionChains(driver).click(place).send_keys(request.get("type", "")).pause(1.0).perform()
    catch = "(error) => arguments[0](`Error: ${error}`)"
    text = str(driver.execute_async_script(f"(async () => {{ {request['do']} }})().then(arguments[0], {catch})"))
    return text, int(text.startswith("Error: "))


def pictures(clone: Path) -> dict[Path, float]:
    """When each picture of the clone was written."""
    return {path: path.stat().st_mtime for path in clone.rglob("*.[psg][nvi][gf]")}


def play(requests: list[dict[str, Any]], folder: Path, out: Path) -> Iterator[Played]:
    """Play the requests one after another in a new clone."""
    clone, env, driver = folder / "fiv", environment(folder), None
    subprocess.run(["git", "clone", "-q", str(HOME), str(clone)], check=True)
    known = pictures(clone)
    with ExitStack() as stack:
        for number, request in enumerate(requests, 1):
            begin = time.perf_counter()
            if request["kind"] != "phone":
                text, code = typed(request["do"], clone, env)
            else:
                if driver is None:
                    driver = stack.enter_context(browser.chromium(folder))
                    driver.get((clone / "results" / "report.html").as_uri())
                    browser.load_axe(driver)
                text, code = touched(request, driver)
                driver.save_screenshot(str(clone / "screen.png"))
            seconds, now = time.perf_counter() - begin, pictures(clone)
            drawn = sorted(path for path in now if now[path] != known.get(path))
            copies = [Path(shutil.copy(path, out / f"{number:02}-{path.name}")).name for path in drawn]
            known = now
            yield Played(request, text.replace(str(folder), "~"), code, seconds, copies)


def sheet(played: list[Played]) -> str:
    """One HTML page of all that was played, with the pictures in its folder."""
    parts = [f"<!doctype html><meta charset=utf-8><title>A new user's day</title><style>{STYLE}</style>"]
    for number, one in enumerate(played, 1):
        text = f"<b>{escape(one.request['do'].strip())}</b>\n\n{escape(one.text)}"
        pictures = "".join(f"<img src='{escape(name)}' alt=''>" for name in one.pictures)
        parts.append(f"<h3>{number}. {escape(str(one))}</h3><pre>{text}</pre>{pictures}")
    return "\n".join(parts)


def main() -> None:
    """Play, and print a line for each request, the total time, the ten slowest, and exit codes that differ."""
    parser = argparse.ArgumentParser(prog="python -m tests.trial", description=__doc__.partition("\n")[0])
    parser.add_argument("--out", type=Path, default=Path("trial"), help="folder of sheet.html and its pictures")
    out = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)
    requests = tomllib.loads(Path(__file__).with_name("requests.toml").read_text("utf-8"))["request"]
    played = list[Played]()
    with tempfile.TemporaryDirectory() as folder:
        for one in play(requests, Path(folder), out):
            played.append(one)
            print(f"{len(played):2} {one}", flush=True)
            (out / "sheet.html").write_text(sheet(played), "utf-8")
    kinds = ", ".join(f"{count} {kind}" for kind, count in Counter(one.request["kind"] for one in played).items())
    print(f"\n{sum(one.seconds for one in played):.0f} s in all ({kinds}). The ten slowest:")
    print(*sorted(played, key=lambda one: -one.seconds)[:10], sep="\n")
    wrong = [one for one in played if one.wrong]
    print(f"\n{len(wrong)} exit codes are not those expected.", *wrong, sep="\n")
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
