"""From a capture folder to a `Capture`, or to a summary of it."""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..files.images import write_png
from ..files.untrusted import is_file, is_folder, is_there
from ..intake.kinds import is_video, kind_of_file
from ..intake.panoramas import refuse_panorama
from ..intake.video import read_video_header, some_frames
from ..runtime.protocol import Reporter
from ..settings import AUTO, ESTIMATE, GIVEN
from .colmap import find_colmap, read_colmap
from .foreign import find_foreign_cameras, way_round
from .images import MIN_SIDE, read_header, read_pixels
from .masks import find_masks, usable_views, warn_about_unused
from .material import (
    Material,
    describe,
    find_material,
    make_photographs,
    masks_of,
    named_after,
    renamed,
    unpacked,
)
from .model import MIN_VIEWS, Capture, CaptureSummary, CaptureWarning, View
from .origin import warn_about_origin
from .scaling import downscale_with_alpha, fit_size
from .sfm import estimate_cameras
from .sfm_job import SfmSettings
from .source import MOST_VIEWS, SourceModel
from .tag_scale import metres_per_unit
from .transforms import find_nested_transforms, find_transforms, read_transforms
from .upright import DOWN_IS_Y, find_up, rotation_to
from .views import STAGE, find_again, plan_views, read_views

# Below this a reconstruction has to guess what lies between the views.
_FEW_VIEWS = 10
_TAG_SIZE = 1600  # pixels of the longer side, in which tags are looked for
_AT_ONCE = 4  # photographs of that size


def inspect_capture(folder: str | Path, *, cameras: str = AUTO, reporter: Reporter | None = None) -> CaptureSummary:
    """What `read_capture` would read, from camera files and image headers alone.

    Args:
        folder: as for `read_capture`.
        cameras: as for `read_capture`; what would be estimated is counted alone.
        reporter: told of progress where there are many points.

    Raises:
        InputError: as `read_capture`, except for damage to pixels.
    """
    given = Path(folder)
    with unpacked(given, reporter) as (folder, rename):
        found = _inspect(folder, cameras, reporter)
        return replace(found, source=given, warnings=renamed(found.warnings, rename))


def _inspect(folder: Path, cameras: str, reporter: Reporter | None) -> CaptureSummary:
    model = read_cameras(folder, reporter, cameras)
    if model is None:
        material = material_without_cameras(folder, cameras)
        sizes = _sizes(material)
        headers = [read_video_header(material.folder / name) for name in material.videos]
        sizes.update((header.width, header.height) for header in headers)
        seconds = sum(header.seconds for header in headers)
        count = len(material.photographs)
        return CaptureSummary(folder, "sfm", count, _by_frequency(sizes), 0, (), len(headers), seconds)
    _add_masks(model, folder)
    sizes = Counter(plan.photograph_size for plan in plan_views(model, max_size=None))
    _drop_unusable_points(model)
    _warn_about_cameras(model)
    warnings = tuple(model.warnings)
    return CaptureSummary(folder, model.format, len(model.views), _by_frequency(sizes), len(model.points), warnings)


def read_capture(
    folder: str | Path,
    *,
    max_size: int | None,
    cameras: str = AUTO,
    reporter: Reporter | None = None,
    tag_side: float | None = None,
    keep_order: bool = False,
) -> Capture:
    """Read a capture: photographs with a COLMAP model or a transforms.json, or photographs and videos alone.

    Args:
        folder: a capture folder, a COLMAP model's folder, a transforms.json, a folder of photographs or videos, a
            video, or a zip of any of these.
        max_size: longer side of the views in pixels; None keeps the photographs' size. Never enlarges. Small views take
            fewer frames of a video.
        cameras: `AUTO` takes those that are given and otherwise estimates some, `GIVEN` and `ESTIMATE` do one alone;
            anything else is the path of a COLMAP model's folder or a transforms.json.
        reporter: told of progress and of every warning.
        tag_side: of printed tags that the photographs show, in metres; the capture then has its `metres_per_unit`.
        keep_order: leave the views in the order in which the camera file lists them.

    Raises:
        InputError: nothing usable is there, or something in it is damaged; or no tag gives a scale.
    """
    folder, reporter = Path(folder), reporter or Reporter()
    if max_size is not None and max_size < MIN_SIDE:
        raise InputError(f"{max_size} pixels are too few", where="--max-size", remedy=f"give at least {MIN_SIDE}")
    reporter.status(STAGE, f"reading the cameras of {folder.name}")
    with (
        unpacked(folder, reporter) as (opened, rename),
        _source_model(opened, cameras, reporter, max_size) as model,
    ):
        plans = plan_views(model, max_size, keep_order=keep_order)
        reporter.status(STAGE, f"reading {len(plans)} photographs")
        views = usable_views(read_views(plans, reporter), model)
        metres = None if tag_side is None else metres_per_unit(_large_views(model, reporter), tag_side, folder)
    _drop_unusable_points(model)
    _warn_about_cameras(model)
    _warn_about_alpha(model, views)
    warnings = renamed(model.warnings, rename)
    for warning in warnings:
        reporter.warning(warning.name, warning.message)
    up = find_up([view.world_to_camera for view in views], model.points)
    capture = Capture(
        folder, model.format, tuple(views), model.points, model.point_colors, warnings, model.estimate, up, metres
    )
    # Estimated cameras have a world that nobody has chosen yet.
    return capture.turned(rotation_to(up.direction, DOWN_IS_Y)) if model.estimate else capture


def _large_views(model: SourceModel, reporter: Reporter) -> Iterator[View]:
    """The views in a size in which tags can be read, a few at a time."""
    plans = plan_views(replace(model, warnings=[]), _TAG_SIZE)
    for start in range(0, len(plans), _AT_ONCE):
        reporter.progress(STAGE, start / len(plans), "looking for tags")
        yield from read_views(plans[start : start + _AT_ONCE], Reporter())


@contextmanager
def _source_model(folder: Path, cameras: str, reporter: Reporter, max_size: int | None) -> Iterator[SourceModel]:
    """The cameras that the folder gives, else estimated ones while their temporary files exist."""
    model = read_cameras(folder, reporter, cameras, adjusted=True)
    if model is not None:
        _add_masks(model, folder)
        _add_again(model, folder)
        yield model
        return
    material = material_without_cameras(folder, cameras)
    _sizes(material)  # refuses what should not be decoded, before anything does
    if cameras == AUTO:
        reporter.warning("cameras-estimated", f"no cameras are given; those of {describe(material)} are estimated")
    with ExitStack() as stack:
        temporary = stack.enter_context(tempfile.TemporaryDirectory(prefix="cvdgs-sfm-"))
        workspace, extracted = Path(temporary, "estimation"), Path(temporary, "photographs")
        rename = stack.enter_context(named_after(folder, str(extracted)))
        workspace.mkdir()
        extracted.mkdir()
        photographs = make_photographs(material, extracted, reporter, max_size)
        found = masks_of(material)
        originals = photographs.originals.items()
        masks = {name: found.files[original] for name, original in originals if original in found.files}
        settings = SfmSettings.for_views(max_size)
        model = estimate_cameras(photographs.folder, photographs.names, workspace, reporter, settings, masks, folder)
        if is_folder(folder):  # what lies beside one video may belong to others
            warn_about_unused(model, found)
        model.views = [replace(view, time=photographs.times.get(view.name)) for view in model.views]
        if photographs.folder != extracted:  # converted ones lie elsewhere
            _add_again(model, folder)
        model.warnings = [*photographs.warnings, *renamed(model.warnings, rename)]
        yield model


def _add_masks(model: SourceModel, folder: Path) -> None:
    """Give the views the masks that lie beside them, unless the camera file names others."""
    without = {view.name: view.path for view in model.views if view.mask is None}
    found = find_masks(folder, without)
    model.views = [replace(view, mask=view.mask or found.files.get(view.name)) for view in model.views]
    named = {view.mask.resolve() for view in model.views if view.mask is not None}
    if not named - {path.resolve() for path in found.files.values()}:  # a camera file that names masks knows best
        warn_about_unused(model, found)


def _add_again(model: SourceModel, folder: Path) -> None:
    """Give the views the second photographs that lie beside them."""
    found = find_again(folder, {view.name: view.path for view in model.views})
    model.views = [replace(view, again=found.get(view.name)) for view in model.views]


def _sizes(material: Material) -> Counter[tuple[int, int]]:
    """How many of the photographs are (width, height) upright.

    Raises:
        InputError: one is no image, beyond the limits, or all around.
    """
    sizes: Counter[tuple[int, int]] = Counter()
    for path in (material.folder / name for name in material.photographs):
        size = read_header(path).upright_size
        refuse_panorama(path, size)
        sizes[size] += 1
    return sizes


def _drop_unusable_points(model: SourceModel) -> None:
    usable = np.isfinite(model.points).all(axis=1)
    if not usable.all():
        model.warn("unusable-points", f"{model.file}: {np.count_nonzero(~usable)} points are not finite and left out")
        model.points, model.point_colors = model.points[usable], model.point_colors[usable]


def warnings_of_cameras(where: Path, views: int, points: int) -> tuple[CaptureWarning, ...]:
    """What so many views and sparse points in `where` are too few for."""
    found = []
    if views < _FEW_VIEWS:
        found.append(CaptureWarning("few-views", f"Only {views} photographs: expect gaps. 30 or more work well."))
    if not points:
        what = "no sparse points; training starts from points where the photographs agree"
        found.append(CaptureWarning("no-points", f"{where}: {what}"))
    return tuple(found)


def _warn_about_cameras(model: SourceModel) -> None:
    model.warnings.extend(warnings_of_cameras(model.file, len(model.views), len(model.points)))
    warn_about_origin(model)


def _warn_about_alpha(model: SourceModel, views: list[View]) -> None:
    transparent = sum(view.alpha is not None for view in views)
    if transparent:
        model.warn("alpha", f"{model.file}: {transparent} photographs have transparent pixels")


def _by_frequency(sizes: Counter[tuple[int, int]]) -> tuple[tuple[int, int, int], ...]:
    return tuple((width, height, count) for (width, height), count in sizes.most_common())


def read_cameras(
    path: Path, reporter: Reporter | None = None, cameras: str = AUTO, *, adjusted: bool = False
) -> SourceModel | None:
    """The cameras of a capture, or None for photographs and videos whose cameras are to be estimated.

    Where there are a COLMAP model and a transforms.json, COLMAP is taken if it has as many views, because it brings
    points; the two are never mixed, since their world frames differ.

    Args:
        path: a capture folder, a COLMAP model's folder, or a transforms.json.
        reporter: told how far the points of a COLMAP model are read.
        cameras: as for `read_capture`.
        adjusted: see `read_colmap`.

    Raises:
        InputError: nothing is there, or a camera file is damaged.
    """
    if cameras not in (AUTO, ESTIMATE, GIVEN):
        return _with_enough_views(_read_camera_file(Path(cameras), path, reporter, adjusted))
    if cameras == ESTIMATE or (is_file(path) and is_video(path)):
        return None
    if is_file(path) and path.suffix.lower() == ".json":
        return _with_enough_views(read_transforms(path))
    if not is_there(path):
        raise InputError("no such file or folder", where=path, remedy="check the path and its permissions")
    if not is_folder(path):
        if is_file(path) and kind_of_file(path) == "video":
            return None
        remedy = way_round(path) or "give a video, a zip or the folder with the photographs"
        raise InputError("not a capture", where=path, remedy=remedy)
    transforms_file = find_transforms(path)
    colmap_folder = find_colmap(path, search=transforms_file is None)
    if not transforms_file and not colmap_folder and (transforms_file := find_nested_transforms(path)):
        colmap_folder = find_colmap(transforms_file.parent, search=False)
    colmap = read_colmap(colmap_folder, reporter, adjusted=adjusted) if colmap_folder else None
    transforms = read_transforms(transforms_file, root=path) if transforms_file else None
    if colmap and transforms:
        return _with_enough_views(colmap if len(colmap.views) >= len(transforms.views) else transforms)
    model = colmap or transforms
    return _with_enough_views(model) if model else None


def material_without_cameras(path: Path, cameras: str) -> Material:
    """The photographs and videos whose cameras are to be estimated.

    Raises:
        InputError: as `find_material`; or there are too few or too many, cameras of another program beside them, or
            only given ones are wanted.
    """
    material = find_material(path)
    count = describe(material)
    what = remedy = ""
    if cameras != ESTIMATE and is_folder(path) and (foreign := find_foreign_cameras(path)):
        file = foreign.file.relative_to(path).as_posix()
        what = f"{count}, and cameras of {foreign.program} ({file}), which are not read"
        remedy = f"{foreign.remedy}, or add --cameras estimate to estimate new ones"
    elif cameras == GIVEN:
        what = f"{count} but no cameras (COLMAP model or transforms.json)"
        remedy = "leave out --cameras given to estimate them"
    elif not material.videos and len(material.photographs) < MIN_VIEWS:
        copies = f", and {len(material.copies)} more of it" if material.copies else ""
        what, remedy = f"only one photograph{copies}", "give at least two, better thirty"
    elif len(material.photographs) > MOST_VIEWS:
        what, remedy = f"{count}, the limit is {MOST_VIEWS:,}", "split the capture"
    if what:
        raise InputError(what, where=path, remedy=remedy)
    return material


def _read_camera_file(file: Path, capture: Path, reporter: Reporter | None, adjusted: bool) -> SourceModel:
    """The cameras in `file`, a COLMAP model's folder or a transforms.json, for the photographs in `capture`."""
    wanted = "give a COLMAP model's folder or a transforms.json"
    if not is_there(file):
        raise InputError(f"{file}: no such file or folder", where="--cameras", remedy=wanted)
    if not is_folder(capture):
        remedy = "give the folder with the photographs that the cameras were estimated from"
        raise InputError("a camera file is for photographs, not for a video", where=capture, remedy=remedy)
    if is_file(file) and file.suffix.lower() == ".json":
        return read_transforms(file, capture)
    found = find_colmap(file) if is_folder(file) else None
    if found is not None:
        return read_colmap(replace(found, root=capture), reporter, adjusted=adjusted)
    transforms = find_transforms(file) if is_folder(file) else None
    if transforms is None:
        raise InputError(f"{file}: holds no cameras", where="--cameras", remedy=wanted)
    return read_transforms(transforms, capture)


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


def write_thumbnails(capture: Path, folder: Path, *, count: int, size: int, cameras: str = AUTO) -> list[Path]:
    """Write PNG files of the first `count` photographs, `size` pixels the longer side; returns their paths.

    Args:
        capture, cameras: as for `read_capture`. Of a video, frames from all its length.
        folder: where to; made when it is missing.

    Raises:
        InputError: as `read_capture`.
        OSError: the folder cannot be written.
    """
    paths = []
    with unpacked(capture) as (opened, _):
        for number, (image, alpha) in enumerate(islice(_pictures(opened, cameras, count), count)):
            width, height = fit_size(image.shape[1], image.shape[0], size)
            image, alpha = downscale_with_alpha(image, alpha, width, height)
            paths.append(folder / f"{number}.png")
            write_png(paths[-1], image, alpha)
    return paths


def _pictures(capture: Path, cameras: str, count: int) -> Iterator[tuple[NDArray[np.uint8], NDArray[np.uint8] | None]]:
    """Every photograph upright, then `count` frames of every video."""
    model = read_cameras(capture, cameras=cameras)
    if model is not None:
        yield from (read_pixels(plan.source.path, upright=plan.upright) for plan in plan_views(model, max_size=None))
        return
    material = material_without_cameras(capture, cameras)
    yield from (read_pixels(material.folder / name, upright=True) for name in material.photographs)
    for name in material.videos:
        yield from ((image, None) for image in some_frames(material.folder / name, count))
