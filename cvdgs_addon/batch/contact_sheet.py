"""The contact sheet of an item: what its turntables show from all sides, a row each, on one picture."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from ...core.files.untrusted import replacing
from ...core.rendering.requests import SheetArguments
from ...core.runs.layout import picture_name, spread_over_turn
from ...core.runtime.protocol import Reporter
from .lettering import Label, add_labels, text_width
from .pixels import Pixels, downscale, read_picture, write_picture

STAGE = "sheet"

_PICTURE_WIDTH = 240  # pixels, at most
_MARGIN, _GAP = 36, 8  # pixels around the sheet, and between pictures
_HEADING, _LABEL, _ANGLE = 30, 17, 13  # pixels of type
_HEADING_BAND, _LABEL_BAND, _ANGLE_BAND = 44, 42, 30  # pixels of height that the type takes
# Even and near white: colours are judged against it, and it costs little ink.
_PAPER = 242


def make_sheet(arguments: SheetArguments, out: Path, *, reporter: Reporter) -> dict[str, Any]:
    """Make the sheet of a task; replaces the file that is open.

    Raises:
        InputError: a picture is missing.
        OSError: the sheet cannot be written.
        RuntimeError: Blender could not write it.
    """
    rows = []
    for done, row in enumerate(arguments.rows):
        reporter.progress(STAGE, done / len(arguments.rows), str(row["label"]))
        numbers = spread_over_turn(int(row["frames"]), arguments.columns)
        paths = [out / row["folder"] / picture_name(number) for number in numbers]
        rows.append([downscale(read_picture(path), _PICTURE_WIDTH) for path in paths])
    sheet, tops = _laid_out(rows, _widest_line(arguments))
    file = out / arguments.file
    with replacing(file) as temporary:
        write_picture(temporary, sheet)
        add_labels(temporary, _labels(arguments, rows, tops))
    reporter.progress(STAGE, 1.0, file.name)
    return {"pictures": sum(map(len, rows))}


def _widest_line(arguments: SheetArguments) -> int:
    """Pixels that the longest line of type takes."""
    lines = [(arguments.title, _HEADING), *((str(row["label"]), _LABEL) for row in arguments.rows)]
    return math.ceil(max(text_width(text, size) for text, size in lines))


def _laid_out(rows: list[list[Pixels]], least_width: int) -> tuple[Pixels, list[int]]:
    """The sheet without its type, and the top of each row's pictures."""
    width = max(least_width, *(sum(picture.shape[1] + _GAP for picture in row) - _GAP for row in rows))
    heights = [max(picture.shape[0] for picture in row) for row in rows]
    total = _MARGIN + _HEADING_BAND + sum(height + _LABEL_BAND for height in heights) + _ANGLE_BAND + _MARGIN
    sheet = np.full((total, width + 2 * _MARGIN, 3), _PAPER, np.uint8)
    tops, top = [], _MARGIN + _HEADING_BAND
    for row, height in zip(rows, heights, strict=True):
        top += _LABEL_BAND
        tops.append(top)
        left = _MARGIN
        for picture in row:
            sheet[top : top + picture.shape[0], left : left + picture.shape[1]] = picture
            left += picture.shape[1] + _GAP
        top += height
    return sheet, tops


def _labels(arguments: SheetArguments, rows: list[list[Pixels]], tops: list[int]) -> list[Label]:
    """The heading, what each row is, and the angles of the columns below the last one."""
    labels = [Label(arguments.title, _MARGIN, _MARGIN + _HEADING / 2.0, _HEADING)]
    for row, top in zip(arguments.rows, tops, strict=True):
        labels.append(Label(str(row["label"]), _MARGIN, top - _LABEL_BAND / 2.0 + _GAP / 2.0, _LABEL))
    frames = int(arguments.rows[-1]["frames"])
    bottom = tops[-1] + max(picture.shape[0] for picture in rows[-1])
    left = float(_MARGIN)
    for number, picture in zip(spread_over_turn(frames, arguments.columns), rows[-1], strict=True):
        angle = 360.0 * (number - 1) / frames
        labels.append(Label(f"{angle:.0f}°", left, bottom + _ANGLE_BAND / 2.0 + 2.0, _ANGLE, grey=0.35))
        left += picture.shape[1] + _GAP
    return labels
