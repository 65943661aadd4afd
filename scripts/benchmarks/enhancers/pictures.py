"""The pictures of a comparison of enhancers: contact sheets of a few images, and the chart of the trade-off."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import OpenImageIO as oiio
import pandas as pd
from numpy.typing import NDArray

from ....core.capture.scaling import downscale, fit_size
from ....core.color.simulation import simulate
from ....core.color.spaces import image_to_tensor, tensor_to_image
from ....core.files.images import to_bytes, write_png
from ....core.settings import Layer
from ..charts import Theme, plot_series, write_charts

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Pixels = NDArray[np.uint8]

_TILE = 256  # pixels, longer side of an image
_GAP = 4
_LABEL_HEIGHT, _LABEL_SIZE = 22, 15
_PANEL_WIDTH, _HEIGHT = 3.6, 3.6  # inches, of the chart


def write_contact_sheet(path: Path, images: Sequence[Mapping[str, Pixels]], observer: Layer, model: str) -> None:
    """Write a PNG with a column for each method and two rows for each image: itself, and as the observer sees it.

    Args:
        path: of the file.
        images: (H, W, 3) by the label of the method, in the same order of methods for every image.
        observer, model: of the simulation.
    """
    rows: list[list[Pixels]] = []
    for versions in images:
        rows += [list(versions.values()), [_seen(pixels, observer, model) for pixels in versions.values()]]
    strips = [np.concatenate([_tile(image) for image in row], 1) for row in rows]
    grid = np.concatenate(strips).astype(np.float32) / 255.0
    write_png(path, np.concatenate([_labels(list(images[0]), grid.shape[1]), grid]))


def _seen(pixels: Pixels, observer: Layer, model: str) -> Pixels:
    image = simulate(image_to_tensor(pixels), observer.cvd, observer.severity, model)
    return to_bytes(tensor_to_image(image))


def _labels(labels: Sequence[str], width: int) -> NDArray[np.float32]:
    """(H, width, 3) white strip with the labels of the columns."""
    canvas = oiio.ImageBuf(np.ones((_LABEL_HEIGHT, width, 3), np.float32))
    for column, label in enumerate(labels):
        left = column * (_TILE + _GAP) + _GAP
        oiio.ImageBufAlgo.render_text(canvas, left, _LABEL_SIZE, label, _LABEL_SIZE, "", (0.0, 0.0, 0.0))
    return np.asarray(canvas.get_pixels(oiio.FLOAT))[..., :3]


def _tile(image: Pixels) -> Pixels:
    """The image on a white square, with a gap to its right and below."""
    height, width = image.shape[:2]
    width, height = fit_size(width, height, _TILE)
    tile = np.full((_TILE + _GAP, _TILE + _GAP, 3), 255, np.uint8)
    tile[:height, :width] = downscale(image, width, height)
    return tile


def write_chart(folder: Path, name: str, points: pd.DataFrame, title: str) -> None:
    """Write the mean CCPR over the mean ΔE76 of each method's strengths as ``<name>.svg`` and ``<name>-dark.svg``.

    Args:
        points: ``cvd``, ``method``, ``strength``, ``ccpr`` and ``delta_e_76`` of each.
    """
    size = (_PANEL_WIDTH * points.cvd.nunique(), _HEIGHT)
    write_charts(folder, name, size, partial(_draw, points=points, title=title), formats=("svg",))


def _draw(figure: Figure, theme: Theme, points: pd.DataFrame, title: str) -> None:
    types = points.cvd.unique()
    styles = {method: theme.series[i % len(theme.series)] for i, method in enumerate(points.method.unique())}
    panels = figure.subplots(1, len(types), squeeze=False)[0]
    for panel, cvd in zip(panels, types, strict=True):
        panel.set(title=cvd, xlabel="mean ΔE76 to the original", ylabel="CCPR")
        for method, mine in points[points.cvd == cvd].groupby("method", sort=False):
            curve = mine.groupby("strength")[["delta_e_76", "ccpr"]].mean()
            plot_series(panel, curve.delta_e_76, curve.ccpr, styles[method], method)
    figure.suptitle(title)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=2 * len(types))
