"""From a capture folder to a `Capture`, or to a summary of it."""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..events import Reporter
from .images import MIN_SIDE, read_header
from .locate import photographs_without_cameras, read_cameras
from .model import Capture, CaptureSummary, CaptureWarning, View
from .sfm import estimate_cameras
from .source import SourceModel
from .views import STAGE, plan_views, read_views

# Below this a reconstruction has to guess what lies between the views.
_FEW_VIEWS = 10


def inspect_capture(folder: str | Path, *, sfm: bool = False, reporter: Reporter | None = None) -> CaptureSummary:
    """What `read_capture` would read, from camera files and image headers alone.

    Args:
        folder: a capture folder, a COLMAP model's folder, or a transforms.json.
        sfm: accept photographs without cameras; they are counted, not estimated.
        reporter: told of progress where there are many points.

    Raises:
        InputError: as `read_capture`, except for damage to pixels.
    """
    folder = Path(folder)
    model = read_cameras(folder, reporter)
    if model is None:
        photographs, names = photographs_without_cameras(folder, sfm=sfm)
        return CaptureSummary(folder, "sfm", len(names), _by_frequency(_sizes(photographs, names)), 0)
    sizes = Counter(plan.photograph_size for plan in plan_views(model, max_size=None))
    _drop_unusable_points(model)
    _warn_about_cameras(model)
    warnings = tuple(model.warnings)
    return CaptureSummary(folder, model.format, len(model.views), _by_frequency(sizes), len(model.points), warnings)


def read_capture(
    folder: str | Path, *, max_size: int | None, sfm: bool = False, reporter: Reporter | None = None
) -> Capture:
    """Read a capture: COLMAP, transforms.json, or with `sfm` photographs alone.

    Args:
        folder: a capture folder, a COLMAP model's folder, or a transforms.json.
        max_size: longer side of the views in pixels; None keeps the photographs' size. Never enlarges.
        sfm: estimate the cameras of photographs that have none.
        reporter: told of progress and of every warning.

    Raises:
        InputError: nothing usable is there, or something in it is damaged.
    """
    folder, reporter = Path(folder), reporter or Reporter()
    if max_size is not None and max_size < MIN_SIDE:
        raise InputError(f"{max_size} pixels are too few", where="--max-size", remedy=f"give at least {MIN_SIDE}")
    reporter.status(STAGE, f"reading the cameras of {folder.name}")
    with _source_model(folder, sfm, reporter) as model:
        plans = plan_views(model, max_size)
        reporter.status(STAGE, f"reading {len(plans)} photographs")
        views = read_views(plans, reporter)
    _drop_unusable_points(model)
    _warn_about_cameras(model)
    _warn_about_alpha(model, views)
    for warning in model.warnings:
        reporter.warning(warning.name, warning.message)
    return Capture(folder, model.format, tuple(views), model.points, model.point_colors, tuple(model.warnings))


@contextmanager
def _source_model(folder: Path, sfm: bool, reporter: Reporter) -> Iterator[SourceModel]:
    """The cameras that the folder gives, else estimated ones while their temporary files exist."""
    model = read_cameras(folder, reporter)
    if model is not None:
        yield model
        return
    photographs, names = photographs_without_cameras(folder, sfm=sfm)
    _sizes(photographs, names)  # refuses what should not be decoded, before pycolmap does
    with tempfile.TemporaryDirectory(prefix="cvdgs-sfm-") as workspace:
        yield estimate_cameras(photographs, names, Path(workspace), reporter)


def _sizes(folder: Path, names: Sequence[str]) -> Counter[tuple[int, int]]:
    """How many of the photographs `names` in `folder` are (width, height) upright.

    Raises:
        InputError: one is no image, or beyond the limits.
    """
    return Counter(read_header(folder / name).upright_size for name in names)


def _drop_unusable_points(model: SourceModel) -> None:
    usable = np.isfinite(model.points).all(axis=1)
    if not usable.all():
        model.warn("unusable-points", f"{model.file}: {np.count_nonzero(~usable)} points are not finite and left out")
        model.points, model.point_colors = model.points[usable], model.point_colors[usable]


def warnings_of_cameras(where: Path, views: int, points: int) -> tuple[CaptureWarning, ...]:
    """What so many views and sparse points in `where` are too few for."""
    found = []
    if views < _FEW_VIEWS:
        found.append(CaptureWarning("few-views", f"{where}: {views} views only; expect gaps, thirty or more work well"))
    if not points:
        found.append(
            CaptureWarning("no-points", f"{where}: no sparse points; the scene starts from where photographs agree")
        )
    return tuple(found)


def _warn_about_cameras(model: SourceModel) -> None:
    model.warnings.extend(warnings_of_cameras(model.file, len(model.views), len(model.points)))


def _warn_about_alpha(model: SourceModel, views: list[View]) -> None:
    transparent = sum(view.alpha is not None for view in views)
    if transparent:
        model.warn("alpha", f"{model.file}: {transparent} photographs have pixels that are not covered")


def _by_frequency(sizes: Counter[tuple[int, int]]) -> tuple[tuple[int, int, int], ...]:
    return tuple((width, height, count) for (width, height), count in sizes.most_common())
