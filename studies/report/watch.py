"""The report during runs: written again after changes, and served to this machine only."""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import cache
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any, NoReturn

from studies.answering import results
from studies.report import page
from studies.report.section import Tell

HOST = "127.0.0.1"
# Between two looks at the results: s, and times what the last page took, since the run needs the processor.
PAUSE, REST = 2.0, 4.0


def watch(
    targets: Sequence[str], out: str | Path | None, file: str | Path | None, tell: Tell, announce: Tell
) -> NoReturn:
    """Write the page as `page.write` does whenever its results change, and serve it until Ctrl-C.

    `announce` is given its address; `tell` each line once.
    """
    known, once = page.Known(), cache(tell)

    def versions() -> list[Any]:
        return [page.version(results.results_file(name, out)) for name in page.names(targets, out)]

    while not targets and not page.own_files(results.results_folder(out)):
        once(f"{results.results_folder(out)} has no results yet; waiting for the first")
        time.sleep(PAUSE)
    before, took = versions(), 0.0
    written = page.write(targets, out, file, once, known)

    class Handler(SimpleHTTPRequestHandler):
        def translate_path(self, path: str) -> str:
            return str(written)  # whatever the address

        def send_head(self) -> Any:
            # Nothing where another site's name leads here.
            known_host = self.headers.get("Host", "").partition(":")[0] in (HOST, "localhost")
            return super().send_head() if known_host else self.send_error(403)

        def log_message(self, *_: Any) -> None:
            pass

    with ThreadingHTTPServer((HOST, 0), Handler) as server:
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
