"""Masks of photographs: which file belongs to which photograph, and what of a view is looked at.

A mask is white where its photograph is looked at. What it leaves out is unknown, unlike what an alpha channel leaves
out, where nothing is.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field
from pathlib import Path, PurePath, PurePosixPath
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..files.untrusted import is_file, is_folder
from ..runs.layout import MASKS_FOLDER
from .files import IMAGE_FOLDERS, Spelling, list_images, quote_first, resolve_inside, shared_root
from .images import ImageHeader, apply_orientation, read_pixels
from .model import View
from .scaling import same_aspect
from .source import SourceModel

LEAST_SHOWN = 0.01
"""Share of a photograph that has to be looked at for it to be of use."""

_WHITE = 128  # of 255: from which a mask's pixel is looked at
_WHOLLY = 0.999  # of a pixel, or of its neighbourhood: a share of a moving thing would colour it
_BACK = {6: 8, 8: 6}  # the EXIF orientations that do not undo themselves, and those that undo them
_EXTENSIONS = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".webp", ".bmp")
_MISNAMED_FOLDER = "mask"
_BESIDE_MISNAMED = "image"  # in NeuS's data, where image/000001.png has the mask mask/001.png
# In the folder of their photograph, {stem}{suffix}: COLMAP's, RealityScan's two, Metashape's and instant-ngp's, which
# are white where nothing is looked at.
_INVERTED = "dynamic_mask_"
_BESIDE = ("{0}{1}.png", "{0}{1}.mask.png", "{0}.mask.png", "{0}_mask.png", _INVERTED + "{0}.png")

_Path = TypeVar("_Path", bound=PurePath)


@dataclass(frozen=True)
class FoundMasks:
    """The masks that lie beside photographs.

    Attributes:
        files: by the photograph's name.
        unused: names of pictures in these folders that belong to no photograph.
        misnamed: folders with masks of the photographs that are called ``mask``, and are not used.
        misplaced: names of masks that lie among the photographs, and are not used.
    """

    files: dict[str, Path]
    unused: list[str]
    misnamed: list[Path]
    misplaced: list[str] = field(default_factory=list)


def find_masks(capture: Path, photographs: Mapping[str, Path]) -> FoundMasks:
    """The masks in ``masks/`` beside the photographs' folder, called ``<name>.<extension>.png`` or ``<name>.png``.

    They may lie in ``masks/`` in the photographs' folder, too, whose name may be in upper case, and may also be JPEG,
    TIFF, WebP or BMP files; PNG is taken first.

    Args:
        capture: the capture, or what of it was given.
        photographs: files by name.

    Raises:
        InputError: a mask is no regular file, or a link out of the folder that holds ``masks``.
    """
    paths = {name: Path(os.path.abspath(path)) for name, path in photographs.items()}
    if not paths:
        return FoundMasks({}, [], [])
    root = shared_root(capture, paths.values())
    files: dict[str, Path] = {}
    photographs_of: dict[Path, list[Path]] = {}  # relative to a folder in which their masks may lie
    folders: dict[Path, bool] = {}
    spelling = Spelling()
    for name, path in paths.items():
        for beside, relative in _places(path, root):
            folder = beside / spelling.find(beside, MASKS_FOLDER)
            photographs_of.setdefault(folder, []).append(relative)
            if folder not in folders:
                folders[folder] = is_folder(folder)
            found = _mask_in(folder, relative) if folders[folder] and name not in files else None
            if found and found != path:
                files[name] = found
    taken = set(paths.values())
    known = taken.union(files.values())
    inside = [folder for folder, exists in folders.items() if exists]
    unused = [name for folder in inside for name in list_images(folder) if folder / name not in known]
    others = {folder.with_name(_MISNAMED_FOLDER): relative for folder, relative in photographs_of.items()}
    misnamed = [folder for folder, relative in others.items() if _has_masks(folder, relative, taken)]
    lying = dict.fromkeys(_lying_beside(paths.values()))
    misplaced = [path.name for path in lying if path not in known and is_file(path)]
    return FoundMasks(files, unused, misnamed, misplaced)


def masks_among(names: Sequence[str]) -> set[str]:
    """Which of the pictures `names`, relative to a capture, are by their names masks of others of them.

    They lie beside their photograph, or in a folder called ``mask``, whatever they are called if ``image`` is beside
    that. What else has no photograph is one itself.
    """
    paths = {name: PurePosixPath(name) for name in names}
    folders = {path.parent for path in paths.values()}
    misnamed = {folder for folder in folders if _MISNAMED_FOLDER in (part.lower() for part in folder.parts)}
    others = [path for path in paths.values() if path.parent not in misnamed]
    wanted = {path.as_posix().lower() for path in _lying_beside(paths.values())}
    named = [path for path in paths.values() if path.parent.name.lower() == _MISNAMED_FOLDER]
    wanted.update(path.as_posix().lower() for path in named if path.parent.with_name(_BESIDE_MISNAMED) in folders)
    if misnamed:
        places = (place for path in others for place in _places(path, PurePosixPath()))
        wanted.update(
            (beside / _MISNAMED_FOLDER / name).as_posix().lower()
            for beside, relative in places
            for name in _mask_names(relative)
        )
    return {name for name in names if name.lower() in wanted}


def _lying_beside(photographs: Iterable[_Path]) -> Iterator[_Path]:
    """What masks in the folders of their photographs are called."""
    for path in photographs:
        yield from (path.with_name(form.format(path.stem, path.suffix)) for form in _BESIDE)


def _places(photograph: _Path, root: _Path) -> list[tuple[_Path, _Path]]:
    """Folders whose ``masks`` may hold the mask of a photograph, and the photograph's name in each of these."""
    above = [folder for folder in photograph.parents if folder.is_relative_to(root)]
    names = [(folder, folder.name.lower()) for folder in above]
    named = [folder for folder, name in names if name in IMAGE_FOLDERS or name.startswith("images_")][:1]
    beside = [*named, *(folder for folder in above[:1] if folder != root)]
    places = [(folder.parent, photograph.relative_to(folder)) for folder in beside]
    inside = [(folder, photograph.relative_to(folder)) for folder in beside]
    return [*places, (root, photograph.relative_to(root)), *inside]


def _mask_names(photograph: PurePath) -> Iterator[str]:
    for extension in _EXTENSIONS:
        yield f"{photograph.as_posix()}{extension}"
        yield photograph.with_suffix(extension).as_posix()


def _mask_in(folder: Path, photograph: Path) -> Path | None:
    for name in _mask_names(photograph):
        if is_file(folder / name) or (folder / name).is_symlink():
            return resolve_inside(folder, name, where=folder, root=folder.parent)
    return None


def _has_masks(folder: Path, photographs: list[Path], taken: Set[Path]) -> bool:
    """Whether `folder` has a mask of any of the photographs that is not `taken` for a photograph itself."""
    names = (name for path in photographs for name in _mask_names(path)) if is_folder(folder) else ()
    return any(folder / name not in taken and is_file(folder / name) for name in names)


def warn_about_unused(model: SourceModel, found: FoundMasks) -> None:
    """Note masks that belong to no photograph, or lie in a folder of another name."""
    if found.unused:
        what = f"{len(found.unused)} masks belong to no photograph and are not used: {quote_first(found.unused)}"
        model.warn("masks-unused", f"{model.file}: {what}")
    for folder in found.misnamed:
        model.warn("masks-unused", f"{folder}: the masks in it are not used; call the folder {MASKS_FOLDER}")
    if found.misplaced:
        what = f"{len(found.misplaced)} masks among the photographs are not used: {quote_first(found.misplaced)}"
        inverted = any(PurePosixPath(name).name.startswith(_INVERTED) for name in found.misplaced)
        way = f"put them into a folder {MASKS_FOLDER}{', inverted' if inverted else ''}"
        model.warn("masks-unused", f"{model.file}: {what}; {way}, as 1.png for 1.jpg")


def read_mask(path: Path, header: ImageHeader, *, upright: bool) -> NDArray[np.uint8]:
    """(H, W) of 255 and 0, of the photograph's proportions, 255 where it is looked at.

    Args:
        path: the mask.
        header: of its photograph. The mask may be as stored or, where that shows in its size, upright.
        upright: whether the result is to be.

    Raises:
        InputError: no image, damaged, of other proportions than the photograph, or grey without any white.
    """
    pixels, alpha = read_pixels(path, min_side=1)
    height, width = pixels.shape[:2]
    stored = same_aspect((header.width, header.height), (width, height))
    if not stored and not same_aspect(header.upright_size, (width, height)):
        raise InputError(
            f"the mask is {width} x {height} pixels, its photograph {header.width} x {header.height}",
            where=path,
            remedy="export it in the size of the photograph",
        )
    brightness = pixels.min(axis=2)
    if 0 < int(brightness.max()) < _WHITE:
        raise InputError(
            f"the mask has no white, only values up to {brightness.max()}",
            where=path,
            remedy="make it white (255) where the photograph is looked at, and black elsewhere",
        )
    shown = brightness >= _WHITE if alpha is None else (brightness >= _WHITE) & (alpha >= _WHITE)
    mask = np.where(shown, 255, 0).astype(np.uint8)
    if stored == upright:
        mask = apply_orientation(
            mask, header.orientation if upright else _BACK.get(header.orientation, header.orientation)
        )
    return mask


def resized_mask(mask: NDArray[np.uint8], width: int, height: int) -> NDArray[np.uint8]:
    """`read_mask`'s result in another size: 255 where a pixel shows nothing but what is looked at."""
    import torch

    planes = torch.from_numpy(np.ascontiguousarray(mask)).float()[None, None] / 255.0
    shares = torch.nn.functional.adaptive_avg_pool2d(planes, (height, width))[0, 0].numpy()
    return np.where(shares >= _WHOLLY, 255, 0).astype(np.uint8)


def as_shown(mask: NDArray[np.uint8]) -> NDArray[np.bool_] | None:
    """(H, W) bool of a mask after resampling; None where all is looked at."""
    shown = mask >= 255.0 * _WHOLLY
    return None if shown.all() else shown


def usable_views(views: list[View], model: SourceModel) -> list[View]:
    """`views` without those whose masks leave next to nothing; notes how many have masks, and what they leave out.

    Raises:
        InputError: fewer than two are left.
    """
    masked = [view for view in views if view.mask is not None]
    if not masked:
        return views
    hidden = sum(int((~view.mask).sum()) for view in masked if view.mask is not None)
    share = hidden / sum(view.camera.width * view.camera.height for view in views)
    model.warn(
        "masks", f"{model.file}: {len(masked)} of {len(views)} photographs have masks, which leave out {share:.1%}"
    )
    blind = {view.key for view in masked if view.mask is not None and view.mask.mean() < LEAST_SHOWN}
    if len(views) - len(blind) < 2:
        raise InputError(
            f"the masks of {len(blind)} of {len(views)} photographs leave nothing to look at",
            where=model.file,
            remedy="make masks white where photographs are looked at, and black elsewhere",
        )
    if blind:
        what = f"{len(blind)} photographs are masked completely and left out: {quote_first(sorted(blind))}"
        model.warn("masked-completely", f"{model.file}: {what}")
    return [view for view in views if view.key not in blind]
