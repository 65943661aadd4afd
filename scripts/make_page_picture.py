"""The README's picture of a batch's page: python scripts/make_page_picture.py SHOW/index.html --out FILE.png.

A browser draws the page without a window (Chromium, or Chrome; `--browser` says which).
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "core"))
import bootstrap

bootstrap.load(modules=("OpenImageIO",))
import numpy as np

from cvdgs.core.files.images import read_png, write_png

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
SIZE = (620, 820)  # of the window, in pixels: the page's head, one turntable and its controls
LOADING = 2500  # milliseconds of the page's clock before it is drawn
DRAWING_MAY_TAKE = 300.0  # seconds
STEP = 4  # grey levels that become one, for half of the bytes; unlike with a palette, all hues stay


def draw_page(page: Path, picture: Path, browser: str) -> None:
    """Let `browser` draw `page` into the PNG file `picture`.

    Raises:
        subprocess.SubprocessError: the browser fails, or does not end.
    """
    with tempfile.TemporaryDirectory() as profile:
        command = [browser, "--headless", "--hide-scrollbars", "--mute-audio", f"--user-data-dir={profile}"]
        command += ["--no-sandbox"]  # the page is our own, and containers allow no sandbox
        command += [f"--window-size={SIZE[0]},{SIZE[1]}", f"--virtual-time-budget={LOADING}"]
        command += ["--force-prefers-reduced-motion"]  # the page then shows each turn's first picture
        command += [f"--screenshot={picture.resolve()}", page.resolve().as_uri()]
        subprocess.run(command, check=True, capture_output=True, timeout=DRAWING_MAY_TAKE)


def main(arguments: list[str]) -> int:
    """Write the picture; returns the exit code."""
    parser = argparse.ArgumentParser(prog="make_page_picture.py", description=__doc__.splitlines()[0])
    parser.add_argument("page", type=Path, metavar="SHOW/index.html", help="written by scripts/turntable.py")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE.png")
    parser.add_argument("--browser", default=next(filter(shutil.which, BROWSERS), None), help="the first one found")
    options = parser.parse_args(arguments)
    if options.browser is None:
        parser.error(f"none of {', '.join(BROWSERS)} is installed; name a browser with --browser")
    if not options.page.is_file():
        parser.error(f"{options.page} does not exist; run the batch first")
    draw_page(options.page, options.out, options.browser)
    levels = read_png(options.out)[..., :3].astype(np.uint16)
    write_png(options.out, np.minimum((levels + STEP // 2) // STEP * STEP, 255).astype(np.uint8))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
