"""The system's Chromium without a window, driven by Selenium, and the check of a page by axe-core."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

FLAGS = ("headless", "no-sandbox", "disable-gpu", "disable-background-networking", "disable-dev-shm-usage")


def programs() -> list[str | None]:
    """Chromium and its driver; None for a missing one."""
    return [shutil.which("chromium") or shutil.which("google-chrome"), shutil.which("chromedriver")]


@contextmanager
def chromium(folder: Path) -> Iterator[Any]:
    """A driver of Chromium with a new profile, which saves into `folder`."""
    from selenium import webdriver

    options, (binary, own) = webdriver.ChromeOptions(), programs()
    options.binary_location = str(binary)
    for flag in (*FLAGS, f"user-data-dir={folder / 'profile'}"):
        options.add_argument(f"--{flag}")
    options.add_experimental_option("prefs", {"download.default_directory": str(folder)})
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    with webdriver.Chrome(options, webdriver.ChromeService(executable_path=own)) as driver:
        yield driver


def resize(driver: Any, width: int, height: int, colours: str = "light") -> None:
    """Give the window a size in pixels, a phone's if it is narrow, and light or dark colours."""
    size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 500}
    driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    scheme = {"features": [{"name": "prefers-color-scheme", "value": colours}]}
    driver.execute_cdp_cmd("Emulation.setEmulatedMedia", scheme)


def load_axe(driver: Any) -> bool:
    """Load axe-core into the page; return whether it is installed."""
    package = find_spec("axe_playwright_python")  # it brings axe-core along; its import would need Playwright
    if package and package.origin:
        driver.set_script_timeout(120.0)
        driver.execute_script(Path(package.origin).with_name("axe.min.js").read_text("utf-8"))
    return package is not None
