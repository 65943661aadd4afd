"""From a capture folder to a `Capture`, or to a summary of it."""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import islice
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..files.images import write_png
from ..files.untrusted import is_file, is_folder, is_there
from ..runtime.protocol import Reporter
from .colmap import IMAGE_FOLDERS, find_colmap, read_colmap
from .files import FOREIGN_EXTENSIONS, list_images, quote_first, resolve_inside
from .foreign import find_foreign_cameras
from .images import MIN_SIDE, downscale_with_alpha, fit_size, read_header, read_pixels
from .model import Capture, CaptureSummary, CaptureWarning, View
from .sfm import estimate_cameras
from .source import MOST_VIEWS, SourceModel
from .transforms import find_transforms, read_transforms
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
    model = read_cameras(folder, reporter, adjusted=True)
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
        found.append(CaptureWarning("few-views", f"{where}: only {views} views; expect gaps, thirty or more work well"))
    if not points:
        what = "no sparse points; training starts from points where the photographs agree"
        found.append(CaptureWarning("no-points", f"{where}: {what}"))
    return tuple(found)


def _warn_about_cameras(model: SourceModel) -> None:
    model.warnings.extend(warnings_of_cameras(model.file, len(model.views), len(model.points)))


def _warn_about_alpha(model: SourceModel, views: list[View]) -> None:
    transparent = sum(view.alpha is not None for view in views)
    if transparent:
        model.warn("alpha", f"{model.file}: {transparent} photographs have transparent pixels")


def _by_frequency(sizes: Counter[tuple[int, int]]) -> tuple[tuple[int, int, int], ...]:
    return tuple((width, height, count) for (width, height), count in sizes.most_common())


MIN_VIEWS = 2


def read_cameras(path: Path, reporter: Reporter | None = None, *, adjusted: bool = False) -> SourceModel | None:
    """The cameras of a capture, or None for a folder of photographs without any.

    Where there are a COLMAP model and a transforms.json, COLMAP is taken if it has as many views, because it brings
    points; the two are never mixed, since their world frames differ.

    Args:
        path: a capture folder, a COLMAP model's folder, or a transforms.json.
        reporter: told how far the points of a COLMAP model are read.
        adjusted: see `read_colmap`.

    Raises:
        InputError: nothing is there, or a camera file is damaged.
    """
    if is_file(path) and path.suffix.lower() == ".json":
        return _with_enough_views(read_transforms(path))
    if not is_there(path):
        raise InputError("no such file or folder", where=path, remedy="check the path and its permissions")
    if not is_folder(path):
        raise InputError("not a capture", where=path, remedy="give the folder with the photographs")
    transforms_file = find_transforms(path)
    colmap_folder = find_colmap(path, search=transforms_file is None)
    colmap = read_colmap(colmap_folder, reporter, adjusted=adjusted) if colmap_folder else None
    transforms = read_transforms(transforms_file) if transforms_file else None
    if colmap and transforms:
        return _with_enough_views(colmap if len(colmap.views) >= len(transforms.views) else transforms)
    model = colmap or transforms
    return _with_enough_views(model) if model else None


def photographs_without_cameras(folder: Path, *, sfm: bool) -> tuple[Path, list[str]]:
    """The folder of the photographs whose cameras are to be estimated, and their names in it.

    It is ``images`` in a capture folder that has one, so masks, depths or smaller copies beside it do not take part.

    Raises:
        InputError: there are none, too few or too many, one has an unusable name or is a link out of the folder, or
            `sfm` is off.
    """
    subfolders = (folder / name for name in IMAGE_FOLDERS)
    photographs = next((subfolder for subfolder in subfolders if subfolder.is_dir()), folder)
    names = list_images(photographs)
    count = f"{len(names):,} photographs"
    what = remedy = ""
    if not names and (unreadable := list_images(photographs, FOREIGN_EXTENSIONS)):
        what = f"no photographs that can be read, only {quote_first(unreadable)}"
        remedy = "export them, or a video's frames, as JPEG, PNG or TIFF"
    elif not names:
        what, remedy = "no photographs and no cameras found", "give the folder with the photographs"
    elif not sfm and (cameras := find_foreign_cameras(folder)):
        file = cameras.file.relative_to(folder).as_posix()
        what = f"{count}, and cameras of {cameras.program} ({file}), which are not read"
        remedy = f"{cameras.remedy}, or add --sfm to estimate new ones"
    elif not sfm:
        what = f"{count} but no cameras (COLMAP model or transforms.json)"
        remedy = "add --sfm to estimate the cameras"
    elif len(names) < MIN_VIEWS:
        what, remedy = "only one photograph", "give at least two, better thirty"
    elif len(names) > MOST_VIEWS:
        what, remedy = f"{count}, the limit is {MOST_VIEWS:,}", "split the capture"
    if what:
        raise InputError(what, where=folder, remedy=remedy)
    for name in names:
        resolve_inside(photographs, name, where=folder, root=folder)
    return photographs, names


def _with_enough_views(model: SourceModel) -> SourceModel:
    if len(model.views) >= MIN_VIEWS:
        return model
    found = "only one view" if model.views else "no view"
    missing = [warning.message for warning in model.warnings if warning.name == "missing-images"]
    detail = f"; {missing[0]}" if missing else ""
    raise InputError(
        f"{found} with a camera and an image{detail}",
        where=model.file,
        remedy="a reconstruction needs at least two; put the images beside their camera file",
    )


def write_thumbnails(capture: Path, folder: Path, *, count: int, size: int, sfm: bool = False) -> list[Path]:
    """Write PNG files of the first `count` photographs, `size` pixels the longer side; returns their paths.

    Args:
        capture: as for `read_capture`.
        folder: where to; made when it is missing.
        sfm: accept photographs without cameras.

    Raises:
        InputError: as `read_capture`.
        OSError: the folder cannot be written.
    """
    paths = []
    for number, (photograph, upright) in enumerate(islice(_photographs(capture, sfm), count)):
        image, alpha = read_pixels(photograph, upright=upright)
        width, height = fit_size(image.shape[1], image.shape[0], size)
        image, alpha = downscale_with_alpha(image, alpha, width, height)
        paths.append(folder / f"{number}.png")
        write_png(paths[-1], image, alpha)
    return paths


def _photographs(capture: Path, sfm: bool) -> list[tuple[Path, bool]]:
    """Every photograph, and whether its EXIF orientation is applied."""
    model = read_cameras(capture)
    if model is None:
        folder, names = photographs_without_cameras(capture, sfm=sfm)
        return [(folder / name, True) for name in names]
    return [(plan.source.path, plan.upright) for plan in plan_views(model, max_size=None)]
