"""The page while results are computed: written again when they change, and served to this machine alone."""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any, NoReturn

from studies import results
from studies.report import page
from studies.report.section import Tell

HOST = "127.0.0.1"
# Between two looks at the results: s, and times what the last page took, since the run needs the processor.
PAUSE, REST = 2.0, 4.0


class Handler(SimpleHTTPRequestHandler):
    """Answers every request with the page."""

    def __init__(self, file: Path, *request: Any) -> None:
        self.file = file
        super().__init__(*request)

    def translate_path(self, path: str) -> str:
        """The page's file, whatever the address."""
        return str(self.file)

    def guess_type(self, path: Any) -> str:
        """The page's type."""
        return "text/html; charset=utf-8"

    def send_head(self) -> Any:
        """The answer's head; no answer where another site's name leads here."""
        if self.headers.get("Host", "").partition(":")[0] not in (HOST, "localhost"):
            return self.send_error(403)
        return super().send_head()

    def log_message(self, *_: Any) -> None:
        """Print nothing."""


def watch(
    targets: Sequence[str], out: str | Path | None, file: str | Path | None, tell: Tell, announce: Tell
) -> NoReturn:
    """Write the page as `page.write` does whenever its results change, and serve it until Ctrl-C.

    `announce` is given its address; `tell` each line once.
    """
    known, said = page.Known(), set[str]()

    def once(line: str) -> None:
        if line not in said:
            tell(line)
        said.add(line)

    def versions() -> list[Any]:
        return [page.version(results.results_file(name, out)) for name in page.names(targets, out)]

    before, took = versions(), 0.0
    written = page.write(targets, out, file, once, known)
    with ThreadingHTTPServer((HOST, 0), partial(Handler, written)) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        announce(f"http://{HOST}:{server.server_port}/")
        try:
            while True:
                time.sleep(max(PAUSE, REST * took))
                begun = time.monotonic()
                if (now := versions()) != before:
                    before = now
                    page.write(targets, out, file, once, known)
                took = time.monotonic() - begun
        finally:
            server.shutdown()
