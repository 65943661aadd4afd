"""Figure 1: the modes from novel views, as normal and as simulated vision see them, and how steady they are."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...color.simulated_bytes import simulate_bytes
from ...run_files import ORIGINAL
from ...settings import Layer
from ..charts import Theme, write_charts
from .novel_views import COMPARED, NovelViews, least_steady_step, window_of_disagreement

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLUMNS = (ORIGINAL, *COMPARED)
_TITLES = {ORIGINAL: "original colours", "post": "post", "joint": "joint", "layers": "layers"}
_FRAME = "#ff2d95"  # of the window; a colour that no textile of the showrooms has
_WINDOW = 0.28  # side of the window, of the picture's height

# In inches.
_WIDTH, _MARGIN, _GAP, _ROW_GAP = 13.0, 0.15, 0.12, 0.1
_LABELS = 0.85  # width of the rows' titles
_HEADINGS = 0.3
_STRIP = 1.0  # height of a strip
_STRIP_TITLE = 0.35

Image = NDArray[np.uint8]


@dataclass(frozen=True)
class Choice:
    """What the figure shows of the path.

    Attributes:
        camera: the first of the two neighbouring cameras.
        corner: row and column of the window's upper left corner.
        side: of the window in pixels.
        slice: first column and width of what a strip takes of each picture.
    """

    camera: int
    corner: tuple[int, int]
    side: int
    slice: tuple[int, int]

    @classmethod
    def of(cls, views: NovelViews) -> Choice:
        """The cameras between which `post` is least steady, and the window where the modes disagree the most."""
        height, width = views.pictures[ORIGINAL][0].shape[:2]
        camera = least_steady_step(views.pictures, "post", "layers")
        side = max(round(_WINDOW * height), 8)
        corner = window_of_disagreement(views.pictures, (camera, camera + 1), side)
        slice_width = max(round(width / len(views.pictures[ORIGINAL])), 1)
        column = min(max(corner[1] + (side - slice_width) // 2, 0), width - slice_width)
        return cls(camera, corner, side, (column, slice_width))


def write_figure(folder: Path, name: str, views: NovelViews, layer: Layer, simulation: str, title: str) -> Choice:
    """Write ``<name>.png`` and ``<name>-dark.png``; returns what was chosen to be shown.

    Raises:
        InputError: matplotlib is missing.
    """
    choice = Choice.of(views)
    sights: Mapping[str, Callable[[Image], Image]] = {
        "normal\nvision": lambda image: image,
        layer.name.replace("-", "\n"): lambda image: simulate_bytes(image, layer.cvd, layer.severity, simulation),
    }
    height, width = views.pictures[ORIGINAL][0].shape[:2]
    page = _Page(width / height)

    def draw(figure: Figure, theme: Theme) -> None:
        figure.set_layout_engine("none")
        page.draw(figure, theme, views, choice, sights, title)

    write_charts(folder, name, (_WIDTH, page.height), draw, formats=("png",))
    return choice


def strip(pictures: Sequence[Image], choice: Choice) -> Image:
    """The same slice of every picture side by side: time runs from left to right, and what flickers is striped."""
    first, width = choice.slice
    return np.concatenate([picture[:, first : first + width] for picture in pictures], axis=1)


class _Page:
    """Where things are.

    Args:
        aspect: width of a picture by its height.
    """

    def __init__(self, aspect: float) -> None:
        self._aspect = aspect
        self._cell = (_WIDTH - 2 * _MARGIN - _LABELS - 3 * _GAP) / len(_COLUMNS)
        # Beside a picture stand two squares, each half as high.
        self._picture = (self._cell - 0.04) / (aspect + 0.5)
        rows = 2 * (self._picture + _ROW_GAP) + 2 * (_STRIP + _ROW_GAP)
        self.height = _MARGIN + _HEADINGS + _HEADINGS + rows + _STRIP_TITLE + _MARGIN

    def draw(
        self,
        figure: Figure,
        theme: Theme,
        views: NovelViews,
        choice: Choice,
        sights: Mapping[str, Callable[[Image], Image]],
        title: str,
    ) -> None:
        """Put everything on an empty figure."""
        top = _MARGIN
        self._text(figure, _MARGIN, top, title, size=11, weight="bold")
        top += _HEADINGS
        for column, name in enumerate(_COLUMNS):
            self._text(figure, self._left(column), top, _TITLES[name], size=10)
        top += _HEADINGS
        for label, sight in sights.items():
            self._text(figure, _MARGIN, top, label, size=9)
            for column, name in enumerate(_COLUMNS):
                pair = [sight(views.pictures[name][choice.camera + step]) for step in (0, 1)]
                self._show_pair(figure, self._left(column), top, pair, choice)
            top += self._picture + _ROW_GAP
        words = (
            f"The same narrow slice of {len(views.pictures[ORIGINAL])} views on the way from {views.between[0]} to "
            f"{views.between[1]}, side by side: what flickers is striped"
        )
        self._text(figure, _MARGIN, top + 0.08, words, size=9, color=theme.muted)
        top += _STRIP_TITLE
        for label, sight in sights.items():
            self._text(figure, _MARGIN, top, label, size=9)
            for column, name in enumerate(_COLUMNS):
                image = strip([sight(picture) for picture in views.pictures[name]], choice)
                self._axes(figure, self._left(column), top, self._cell, _STRIP).imshow(image, aspect="auto")
            top += _STRIP + _ROW_GAP

    def _show_pair(self, figure: Figure, left: float, top: float, pair: Sequence[Image], choice: Choice) -> None:
        """The first picture with its window framed, and the window of both, enlarged, one above the other."""
        from matplotlib.patches import Rectangle

        height, wide = self._picture, self._picture * self._aspect
        axes = self._axes(figure, left, top, wide, height)
        axes.imshow(pair[0], aspect="auto")
        (row, column), side = choice.corner, choice.side
        axes.add_patch(Rectangle((column - 0.5, row - 0.5), side, side, fill=False, edgecolor=_FRAME, linewidth=1.2))
        square = height / 2 - 0.02
        for number, image in enumerate(pair):
            inset = self._axes(figure, left + wide + 0.04, top + number * (height / 2 + 0.02), square, square)
            inset.imshow(image[row : row + side, column : column + side], aspect="auto", interpolation="nearest")
            for spine in inset.spines.values():
                spine.set(visible=True, edgecolor=_FRAME, linewidth=1.2)

    def _left(self, column: int) -> float:
        return _MARGIN + _LABELS + column * (self._cell + _GAP)

    def _axes(self, figure: Figure, left: float, top: float, width: float, height: float) -> Axes:
        """Axes without ticks; inches from the upper left corner."""
        bottom = self.height - top - height
        axes = figure.add_axes(
            (left / _WIDTH, bottom / self.height, width / _WIDTH, height / self.height), xticks=[], yticks=[]
        )
        axes.grid(visible=False)
        for spine in axes.spines.values():
            spine.set_visible(False)
        return axes

    def _text(self, figure: Figure, left: float, top: float, words: str, **style: Any) -> None:
        figure.text(left / _WIDTH, 1.0 - top / self.height, words, va="top", **style)
