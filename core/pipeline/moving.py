"""What training found to move: kept with the run's photographs, told, and shown."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, binary_erosion

from ..capture.model import Capture, View
from ..capture.normalised import write_cameras, write_mask
from ..capture.scaling import downscale, fit_size
from ..files.images import write_png
from ..runs.layout import CAPTURE_FOLDER, MOVING_FILE
from ..runtime.protocol import Reporter
from ..splats.training.plan import Region

_COLUMNS, _MOST_SHOWN = 4, 24
_THUMBNAIL, _GAP, _LINE, _STRIPE = 300, 4, 2, 14  # pixels
_MARK = np.array([213, 94, 0], np.uint8)  # vermilion of Okabe and Ito, which every colour vision tells from grey


def keep_moving(capture: Capture, regions: Mapping[str, Region], folder: Path, reporter: Reporter) -> dict[str, Any]:
    """Write masks of `capture`, which has the `regions` left out, and a picture of them into a run's folder.

    Args:
        regions: (H, W) by view key.

    Returns:
        The report's figures; empty where there is no region.
    """
    if not regions:
        return {}
    views = [view for view in capture.views if view.key in regions]
    for view in views:
        write_mask(view, folder / CAPTURE_FOLDER)
    write_cameras(capture, folder / CAPTURE_FOLDER)
    write_png(folder / CAPTURE_FOLDER / MOVING_FILE, moving_sheet(views, regions))
    moving = sum(int(region.sum()) for region in regions.values())
    theirs, pixels = (sum(v.camera.width * v.camera.height for v in some) for some in (views, capture.views))
    reporter.warning(
        "moving-things",
        f"{len(views)} of {len(capture.views)} photographs show something that others do not, such as people who walk "
        f"by, or gloss: {moving / theirs:.1%} of their pixels, left out of training; {CAPTURE_FOLDER}/{MOVING_FILE} "
        "shows where",
    )
    return {"views": [view.key for view in views], "share": round(moving / pixels, 6)}


def moving_sheet(views: list[View], regions: Mapping[str, Region]) -> NDArray[np.uint8]:
    """(H, W, 3) the photographs in rows, at most 24 of them, with the regions outlined and striped."""
    shown = views[:: -(-len(views) // _MOST_SHOWN)]
    cells = [_marked(view.image, regions[view.key]) for view in shown]
    height, width = (max(cell.shape[axis] for cell in cells) + _GAP for axis in (0, 1))
    columns = min(_COLUMNS, len(cells))
    sheet = np.full((-(-len(cells) // columns) * height, columns * width, 3), 32, np.uint8)
    for number, cell in enumerate(cells):
        top, left = number // columns * height, number % columns * width
        sheet[top : top + cell.shape[0], left : left + cell.shape[1]] = cell
    return sheet


def _marked(image: NDArray[np.uint8], region: Region) -> NDArray[np.uint8]:
    width, height = fit_size(image.shape[1], image.shape[0], _THUMBNAIL)
    small = downscale(image, width, height).copy()
    rows = (np.arange(height) * region.shape[0] // height)[:, None]
    inside = region[rows, np.arange(width) * region.shape[1] // width]
    stripes = (np.add.outer(np.arange(height), np.arange(width)) % _STRIPE) < _LINE
    outline = binary_dilation(inside, iterations=_LINE) & ~binary_erosion(inside, iterations=1)
    small[(inside & stripes) | outline] = _MARK
    return small
