"""Finds the camera files of a capture and reads them."""

from __future__ import annotations

from pathlib import Path

from ..errors import InputError
from ..events import Reporter
from ..untrusted import is_file, is_folder, is_there
from .colmap import IMAGE_FOLDERS, find_colmap, read_colmap
from .files import FOREIGN_EXTENSIONS, list_images, quote_first, resolve_inside
from .foreign import find_foreign_cameras
from .source import MOST_VIEWS, SourceModel
from .transforms import find_transforms, read_transforms

MIN_VIEWS = 2


def read_cameras(path: Path, reporter: Reporter | None = None) -> SourceModel | None:
    """The cameras of a capture, or None for a folder of photographs without any.

    Where there are a COLMAP model and a transforms.json, COLMAP is taken if it has as many views, because it brings
    points; the two are never mixed, since their world frames differ.

    Args:
        path: a capture folder, a COLMAP model's folder, or a transforms.json.
        reporter: told how far the points of a COLMAP model are read.

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
    colmap = read_colmap(colmap_folder, reporter) if colmap_folder else None
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
    if not names:
        if foreign := list_images(photographs, FOREIGN_EXTENSIONS):
            what = f"no photographs that can be read, only {quote_first(foreign)}"
            raise InputError(what, where=folder, remedy="export them, or a video's frames, as JPEG, PNG or TIFF")
        raise InputError(
            "no photographs and no cameras are there", where=folder, remedy="give the folder with the photographs"
        )
    if not sfm and (foreign_cameras := find_foreign_cameras(folder)):
        file = foreign_cameras.file.relative_to(folder).as_posix()
        raise InputError(
            f"{len(names)} photographs, and cameras of {foreign_cameras.program} ({file}), which are not read",
            where=folder,
            remedy=f"{foreign_cameras.remedy}, or add --sfm to estimate new ones",
        )
    if not sfm:
        raise InputError(
            f"{len(names)} photographs but no cameras (COLMAP model or transforms.json)",
            where=folder,
            remedy="add --sfm to estimate the cameras",
        )
    if len(names) < MIN_VIEWS:
        raise InputError("one photograph only", where=folder, remedy="at least two are needed, better thirty")
    if len(names) > MOST_VIEWS:
        raise InputError(
            f"{len(names):,} photographs, the limit is {MOST_VIEWS:,}", where=folder, remedy="divide the capture"
        )
    for name in names:
        resolve_inside(photographs, name, where=folder, root=folder)
    return photographs, names


def _with_enough_views(model: SourceModel) -> SourceModel:
    if len(model.views) >= MIN_VIEWS:
        return model
    found = "one view only" if model.views else "no view"
    missing = [warning.message for warning in model.warnings if warning.name == "missing-images"]
    detail = f"; {missing[0]}" if missing else ""
    raise InputError(
        f"{found} with a camera and an image{detail}",
        where=model.file,
        remedy="a reconstruction needs at least two; put the images beside their camera file",
    )
