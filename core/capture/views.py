"""Reads, scales and undistorts the photographs of a capture, a few at a time."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..files.untrusted import is_file
from ..intake.raw import Development
from ..runtime.protocol import Reporter
from .files import IMAGE_FOLDERS, make_keys, natural_key, resolve_inside, shared_root
from .images import MIN_SIDE, ImageHeader, apply_orientation, read_header, read_pixels, upright_rotation
from .masks import as_shown, read_mask, resized_mask
from .model import PinholeCamera, View
from .scaling import downscale_with_alpha, fit_size, same_aspect
from .source import SourceModel, SourceView
from .undistort import Undistorter

STAGE = "capture"
SECOND_FOLDER = "images_again"
"""Beside one of `IMAGE_FOLDERS`: second photographs from the same places, of the same names."""
# One decoder a core; decoded photographs are what costs memory.
_DECODERS = 2
# Above this size one photograph is decoded at a time.
_LARGE_PIXELS = 50_000_000
_SIZES_TOLD = 3


@dataclass(frozen=True)
class ViewPlan:
    """How one photograph becomes a view.

    Attributes:
        upright: whether the EXIF orientation is applied.
        turned: whether it is applied to the view at the end, camera and all.
        width, height: of the view before that.
    """

    key: str
    source: SourceView
    header: ImageHeader
    upright: bool
    turned: bool
    width: int
    height: int

    @property
    def photograph_size(self) -> tuple[int, int]:
        """(width, height) of the photograph as it is used."""
        if self.upright or self.turned:
            return self.header.upright_size
        return self.header.width, self.header.height


def find_again(capture: Path, photographs: Mapping[str, Path]) -> dict[str, Path]:
    """The second photographs in `SECOND_FOLDER`, by the names of the first.

    Args:
        capture: the capture, or what of it was given.
        photographs: files by name; those that lie directly in one of `IMAGE_FOLDERS` can have second ones.

    Raises:
        InputError: one is no regular file, or a link out of the folder that holds `SECOND_FOLDER`.
    """
    paths = {name: Path(os.path.abspath(path)) for name, path in photographs.items()}
    root = shared_root(capture, paths.values())
    found = {}
    for name, path in paths.items():
        above = path.parent.parent
        folder = above / SECOND_FOLDER
        if path.parent.name in IMAGE_FOLDERS and above.is_relative_to(root) and is_file(folder / path.name):
            found[name] = resolve_inside(folder, path.name, where=folder, root=above)
    return found


def plan_views(model: SourceModel, max_size: int | None, *, keep_order: bool = False) -> list[ViewPlan]:
    """Decide orientation, size and key of every view; reads image headers alone.

    They are in natural order of the files that `write_capture` makes of them, so what it wrote has the same order. That
    is nearly always the order of the names.

    Args:
        keep_order: leave them in the order of the model instead.

    Raises:
        InputError: an image's size is beyond the limits or does not fit its camera.
    """
    sources = model.views if keep_order else sorted(model.views, key=lambda view: natural_key(view.name))
    keys = make_keys([view.name for view in sources])
    plans = [_plan_view(key, view, max_size) for key, view in zip(keys, sources, strict=True)]
    if not keep_order:
        plans.sort(key=lambda plan: natural_key(f"{plan.key}.png"))
    rotated = sum((plan.upright or plan.turned) and plan.header.orientation != 1 for plan in plans)
    if rotated:
        model.warn("exif-rotated", f"{model.file}: {rotated} photographs are rotated upright as their EXIF data says")
    paged = sum(plan.header.has_pages for plan in plans)
    if paged:
        model.warn(
            "several-pages", f"{model.file}: {paged} photographs have several pages or frames; the first is used"
        )
    foreign = Counter(plan.header.color_profile for plan in plans if plan.header.is_foreign)
    if foreign:
        model.warn(
            "color-profile",
            f"{model.file}: {foreign.total()} photographs are not sRGB but {', '.join(foreign)}; treated as sRGB, "
            "convert them first for exact colours",
        )
    sizes = Counter(plan.photograph_size for plan in plans)
    if len(sizes) > 1:
        told = sizes.most_common(_SIZES_TOLD)
        listed = ", ".join(f"{width} x {height} ({count})" for (width, height), count in told)
        rest = f" and {len(sizes) - len(told)} more" if len(sizes) > len(told) else ""
        model.warn("mixed-sizes", f"{model.file}: photographs of {len(sizes)} sizes: {listed}{rest}")
    return plans


def read_views(plans: Sequence[ViewPlan], reporter: Reporter) -> list[View]:
    """Read the views in order; at most two photographs are held at their full size.

    Raises:
        InputError: a photograph is damaged or its distortion cannot be undone.
    """
    largest = max(plan.header.width * plan.header.height for plan in plans)
    workers = 1 if largest > _LARGE_PIXELS else _DECODERS
    undistorter = Undistorter()
    development = Development.common([plan.source.path for plan in plans])
    views: list[View] = []
    with ThreadPoolExecutor(workers, thread_name_prefix="capture") as pool:
        try:
            for view in pool.map(lambda plan: _read_view(plan, undistorter, development), plans):
                views.append(view)
                reporter.progress(STAGE, len(views) / len(plans), f"photograph {len(views)} of {len(plans)}")
        except BaseException:
            # Cancelled or damaged: do not decode the rest first.
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    return views


def _plan_view(key: str, view: SourceView, max_size: int | None) -> ViewPlan:
    header = read_header(view.path)
    upright = _needs_turning(view, header)
    width, height = fit_size(*(header.upright_size if upright else (header.width, header.height)), max_size)
    if min(width, height) < MIN_SIDE:
        raise InputError(
            f"the image would be {width} x {height} pixels after scaling, at least {MIN_SIDE} a side are needed",
            where=view.path,
            remedy="give a larger --max-size",
        )
    # Mirrored photographs stay as they are: no camera could have taken them upright.
    turned = view.estimated and upright_rotation(header.orientation) is not None
    return ViewPlan(key, view, header, upright, turned, width, height)


def _needs_turning(view: SourceView, header: ImageHeader) -> bool:
    """Whether the EXIF orientation has to be applied for the photograph to be what its camera describes.

    Raises:
        InputError: the photograph fits its camera neither as stored nor turned.
    """
    if not view.size_known:
        return True
    if view.estimated:
        return False
    expected = (view.camera.width, view.camera.height)
    stored = (header.width, header.height)
    # Exact sizes first: a nearly square photograph fits both ways within the rounding.
    if expected == stored:
        return False
    if expected == header.upright_size:
        return True
    if same_aspect(expected, stored):
        return False
    if same_aspect(expected, header.upright_size):
        return True
    raise InputError(
        f"the image is {stored[0]} x {stored[1]} pixels but its camera is for {expected[0]} x {expected[1]}",
        where=view.path,
        remedy="use the images that the cameras were estimated from, or uniformly scaled copies",
    )


def _read_view(plan: ViewPlan, undistorter: Undistorter, development: Development | None) -> View:
    camera, image, alpha = _read_photograph(plan, plan.source.path, undistorter, development)
    second = _second_photograph(plan)
    again = None if second is None else _read_photograph(plan, second, undistorter, development)[1]
    view = View(
        *(plan.key, plan.source.path, camera, plan.source.world_to_camera, image, alpha, again, plan.source.time),
        mask=_read_mask(plan, undistorter),
        smear=None if plan.source.smear is None else plan.source.smear * (camera.width / plan.source.camera.width),
    )
    return _turn_upright(view, plan.header.orientation) if plan.turned else view


def _read_photograph(
    plan: ViewPlan, path: Path, undistorter: Undistorter, development: Development | None
) -> tuple[PinholeCamera, NDArray[np.uint8], NDArray[np.uint8] | None]:
    image, alpha = read_pixels(path, upright=plan.upright, development=development)
    image, alpha = downscale_with_alpha(image, alpha, plan.width, plan.height)
    return undistorter.apply(plan.source.camera, image, alpha, where=path)


def _read_mask(plan: ViewPlan, undistorter: Undistorter) -> NDArray[np.bool_] | None:
    if plan.source.mask is None:
        return None
    mask = resized_mask(read_mask(plan.source.mask, plan.header, upright=plan.upright), plan.width, plan.height)
    return as_shown(undistorter.apply_to_mask(plan.source.camera, mask, where=plan.source.mask))


def _second_photograph(plan: ViewPlan) -> Path | None:
    """The second photograph, if it has the size of the first."""
    second = plan.source.again
    if second is None:
        return None
    header = read_header(second)
    return second if (header.width, header.height) == (plan.header.width, plan.header.height) else None


def _turn_upright(view: View, orientation: int) -> View:
    """`view` with its picture, its intrinsics and its pose turned as an EXIF orientation that does not mirror says."""
    steps = upright_rotation(orientation)
    if steps is None or orientation == 1:
        return view
    camera = view.camera
    corner = np.abs(steps) @ (camera.width, camera.height)
    focal_x, focal_y = np.abs(steps) @ (camera.fx, camera.fy)
    # What points against its axis after the turn is counted from the other side.
    center_x, center_y = steps @ (camera.cx, camera.cy) + np.where(steps.sum(axis=1) < 0.0, corner, 0.0)
    width, height = (int(side) for side in corner)
    roll = np.eye(4)
    roll[:2, :2] = steps
    return replace(
        view,
        camera=PinholeCamera(width, height, float(focal_x), float(focal_y), float(center_x), float(center_y)),
        world_to_camera=roll @ view.world_to_camera,
        image=apply_orientation(view.image, orientation),
        alpha=None if view.alpha is None else apply_orientation(view.alpha, orientation),
        again=None if view.again is None else apply_orientation(view.again, orientation),
        mask=None if view.mask is None else apply_orientation(view.mask, orientation),
    )
