"""The figure of the modes from novel views, for normal and simulated vision, and of how steady they are.

Command: ``benchmark.py figure``.
"""

from __future__ import annotations

import argparse
import shutil
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ....core.color.srgb import simulate_bytes
from ....core.errors import InputError
from ....core.runs.layout import ORIGINAL
from ....core.runtime.cli import ConsoleReporter
from ....core.settings import Layer
from ..charts import Theme, picture, write_charts
from ..enhancers.methods import PER_VIEW_LUT, SCENE, method_label
from ..options import (
    Part,
    add_study_arguments,
    chosen_sources,
    made_by,
    names,
    positive,
    with_quick_defaults,
    work_folder,
)
from ..provenance import fingerprint, trained_product
from ..tables import write_text
from .captures import DEMO
from .jobs import weights_of
from .novel_views import (
    COMPARED,
    NovelViews,
    cached_novel_views,
    least_steady_step,
    novel_views,
    window_of_disagreement,
)
from .recipe import Recipe

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Image = NDArray[np.uint8]

SIZE, ITERATIONS, VIEWS = 320, 1000, 48
QUICK_VIEWS = 6
TITLES = {
    PER_VIEW_LUT: "A LUT of each view alone, which contradicts itself from view to view",
    SCENE: "The product's scene network",
}
_EXPLANATION = [
    "Every camera is between two held-out ones, so no photograph was taken there. Shown are the two neighbouring "
    "cameras between which the pictures of `post` change the most beyond what those of `layers` do. The frame is where "
    "the three modes differ the most (mean ΔE76); beside each picture it is enlarged, above for the camera of the "
    "picture, below for the next one. The strips put the same narrow slice of every camera's picture side by side."
]
_COLUMNS = {ORIGINAL: "original colours", **{mode: mode for mode in COMPARED}}
_FRAME = "#ff2d95"  # of the window; no textile of the showrooms has this colour
_WINDOW = 0.28  # side of the window, relative to the picture's height

# In inches.
_WIDTH, _MARGIN, _GAP, _ROW_GAP = 13.0, 0.15, 0.12, 0.1
_LABELS = 0.85  # width of the rows' titles
_HEADINGS = 0.3
_STRIP = 1.0  # height of a strip
_STRIP_TITLE = 0.35


@dataclass(frozen=True)
class Choice:
    """The part of the path that the figure shows.

    Attributes:
        camera: the first of the two neighbouring cameras.
        corner: row and column of the window's upper left corner.
        side: of the window in pixels.
        slice: first column and width of each picture's slice of a strip.
    """

    camera: int
    corner: tuple[int, int]
    side: int
    slice: tuple[int, int]

    @classmethod
    def of(cls, views: NovelViews) -> Choice:
        """The cameras between which `post` is least steady, and the window where the modes differ most."""
        height, width = views.pictures[ORIGINAL][0].shape[:2]
        camera = least_steady_step(views.pictures, "post", "layers")
        side = max(round(_WINDOW * height), 8)
        corner = window_of_disagreement(views.pictures, (camera, camera + 1), side)
        slice_width = max(round(width / len(views.pictures[ORIGINAL])), 1)
        column = min(max(corner[1] + (side - slice_width) // 2, 0), width - slice_width)
        return cls(camera, corner, side, (column, slice_width))


def write_figure(folder: Path, name: str, views: NovelViews, layer: Layer, simulation: str, title: str) -> Choice:
    """Write ``<name>.png`` and ``<name>-dark.png``; returns the part of the path that is shown.

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
    """The same slice of every picture side by side: time runs from left to right, flicker shows as stripes."""
    first, width = choice.slice
    return np.concatenate([picture[:, first : first + width] for picture in pictures], axis=1)


class _Page:
    """The layout of the figure.

    Args:
        aspect: width of a picture relative to its height.
    """

    def __init__(self, aspect: float) -> None:
        self._aspect = aspect
        self._cell = (_WIDTH - 2 * _MARGIN - _LABELS - 3 * _GAP) / len(_COLUMNS)
        # Beside a picture are two squares, each half as high.
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
        for column, heading in enumerate(_COLUMNS.values()):
            self._text(figure, self._left(column), top, heading, size=10)
        top += _HEADINGS
        for label, sight in sights.items():
            self._text(figure, _MARGIN, top, label, size=9)
            for column, name in enumerate(_COLUMNS):
                pair = [sight(views.pictures[name][choice.camera + step]) for step in (0, 1)]
                self._show_pair(figure, self._left(column), top, pair, choice)
            top += self._picture + _ROW_GAP
        words = (
            f"The same narrow slice of {len(views.pictures[ORIGINAL])} views on the way from {views.between[0]} to "
            f"{views.between[1]}, side by side: flicker shows as stripes"
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
        """The first picture with its window framed; beside it the windows of both, enlarged, one above the other."""
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


def shaping(recipe: Recipe, views: int) -> tuple[Any, ...]:
    """What shapes the pictures of a figure."""
    return *trained_product(), weights_of(recipe), recipe, views


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_study_arguments(parser, captures=(DEMO,), max_size=SIZE, iterations=ITERATIONS, seeds=None, alone=True)
    what = f"names or weight files, one picture each ({','.join(TITLES)})"
    parser.add_argument("--enhancers", type=names, default=tuple(TITLES), metavar="A,B", help=what)
    parser.add_argument("--views", type=positive, default=VIEWS, metavar="N", help=f"cameras on the path ({VIEWS})")


def _measure(options: argparse.Namespace) -> str:
    """Render the modes along a path; writes figure-CAPTURE-ENHANCER.png, the same in dark, and figure.md."""
    options = with_quick_defaults(options)
    if options.views < 2:
        raise InputError("one camera is no path", where="--views", remedy="give 2 or more")
    if options.quick:
        options.views = min(options.views, QUICK_VIEWS)
    lines = ["# The modes from novel views", "", *made_by(options), "", *_EXPLANATION, ""]
    for source in chosen_sources(options):
        subject = source.load()
        for enhancer in options.enhancers:
            recipe = Recipe("figure", enhancer=enhancer, iterations=options.iterations)
            name = f"{source.name}-{method_label(enhancer)}"
            key = fingerprint(source.key, partial(shaping, recipe, options.views))
            place = work_folder(options) / "figure" / f"{name}-{key}"
            if options.again:
                shutil.rmtree(place, ignore_errors=True)
            reporter = ConsoleReporter(sys.stderr)
            make = partial(novel_views, source.name, subject, recipe, options.views, place, reporter)
            views = cached_novel_views(place, make)
            title = f"{TITLES.get(enhancer, method_label(enhancer))}. Capture: {source.name}"
            choice = write_figure(options.out, f"figure-{name}", views, recipe.layer, recipe.simulation, title)
            first, last = views.between
            caption = (
                f"{title}. The path has {len(views.pictures[ORIGINAL])} cameras between the held-out views {first} and "
                f"{last}; pictures and upper enlargements are of camera {choice.camera + 1}, lower ones of camera "
                f"{choice.camera + 2}."
            )
            lines += [picture(f"figure-{name}", title, "png"), "", caption, ""]
    return write_text(options.out / "figure.md", lines)


PART = Part(
    "figure",
    "the modes from novel views, for normal and simulated vision",
    _add_arguments,
    _measure,
    pages=("figure.md",),
    shaped_by=lambda: (*trained_product(), Recipe("any"), COMPARED, _WINDOW),
)
