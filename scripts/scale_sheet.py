"""A sheet to print and lay into a scene, whose tag of known size gives it metres: run.py --scale tag:SIDE.

    python scripts/scale_sheet.py --out FILE.svg [--side METRES] [--number 0..29] [--paper a4|letter]

Any browser prints the file; print it at 100 %, and measure the black square. Lay or hang it flat where several
photographs from different places show it from near, and leave it there. AprilTags (tag36h11, 0 to 29) from elsewhere
serve as well.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "core"))
import bootstrap

bootstrap.load(modules=("scipy",))
from cvdgs.core.capture.tags import CODES, FRAMED, pattern
from cvdgs.core.errors import InputError
from cvdgs.core.files.untrusted import writing_whole
from cvdgs.core.runtime.cli import OneLineParser, exit_code

PAPERS = {"a4": (210.0, 297.0), "letter": (215.9, 279.4)}  # millimetres
_SMALLEST = 0.02  # metres; smaller ones are not read from photographs of a scene
_QUIET = 1  # cells of white around the tag
_MARGIN = 5.0  # millimetres that printers leave white


def main(arguments: list[str]) -> int:
    """Write the sheet; returns the exit code."""

    def work() -> None:
        options = build_parser().parse_args(arguments)
        text = sheet(options.number, options.side, options.paper)
        with writing_whole(options.out) as file:
            file.write(text.encode())
        print(f"{options.out}: print it at 100 %, measure the black square, and give --scale tag:{options.side:g}")

    return exit_code("scale_sheet.py", work)


def build_parser() -> argparse.ArgumentParser:
    """The file and what it shows."""
    parser = OneLineParser(
        prog="scale_sheet.py", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, metavar="FILE.svg", help="replaced if it is there")
    parser.add_argument("--side", type=float, default=0.15, metavar="METRES", help="of the black square (0.15)")
    parser.add_argument("--number", type=int, default=0, metavar=f"0..{len(CODES) - 1}", help="of the tag (0)")
    parser.add_argument("--paper", choices=tuple(PAPERS), default="a4")
    return parser


def sheet(number: int, side: float, paper: str) -> str:
    """The sheet as SVG in millimetres.

    Raises:
        InputError: there is no such tag, or it does not fit the paper.
    """
    width, height = PAPERS[paper]
    largest = (width - 2.0 * _MARGIN) * FRAMED / (FRAMED + 2 * _QUIET) / 1000.0
    if not 0 <= number < len(CODES):
        raise InputError(f"there is no tag {number}", where="--number", remedy=f"give 0 to {len(CODES) - 1}")
    if not _SMALLEST <= side <= largest:
        remedy = f"give {_SMALLEST} to {largest:.3f} metres"
        raise InputError(f"{side:g} m does not fit {paper}", where="--side", remedy=remedy)
    cell = 1000.0 * side / FRAMED
    left, top = (width - 1000.0 * side) / 2.0, (height - 1000.0 * side) / 2.0
    cells = pattern(number)
    squares = "".join(
        f'<rect x="{left + column * cell:.4f}" y="{top + row * cell:.4f}" width="{cell:.4f}" height="{cell:.4f}"/>'
        for row in range(FRAMED)
        for column in range(FRAMED)
        if not cells[row, column]
    )
    said = f"Black square: {1000.0 * side:g} mm outside. Print at 100 %, measure it, and give --scale tag:{side:g}"
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}mm" height="{height}mm" viewBox="0 0 {width} {height}">'
        f'<rect width="{width}" height="{height}" fill="#fff"/><g shape-rendering="crispEdges">{squares}</g>'
        f'<text x="{width / 2}" y="{height - 12.0}" font-family="sans-serif" font-size="4" text-anchor="middle">'
        f"{said} (tag36h11 {number})</text></svg>\n"
    )


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
