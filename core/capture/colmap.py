"""COLMAP models in a capture folder: which there are, where their images lie, and what of them is used."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np
import pycolmap

from ..errors import InputError
from ..files.untrusted import is_file
from ..runtime.protocol import Reporter
from .colmap_files import ColmapModel, read_model
from .colmap_text import lists_poses
from .files import (
    IMAGE_FOLDERS,
    MODEL_FOLDERS,
    Spelling,
    capture_root,
    is_in_masks,
    list_images,
    quote_first,
    resolve_inside,
)
from .masks import masks_among
from .shared_lens import describe, may_share_lens, share_lens
from .source import SourceModel, SourceView, rigid_pose
from .undistort import is_pinhole

# Elsewhere it is looked for: ``dense/0/sparse`` of COLMAP's reconstructor, ``data/scene/colmap/sparse/0`` of a project.
SEARCHED_DEPTH = 5
# Of folders with pictures of the photographs' names that are none.
_NO_PHOTOGRAPHS = ("mask", "depth", "normal", "segment")
# In the names of folders with photographs whose distortion is gone: ScanNet++'s resized_undistorted_images.
_UNDISTORTED = "undistort"
MAX_ANAMORPHISM = 10.0  # anamorphic lenses squeeze by 2; beyond this the file is wrong


@dataclass(frozen=True)
class ColmapFolder:
    """A COLMAP model and the capture it belongs to.

    Attributes:
        root: the capture folder.
        model: the folder of the model files.
        others: further sub-models beside it.
    """

    root: Path
    model: Path
    others: tuple[Path, ...] = ()


def find_colmap(folder: Path, *, search: bool = True) -> ColmapFolder | None:
    """The COLMAP model of the capture in `folder`, which may also be the model's own folder (``scene/sparse/0``).

    Args:
        folder: where to look.
        search: look into all its folders where the usual ones have none.

    Raises:
        InputError: there are several captures.
    """
    for relative in (*MODEL_FOLDERS, "."):
        candidates = _models_in(folder / relative)
        if candidates:
            largest = max(candidates, key=_image_count)
            others = tuple(path for path in candidates if path != largest)
            root = capture_root(folder) if relative == "." else folder
            return ColmapFolder(root, largest, others)
    nested = _nested_models(folder) if search else []
    if not nested:
        return None
    refuse_several(sorted({path.relative_to(folder).parts[0] for path in nested}), folder)
    largest = max(nested, key=_image_count)
    return ColmapFolder(folder, largest, tuple(path for path in nested if path != largest))


def refuse_several(captures: Sequence[str], folder: Path) -> None:
    """Refuse a `folder` in which there are several captures with cameras, in the folders `captures`.

    Raises:
        InputError: there are.
    """
    if len(captures) > 1:
        raise InputError(
            f"{len(captures)} captures with cameras are in it: {quote_first(captures)}",
            where=folder,
            remedy="give the folder of one of them, or add --cameras estimate to estimate new ones",
        )


def read_colmap(found: ColmapFolder, reporter: Reporter | None = None, *, adjusted: bool = False) -> SourceModel:
    """Read a COLMAP model; views without a pose or an image file are left out, and counted in a warning.

    Args:
        reporter: told how far its points are read.
        adjusted: fit one lens to views that have a camera each, where `share_lens` finds it as good; takes seconds.

    Raises:
        InputError: a file is missing, cut or damaged, or a name leaves the image folder.
    """
    read = read_model(found.model, reporter, observed=adjusted)
    model = SourceModel("colmap", found.model, [])
    if found.others:
        names = quote_first(path.name for path in found.others)
        model.warn(
            "several-models", f"{found.model}: the largest of {len(found.others) + 1} models is used, not {names}"
        )
    _check_model(read, found.model)  # before the adjustment, which ends the process at a pose that is none
    if adjusted and may_share_lens(read) and (lens := share_lens(read)) and lens.views:
        model.warn("shared-lens", describe(lens, found.model))
        read = lens.model
    folder = _image_folder(found, read)
    _refuse_undistorted(folder, read, found.model)
    add_model(model, read, folder, found.root)
    return model


def add_model(model: SourceModel, read: ColmapModel, image_folder: Path, root: Path) -> None:
    """Add the images of `read` whose files exist below `image_folder`, inside `root`, and its points."""
    images = read.images
    _check_model(read, model.file)
    spelling = Spelling(image.name for image in images)
    missing = []
    reshaped = []
    for image in images:
        # As it is written first: what is refused is not looked for.
        path = resolve_inside(image_folder, image.name, where=model.file, root=root)
        if not path.exists():
            path = resolve_inside(image_folder, spelling.find(image_folder, image.name), where=model.file, root=root)
        if not path.exists():
            missing.append(image.name)
            continue
        pose, repaired = rigid_pose(image.world_to_camera, frame=image.name, where=model.file)
        if repaired:
            reshaped.append(image.name)
        model.views.append(SourceView(image.name, path, read.cameras[image.camera_id], pose))
    model.warn_about_views(sorted(missing), sorted(reshaped), len(images), image_folder)
    registered = {image.name for image in images}
    used = {view.path for view in model.views}
    names = [name for name in list_images(image_folder) if not is_in_masks(PurePosixPath(name))]
    known = registered.union(masks_among(names))
    unregistered = [name for name in names if name not in known and image_folder / name not in used]
    if unregistered:
        what = f"{len(unregistered)} photographs without cameras are left out: {quote_first(unregistered)}"
        model.warn("unregistered", f"{image_folder}: {what}")
    model.points, model.point_colors = read.points, read.point_colors


def _models_in(folder: Path) -> list[Path]:
    """`folder` itself if it holds a model, else its numbered sub-models."""
    if _is_model(folder):
        return [folder]
    if not folder.is_dir():
        return []
    numbered = sorted((path for path in folder.iterdir() if path.name.isdecimal()), key=lambda path: int(path.name))
    return [path for path in numbered if _is_model(path)]


def _nested_models(folder: Path) -> list[Path]:
    """The complete models somewhere below `folder`, not behind links or in hidden folders; the nearest ones alone."""
    level = [folder]
    for _ in range(SEARCHED_DEPTH):
        level = [path for parent in level for path in _subfolders(parent)]
        complete = [path for path in level if _is_model(path) and _image_count(path)]
        if complete:
            return complete
    return []


def _subfolders(folder: Path) -> list[Path]:
    try:
        return sorted(
            path
            for path in folder.iterdir()
            if path.is_dir() and not path.is_symlink() and not path.name.startswith(".")
        )
    except OSError:  # a folder that cannot be read holds nothing for us
        return []


def _is_model(folder: Path) -> bool:
    """Whether it holds a model, or what is left of one; a list of names called images.txt is none."""
    if any(is_file(folder / name) for name in ("images.bin", "cameras.bin", "points3D.bin")):
        return True
    images = folder / "images.txt"
    return is_file(images) and (is_file(folder / "cameras.txt") or lists_poses(images))


def _image_count(folder: Path) -> int:
    """Number of images in a binary model, whose count stands first; of a text model, its lines."""
    binary, text = folder / "images.bin", folder / "images.txt"
    if is_file(binary):
        with open(binary, "rb") as file:
            return int.from_bytes(file.read(8), "little")
    if is_file(text):
        with open(text, "rb") as file:
            return sum(not line.startswith(b"#") for line in file) // 2
    return 0


def _image_folder(found: ColmapFolder, read: ColmapModel) -> Path:
    """The folder that holds most of the registered images."""
    names = [image.name for image in read.images]
    if not names:
        raise InputError(
            "the COLMAP model has no registered image", where=found.model, remedy="run COLMAP's mapper again"
        )
    downscaled = sorted(path.name for path in found.root.glob("images_*") if path.is_dir())
    usual = [found.root / name for name in (*IMAGE_FOLDERS, *downscaled, ".")]
    # Photographs beside a model in a folder of its own are those that it was made of, or undistorted for it.
    root = found.root.resolve()
    above = [parent for parent in found.model.resolve().parents if root in parent.parents]
    beside = [parent / name for parent in above for name in IMAGE_FOLDERS]
    named = [path for parent in (found.root, *above) for path in _subfolders(parent)]
    other = [path for path in named if not any(word in path.name.lower() for word in _NO_PHOTOGRAPHS)]

    def held(folder: Path) -> int:
        return sum(is_file(folder / name.replace("\\", "/")) for name in names)

    spelling = Spelling(names)

    def held_in_any_spelling(folder: Path) -> int:
        return sum(is_file(folder / spelling.find(folder, name)) for name in names)

    for count in (held, held_in_any_spelling):
        for candidates in (beside, usual, other):
            folders = [folder for folder in candidates if folder.is_dir()]
            best = max(folders, key=count, default=None)
            if best is not None and count(best):
                return best
    return next(folder for folder in usual if folder.is_dir())


def _refuse_undistorted(folder: Path, read: ColmapModel, where: Path) -> None:
    """Refuse photographs that are called undistorted, of cameras that are not: they would be undistorted once more."""
    if _UNDISTORTED in folder.name.lower() and not all(map(is_pinhole, read.cameras.values())):
        what = f"its cameras have distortion, but the photographs ({folder.name}) are undistorted"
        remedy = "give the original photographs, or with --cameras the cameras of these"
        raise InputError(what, where=where, remedy=remedy)


def _check_model(read: ColmapModel, where: Path) -> None:
    """Refuse a model with a camera or a pose that cannot be, or with two images of one name."""
    for number, camera in read.cameras.items():
        check_camera(camera, frame=f"camera {number}", where=where)
    for image in read.images:
        rigid_pose(image.world_to_camera, frame=image.name, where=where)
    _refuse_repeated_names([image.name for image in read.images], where)


def check_camera(camera: pycolmap.Camera, *, frame: str, where: Path) -> None:
    """Refuse intrinsics that describe no perspective or fisheye camera.

    Raises:
        InputError: not finite, focal length or size not positive, focal lengths of no real lens, or a full panorama.
    """
    if camera.is_spherical():  # first: pycolmap crashes when such a camera is asked for its focal length
        remedy = "split it into perspective photographs first"
        raise InputError(f"{frame} is a full panorama", where=where, remedy=remedy)
    focal = [camera.focal_length_x, camera.focal_length_y]
    what = ""
    if not np.isfinite(camera.params).all() or min(focal) <= 0.0:
        what = f"the focal length or another parameter of {frame} is unusable"
    elif max(focal) > MAX_ANAMORPHISM * min(focal):
        what = f"the focal lengths of {frame}, {focal[0]:g} and {focal[1]:g}, differ too much"
    elif camera.width < 1 or camera.height < 1:
        what = f"{frame} has no image size"
    if what:
        raise InputError(what, where=where, remedy="export the cameras again")


def _refuse_repeated_names(names: list[str], where: Path) -> None:
    repeated = [name for name, count in Counter(names).items() if count > 1]
    if repeated:
        raise InputError(
            f"two images have the same name: {quote_first(sorted(repeated))}", where=where, remedy="keep one of them"
        )
