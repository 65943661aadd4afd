"""A web page in a real browser without a window: Chromium or Chrome, drawing in software, driven by playwright."""

from __future__ import annotations

import base64
import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cvdgs.core.errors import InputError
from cvdgs.core.files.images import write_png

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
# Pages are our own, and containers allow no sandbox.
SOFTWARE_GRAPHICS = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
WITHOUT_GRAPHICS = ("--no-sandbox", "--disable-3d-apis")
_STEP = 4  # grey levels of a screenshot that become one
OPENING_MAY_TAKE = 120_000.0  # milliseconds
_PICTURE = """async ([camera, look]) => {
    cvdgs.observer = look.observer;
    document.getElementById("amount").value = look.amount;
    document.getElementById("severity").value = look.severity;
    cvdgs.layer = look.layer;
    const blob = await cvdgs.picture(camera);
    const bytes = new Uint8Array(await new Response(blob).arrayBuffer());
    return btoa(Array.from(bytes, (byte) => String.fromCharCode(byte)).join(""));
}"""


def find_browser() -> str:
    """The program to drive, as `find_program`.

    Raises:
        InputError: playwright or a browser is missing.
    """
    try:
        import playwright.sync_api  # noqa: F401
    except ImportError:
        raise InputError("playwright is missing", remedy="run make venv") from None
    return find_program()


def find_program() -> str:
    """A browser: $CVDGS_BROWSER, or the first of `NAMES` that is there; raises `InputError` without any."""
    for name in (os.environ.get("CVDGS_BROWSER", ""), *NAMES):
        if name and (path := shutil.which(name)):
            return path
    raise InputError("there is no Chromium or Chrome", remedy="install one, or name it in CVDGS_BROWSER")


def write_screenshot(path: Path, pixels: NDArray[np.uint8]) -> None:
    """Write (H, W, 3) pixels as PNG with a quarter of the grey levels, for half of the bytes.

    Unlike with a palette, all hues stay.
    """
    levels = (pixels.astype(np.uint16) + _STEP // 2) // _STEP * _STEP
    write_png(path, np.minimum(levels, 255).astype(np.uint8))


@contextmanager
def browser(arguments: Sequence[str] = SOFTWARE_GRAPHICS) -> Iterator[Browser]:
    """A browser for the time of the block; raises as `find_browser`."""
    program = find_browser()
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=program, args=list(arguments))
        try:
            yield running
        finally:
            running.close()


def open_viewer(page: Page, path: Path) -> float:
    """Open a ``viewer.html`` from the disk; returns after how many seconds its picture is there."""
    page.goto(path.resolve().as_uri())
    page.wait_for_selector("html[data-ready]", timeout=OPENING_MAY_TAKE)
    return float(page.evaluate("document.documentElement.dataset.ready")) / 1000.0


def picture_of(
    page: Page, camera: dict[str, Any], *, observer: str = "normal", severity: float = 1.0, **look: int
) -> bytes:
    """PNG of what an open viewer shows from one of its scene's cameras.

    Args:
        look: ``layer``, its number, and ``amount``, percent of its colours; the first layer's in full unless given.
    """
    wanted = {"layer": 0, "amount": 100, **look, "observer": observer, "severity": severity}
    return base64.b64decode(page.evaluate(_PICTURE, [camera, wanted]))
