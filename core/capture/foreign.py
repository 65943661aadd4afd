"""Files that are not read: recognised by name or first bytes, so that the message can say what to do."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

from ..errors import InputError
from ..files.untrusted import is_file, opened
from ..intake.kinds import ARCHIVE_EXTENSION, FOREIGN_ARCHIVE_EXTENSIONS, FOREIGN_VIDEO_EXTENSIONS
from ..intake.panoramas import PANORAMA_EXTENSIONS, RECORD3D_REMEDY
from ..intake.panoramas import REMEDY as PANORAMA_REMEDY

_SEARCHED_DEPTH = 3  # folders: MeshroomCache/StructureFromMotion/<a number>/cameras.sfm
_START_BYTES = 4096  # that are looked at; RealityScan's rotation follows up to 30 attributes
_MOST_BYTES = 64 << 30  # of a file of which no more is read


_REMEDIES = {
    **dict.fromkeys(PANORAMA_EXTENSIONS, f"360° pictures are not supported: {PANORAMA_REMEDY}"),
    **dict.fromkeys(FOREIGN_VIDEO_EXTENSIONS, "videos of this format are not read: convert it to MP4 (H.264)"),
    **dict.fromkeys(FOREIGN_ARCHIVE_EXTENSIONS, "unpack it, and give the folder"),
    ARCHIVE_EXTENSION: "give the zip itself, or unpack it",
    ".r3d": f"Record3D's depth is not supported: {RECORD3D_REMEDY}",
}


@dataclass(frozen=True)
class ForeignCameras:
    """A camera file that is not read.

    Attributes:
        program: whose it is.
        file: the file.
        remedy: how to get a COLMAP model from it, as an imperative sentence.
    """

    program: str
    file: Path
    remedy: str


_MODEL = "export them as a COLMAP model"
# Program, names of its files in lower case, what the first bytes contain where a name says little, and the remedy.
_KINDS = (
    ("OpenSfM", ("reconstruction.json",), (), f"{_MODEL} (opensfm export_colmap)"),
    ("Meshroom", ("*.sfm",), (), f"{_MODEL} (node ExportColmap, or aliceVision_exportColmap)"),
    ("OpenMVG", ("sfm_data.json", "sfm_data.bin"), (), f"{_MODEL} (openMVG_main_openMVG2Colmap)"),
    ("Metashape", ("*.xml",), (b"<document", b"<chunk"), f"{_MODEL} (Export Cameras, type Colmap)"),
    ("RealityScan", ("*.csv",), (b"#name,x,y,alt", b",roll,"), f"{_MODEL} (Export Registration, COLMAP)"),
    ("RealityScan", ("*.xmp",), (b"xcr:Rotation",), f"{_MODEL} (Export Registration, COLMAP)"),
    ("Bundler", ("*.out",), (b"# Bundle file",), "export a COLMAP model from the program that wrote them"),
    # Made from a COLMAP model by LLFF's script; numpy's files are never loaded here.
    ("LLFF", ("poses_bounds.npy",), (), "give the COLMAP model that they were made from (sparse/0)"),
)


def way_round(path: Path) -> str:
    """What to do with an archive, or a file of a scanner or a 360° camera, by its name; empty for others."""
    return _REMEDIES.get(path.suffix.lower(), "")


def find_foreign_cameras(folder: Path) -> ForeignCameras | None:
    """The nearest camera file in `folder` or below it that another program wrote, if there is one."""
    for file in _files(folder):
        for program, names, contained, remedy in _KINDS:
            if not any(fnmatchcase(file.name.lower(), name) for name in names) or not is_file(file):
                continue
            start = _start(file) if contained else b""
            if all(words in start for words in contained):
                return ForeignCameras(program, file, remedy)
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
