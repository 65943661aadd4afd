"""360° photographs and videos, and videos of which depth is one half, recognised by what they say of themselves.

No lens took them as they are, and they are not supported.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ..errors import InputError
from ..files.untrusted import opened

PANORAMA_EXTENSIONS = (".insv", ".insp", ".360")
"""Of cameras that look all around: two fisheye pictures side by side."""
REMEDY = "export flat pictures from it (reframed, 90° wide, in many directions), and give these"

RECORD3D_REMEDY = "export EXR + RGB from the app, and give that folder"

_SEARCHED_BYTES = 8 << 20  # from a file's beginning and from its end, where its description stands
_MOST_BYTES = 64 << 30  # of a file of which no more is read
# Google's Photo Sphere XMP in photographs; its Spherical Video XML (V1) and the boxes of V2 in videos.
_IN_PHOTOGRAPHS = (b"GPano:ProjectionType", b"equirectangular")
_IN_VIDEOS = ((b"GSpherical:Spherical>true",), (b"sv3d", b"equi"), (b"sv3d", b"cbmp"))

# Record3D writes this behind an MP4 whose left half is depth, as hues.
_BESIDE_DEPTH = ((b'{"intrinsicMatrix"',),)


def refuse_panorama(path: Path, size: tuple[int, int]) -> None:
    """Refuse a photograph of (width, height) `size` that is all around.

    Raises:
        InputError: with the way round.
    """
    width, height = size
    if width == 2 * height and _says(path, (_IN_PHOTOGRAPHS,)):
        raise InputError("is a 360° photograph, which is not supported", where=path, remedy=REMEDY)


def refuse_composed_video(path: Path) -> None:
    """Refuse a video that is all around, or half depth.

    Raises:
        InputError: with the way round.
    """
    if path.suffix.lower() in PANORAMA_EXTENSIONS or _says(path, _IN_VIDEOS):
        remedy = "export a flat video from it (reframed, 90° wide), and give that"
        raise InputError("is a 360° video, which is not supported", where=path, remedy=remedy)
    if _says(path, _BESIDE_DEPTH):
        raise InputError("is Record3D's video, half of which is depth", where=path, remedy=RECORD3D_REMEDY)


def _says(path: Path, marks: Sequence[Sequence[bytes]]) -> bool:
    """Whether the file's beginning and end hold all the words of one of `marks`."""
    with opened(path, most_bytes=_MOST_BYTES) as file:
        start = file.read(_SEARCHED_BYTES)
        size = file.seek(0, 2)
        file.seek(max(len(start), size - _SEARCHED_BYTES))
        ends = start + file.read(_SEARCHED_BYTES)
    return any(all(words in ends for words in together) for together in marks)
