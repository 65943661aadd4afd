"""The README's picture of a batch's page: python scripts/make_page_picture.py SHOW/index.html --out FILE.png.

A browser draws the page without a window (Chromium, or Chrome; `--browser` or CVDGS_BROWSER say which).

Exit codes: 0 done, 2 no such page, or no browser that draws it.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "core"))
import bootstrap

bootstrap.load(modules=("OpenImageIO",))
from cvdgs.core.errors import InputError
from cvdgs.core.files.images import read_png
from cvdgs.core.runtime.cli import OneLineParser, exit_code
from cvdgs.scripts.benchmarks.browser import find_program, write_screenshot

SIZE = (620, 820)  # of the window, in pixels: the page's head, one turntable and its controls
LOADING = 2500  # milliseconds of the page's clock before it is drawn
DRAWING_MAY_TAKE = 300.0  # seconds


def draw_page(page: Path, picture: Path, browser: str) -> None:
    """Let `browser` draw `page` into the PNG file `picture`.

    Raises:
        InputError: there is no such page, or the browser cannot be started, fails, or does not end.
    """
    if not page.is_file():
        raise InputError("does not exist", where=page, remedy="run the batch first")
    with tempfile.TemporaryDirectory() as folder:
        drawn = Path(folder, "page.png")
        command = [browser, "--headless", "--hide-scrollbars", "--mute-audio", f"--user-data-dir={folder}/profile"]
        command += ["--no-sandbox"]  # the page is our own, and containers allow no sandbox
        command += [f"--window-size={SIZE[0]},{SIZE[1]}", f"--virtual-time-budget={LOADING}"]
        command += ["--force-prefers-reduced-motion"]  # the page then shows each turn's first picture
        command += [f"--screenshot={drawn}", page.resolve().as_uri()]
        try:
            subprocess.run(command, check=True, capture_output=True, timeout=DRAWING_MAY_TAKE)
            pixels = read_png(drawn)[..., :3]
        except (OSError, subprocess.SubprocessError, InputError) as error:
            reason = f"the browser did not draw the page ({error})"
            raise InputError(reason, where=browser, remedy="name Chromium or Chrome with --browser") from None
        write_screenshot(picture, pixels)


def main(arguments: list[str]) -> int:
    """Write the picture; returns the exit code."""
    parser = OneLineParser(prog="make_page_picture.py", description=__doc__.splitlines()[0])
    parser.add_argument("page", type=Path, metavar="SHOW/index.html", help="written by scripts/turntable.py")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE.png")
    parser.add_argument("--browser", help="its program (CVDGS_BROWSER, or the first one found)")

    def work() -> None:
        options = parser.parse_args(arguments)
        draw_page(options.page, options.out, options.browser or find_program())

    return exit_code("make_page_picture.py", work)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
