"""Cameras of programs whose files are not read: known by their names and first bytes, to say what to do instead."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from ..errors import InputError
from ..files.untrusted import is_file, opened

_SEARCHED_DEPTH = 3  # folders: MeshroomCache/StructureFromMotion/<a number>/cameras.sfm
_START_BYTES = 1024  # that are looked at; Metashape's chunk stands in the second or third line
_MOST_BYTES = 64 << 30  # of a file of which no more is read


@dataclass(frozen=True)
class ForeignCameras:
    """A camera file that is not read.

    Attributes:
        program: whose it is.
        file: the file.
        remedy: how a COLMAP model comes of it, as an imperative sentence.
    """

    program: str
    file: Path
    remedy: str


@dataclass(frozen=True)
class _Kind:
    """How a program's file is known: by its name in lower case, and where that says little, by its first bytes."""

    program: str
    remedy: str
    has_name: Callable[[str], bool]
    contains: tuple[bytes, ...] = ()

    def is_of(self, file: Path) -> bool:
        if not self.has_name(file.name.lower()) or not is_file(file):
            return False
        start = _start(file) if self.contains else b""
        return all(words in start for words in self.contains)


_KINDS = (
    _Kind(
        "OpenSfM", "export them as a COLMAP model (opensfm export_colmap)", lambda name: name == "reconstruction.json"
    ),
    _Kind(
        "Meshroom",
        "export them as a COLMAP model (node ExportColmap, or aliceVision_exportColmap)",
        lambda name: name.endswith(".sfm"),
    ),
    _Kind(
        "OpenMVG",
        "export them as a COLMAP model (openMVG_main_openMVG2Colmap)",
        lambda name: name in ("sfm_data.json", "sfm_data.bin"),
    ),
    _Kind(
        "Metashape",
        "export them as a COLMAP model (Export Cameras, type Colmap)",
        lambda name: name.endswith(".xml"),
        (b"<document", b"<chunk"),
    ),
    _Kind(
        "Bundler",
        "export a COLMAP model from the program that they came from",
        lambda name: name.endswith(".out"),
        (b"# Bundle file",),
    ),
    # Made of a COLMAP model by LLFF's script; numpy's files are never loaded here.
    _Kind("LLFF", "give the COLMAP model that they were made of (sparse/0)", lambda name: name == "poses_bounds.npy"),
)


def find_foreign_cameras(folder: Path) -> ForeignCameras | None:
    """The nearest camera file in `folder` or below it that another program wrote, if there is one."""
    for file in _files(folder):
        for kind in _KINDS:
            if kind.is_of(file):
                return ForeignCameras(kind.program, file, kind.remedy)
    return None


def _files(folder: Path) -> Iterator[Path]:
    """All but hidden ones, in order, those of a nearer folder first; links to folders are not followed."""
    level = [folder]
    for _ in range(_SEARCHED_DEPTH + 1):
        deeper: list[Path] = []
        for parent in level:
            with suppress(OSError):  # a folder that cannot be read holds nothing for us
                for entry in sorted(os.scandir(parent), key=lambda entry: entry.name):
                    if entry.name.startswith("."):
                        continue
                    if entry.is_dir(follow_symlinks=False):
                        deeper.append(Path(entry.path))
                    else:
                        yield Path(entry.path)
        level = deeper


def _start(file: Path) -> bytes:
    """The first bytes; none of a file that cannot be read."""
    try:
        with opened(file, most_bytes=_MOST_BYTES) as opened_file:
            return opened_file.read(_START_BYTES)
    except InputError:
        return b""
