"""The README's picture from a finished run: python scripts/make_picture.py RUN --out FILE.png [--view KEY].

Left the photograph, right the enhanced scene; above for normal vision, below as the layer's kind of vision sees them.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "core"))
import bootstrap

bootstrap.load(modules=("OpenImageIO",))
import numpy as np

from cvdgs.core.errors import InputError
from cvdgs.core.files.images import read_png, write_png
from cvdgs.core.runs.layout import (
    CAPTURE_FOLDER,
    IMAGES_FOLDER,
    RENDERS_FOLDER,
    SIMULATED_FOLDER,
    SIMULATED_INPUT_FOLDER,
)
from cvdgs.core.runs.report import read_report
from cvdgs.core.runtime.cli import OneLineParser, exit_code

GAP = 6  # pixels of white between the pictures


def sheet(run: Path, layer: str, view: str) -> np.ndarray:
    """(H, W, 3) uint8 of the four pictures."""
    renders = run / RENDERS_FOLDER / layer
    rows = (
        (run / CAPTURE_FOLDER / IMAGES_FOLDER / f"{view}.png", renders / f"{view}.png"),
        (renders / SIMULATED_INPUT_FOLDER / f"{view}.png", renders / SIMULATED_FOLDER / f"{view}.png"),
    )
    pictures = [[read_png(path) for path in row] for row in rows]
    height, width = pictures[0][0].shape[:2]
    result = np.full((2 * height + GAP, 2 * width + GAP, 3), 255, np.uint8)
    for i, row in enumerate(pictures):
        for j, picture in enumerate(row):
            y, x = i * (height + GAP), j * (width + GAP)
            result[y : y + height, x : x + width] = picture
    return result


def main(arguments: list[str]) -> int:
    """Write the picture; returns the exit code."""
    parser = OneLineParser(prog="make_picture.py", description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path, metavar="RUN", help="output folder of scripts/run.py")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE.png")
    parser.add_argument("--view", help="key of a held-out view (the report's first)")

    def work() -> None:
        options = parser.parse_args(arguments)
        report = read_report(options.run)
        try:
            layer, views = next(iter(report["layers"])), [str(view) for view in report["views_shown"]]
            view = options.view or views[0]
        except (LookupError, StopIteration, TypeError):
            raise InputError("its report names no pictures", where=options.run, remedy="make the run again") from None
        if view not in views:
            raise InputError(f"no held-out view '{view}'", where="--view", remedy="use " + ", ".join(views))
        write_png(options.out, sheet(options.run, layer, view))

    return exit_code("make_picture.py", work)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
