"""Photographs that a user names, without cameras: which there are, what their results are called, whether they read."""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..capture.files import list_images, make_keys, natural_key, quote_first, visible_files
from ..capture.images import ImageHeader, read_header, read_pixels
from ..errors import InputError
from ..files.untrusted import is_file, is_folder, is_there
from ..intake.raw import Development
from ..runs.enhanced import METRICS_NAME, SHEET_NAME, enhanced_files
from ..runs.folder import refuse_foreign_files
from ..runtime.protocol import Reporter

STAGE = "read"
_OTHER_FOLDER = "choose another folder with --out"
_SCENE_PIXELS = 64_000_000
"""Pixels of all photographs together that are kept for the fit (192 MB); more are thinned out."""

Pixels = NDArray[np.uint8]


@dataclass(frozen=True)
class Photograph:
    """A photograph and what its result is called.

    Attributes:
        path: of the file.
        development: of raw files, which all that are enhanced together share.
        key: a name that is safe in a file system and that no other photograph has, whatever case it is written in.
    """

    path: Path
    key: str
    development: Development | None = None

    @property
    def output(self) -> str:
        """Name of the result's file."""
        return f"{self.key}.png"

    def header(self) -> ImageHeader:
        """What the file says about itself.

        Raises:
            InputError: it is not a usable image.
        """
        return read_header(self.path, min_side=1)

    def read(self) -> tuple[Pixels, Pixels | None]:
        """Upright (H, W, 3) sRGB and (H, W) coverage, or None where it is opaque.

        Raises:
            InputError: it is not a usable image, or is damaged.
        """
        return read_pixels(self.path, upright=True, min_side=1, development=self.development)


@dataclass(frozen=True)
class Survey:
    """The photographs that can be read, and their colours.

    Attributes:
        photographs: in order.
        images, alphas: (H, W, 3) and (H, W) or None each, thinned out where all together would not fit into memory.
            Pixels are left out rather than averaged: averaging would hide the colours of single yarns.
    """

    photographs: Sequence[Photograph]
    images: Sequence[Pixels]
    alphas: Sequence[Pixels | None]


def find_photographs(inputs: Sequence[str], out: Path, reporter: Reporter) -> list[Photograph]:
    """The photographs that `inputs`, files and folders, name; in natural order for each folder, each once.

    Files in `out` are skipped in a folder that contains it, so results are not read again.

    Raises:
        InputError: an input is missing, a folder holds no image, or a result would replace what is not ours.
    """
    paths: dict[str, Path] = {}
    for name in inputs:
        path = Path(name)
        for found in _search(path, out, reporter) if is_folder(path) else [_existing(path)]:
            paths.setdefault(os.path.abspath(found), found)
    portable = [Path(name).as_posix() for name in paths]
    development = Development.common(list(paths.values()))
    keys = make_keys(portable)
    photographs = [Photograph(path, key, development) for path, key in zip(paths.values(), keys, strict=True)]
    _keep_foreign_files(photographs, out)
    return photographs


def survey(
    photographs: Sequence[Photograph], reporter: Reporter, *, keep_pixels: bool, skip_unreadable: bool
) -> Survey:
    """Read every photograph once, so that a damaged one is found before anything takes time.

    Args:
        keep_pixels: whether the fit needs their colours.
        skip_unreadable: warn of what cannot be read instead of refusing it.

    Raises:
        InputError: a photograph cannot be used, or none can.
    """
    readable, images, alphas = [], [], []
    headers: list[ImageHeader] = []
    complaints: list[str] = []
    for number, photograph in enumerate(photographs):
        reporter.progress(STAGE, number / len(photographs), f"photograph {number + 1} of {len(photographs)}")
        try:
            header = photograph.header()
            image, alpha = photograph.read()
        except InputError as error:
            if not skip_unreadable:
                remedy = f"{error.remedy}, or pass --skip-unreadable"
                raise InputError(error.what, where=error.where, remedy=remedy) from None
            complaints.append(f"{error.where}: {error.what}")
            continue
        readable.append(photograph)
        headers.append(header)
        if keep_pixels:
            step = math.ceil(math.sqrt(image.shape[0] * image.shape[1] * len(photographs) / _SCENE_PIXELS))
            images.append(image[::step, ::step].copy())
            alphas.append(None if alpha is None else alpha[::step, ::step].copy())
    reporter.progress(STAGE, 1.0)
    if complaints:
        reporter.warning("unreadable", f"{len(complaints)} photographs are left out: {quote_first(complaints)}")
    if not readable:
        raise InputError("none of the photographs can be read", where=complaints[0], remedy="copy or export them again")
    _describe(headers, reporter)
    return Survey(readable, images, alphas)


def _search(folder: Path, out: Path, reporter: Reporter) -> list[Path]:
    """The images in `folder` and below, without those in `out` if it lies there; warns of what is skipped."""
    if _real(folder) == _real(out):
        raise InputError("is the folder of photographs itself", where=out, remedy=_OTHER_FOLDER)
    results = out if _is_inside(out, folder) else None
    images = [path for path in (folder / name for name in list_images(folder)) if not _is_inside(path, results)]
    others = _other_files(folder, set(images), results)
    if not images:
        held = f" ({quote_first(others)})" if others else ""
        raise InputError(f"this folder contains no images{held}", where=folder, remedy="name a folder of photographs")
    if others:
        reporter.warning("not-images", f"{folder}: what is not an image is skipped: {quote_first(others)}")
    return images


def _other_files(folder: Path, images: set[Path], results: Path | None) -> list[str]:
    """Names of the visible files and linked folders below `folder`, outside `results`, that are not in `images`."""
    others = [path for path in visible_files(folder) if not (path in images or _is_inside(path, results))]
    names = [path.relative_to(folder).as_posix() for path in others]
    links = [path for path in _linked_folders(folder) if not _is_inside(path, results)]
    names += [f"{path.relative_to(folder).as_posix()} (a linked folder)" for path in links]
    return sorted(names, key=natural_key)


def _linked_folders(folder: Path) -> Iterator[Path]:
    """Visible links to folders in `folder` and below, which nothing follows: they may lead anywhere."""
    for directory, subfolders, _ in os.walk(folder):
        subfolders[:] = [name for name in subfolders if not name.startswith(".")]
        yield from (Path(directory, name) for name in subfolders if os.path.islink(os.path.join(directory, name)))


def _is_inside(path: Path, folder: Path | None) -> bool:
    return folder is not None and _real(path).is_relative_to(_real(folder))


def _real(path: Path) -> Path:
    """The path without symbolic links; unlike `Path.resolve` it tolerates a cycle of them."""
    return Path(os.path.realpath(path))


def _existing(path: Path) -> Path:
    if not is_file(path):
        what = "is not a file or folder" if is_there(path) else "no such file or folder"
        raise InputError(what, where=path, remedy="name photographs or a folder of them")
    return path


def _keep_foreign_files(photographs: Sequence[Photograph], out: Path) -> None:
    """Refuse to replace a file that no earlier run made, or a photograph of this one."""
    ours = {_real(path) for path in enhanced_files(out)}
    for photograph in photographs:
        if _real(photograph.path) in ours:
            raise InputError(
                "the photograph is the result of an earlier run, which this one would replace",
                where=photograph.path,
                remedy=_OTHER_FOLDER,
            )
    targets = [out / name for name in (*(photograph.output for photograph in photographs), METRICS_NAME, SHEET_NAME)]
    refuse_foreign_files(target for target in targets if _real(target) not in ours)


def _describe(headers: Sequence[ImageHeader], reporter: Reporter) -> None:
    """Warn of what happens to photographs that are not plain upright 8-bit sRGB."""
    rotated = sum(header.orientation != 1 for header in headers)
    if rotated:
        reporter.warning("exif-rotated", f"{rotated} photographs are rotated upright according to their EXIF data")
    deep = sum(header.bits > 8 for header in headers)
    if deep:
        reporter.warning("deep-colour", f"{deep} photographs have more than 8 bits a channel; the results have 8")
    paged = sum(header.has_pages for header in headers)
    if paged:
        reporter.warning("several-pages", f"{paged} photographs have several pages or frames; the first is used")
    foreign = Counter(header.color_profile for header in headers if header.is_foreign)
    if foreign:
        profiles = quote_first(foreign)
        reporter.warning(
            "color-profile",
            f"{foreign.total()} photographs are not sRGB but {profiles}; taken as sRGB, convert them first for "
            "exact colours",
        )
