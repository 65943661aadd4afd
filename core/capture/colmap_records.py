"""What the files of a COLMAP model hold, in either form, and how unusable numbers in them are refused."""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pycolmap
from numpy.typing import NDArray

from ..errors import InputError
from .points import as_float32

EXPORT_AGAIN = "copy or export the COLMAP model again"
# Of each file. A binary one is mapped, not copied, and what is kept of it is less than half of it.
MOST_BYTES = 4 << 30
MOST_POINT_BYTES = 1 << 30  # ten million points of ordinary tracks
# One view alone gives a point no depth; COLMAP writes none with a shorter track.
_LEAST_TRACK_LENGTH = 2
STAGE = "points"
_QUOTED = 40  # characters of a camera model's name, which may be anything
BLOCK = 1 << 16  # points that are read between two reports of progress
OBSERVATION = np.dtype([("position", "<f8", 2), ("point", "<i8")])
"""A feature: pixels from the upper left corner of the image, and the number of its point, -1 for none."""

PARAMETER_COUNTS = {
    name: len(pycolmap.Camera.create_from_model_id(0, model, 1.0, 2, 2).params)
    for name, model in pycolmap.CameraModelId.__members__.items()
    if name != "INVALID"
}
_ACCEPTED = [name for name in PARAMETER_COUNTS if name != "EQUIRECTANGULAR"]  # a full panorama, which is refused


@dataclass(frozen=True)
class ColmapImage:
    """A posed image.

    Attributes:
        name: as the file has it.
        camera_id: of its camera.
        quaternion: (4,) wxyz and `translation` (3,): world to camera, OpenCV axes; as the file has them.
        observations: (F,) `OBSERVATION`, the features that belong to a point; empty where they were not asked for.
    """

    name: str
    camera_id: int
    quaternion: tuple[float, ...]
    translation: tuple[float, ...]
    observations: NDArray[np.void] = field(default_factory=lambda: np.zeros(0, OBSERVATION), repr=False, compare=False)

    @property
    def world_to_camera(self) -> NDArray[np.float64]:
        """(3, 4); not finite where the file's numbers make no pose."""
        quaternion = np.array(self.quaternion)
        with np.errstate(all="ignore"):
            w, x, y, z = quaternion / np.linalg.norm(quaternion)
            rotation = [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        return np.column_stack([rotation, self.translation])


@dataclass
class Points:
    """Points while they are read: their numbers, three float32 coordinates, three bytes of colour, and how many images
    see each one.

    Attributes:
        track_lengths: counted up to `_LEAST_TRACK_LENGTH`.
    """

    numbers: array = field(default_factory=lambda: array("Q"))
    positions: array = field(default_factory=lambda: array("f"))
    colors: bytearray = field(default_factory=bytearray)
    track_lengths: bytearray = field(default_factory=bytearray)

    def add(self, number: int, position: Sequence[float], color: Sequence[int], track_length: int) -> None:
        """Add a point."""
        self.numbers.append(number)
        self.positions.extend(position)
        self.colors.extend(color)
        self.track_lengths.append(min(track_length, _LEAST_TRACK_LENGTH))

    def add_block(self, numbers: NDArray, positions: NDArray, colors: NDArray, track_lengths: NDArray) -> None:
        """Add (P,) numbers, (P, 3) positions, (P, 3) colours and (P,) lengths of tracks."""
        self.numbers.frombytes(numbers.tobytes())
        self.positions.frombytes(as_float32(positions).tobytes())
        self.colors += colors.tobytes()
        self.track_lengths += np.minimum(track_lengths, _LEAST_TRACK_LENGTH).astype(np.uint8).tobytes()

    def are_trusted(self) -> NDArray[np.bool_]:
        """(P,) whether a point is used.

        Programs that take points from depth maps or a scanner and write them in COLMAP's layout leave tracks empty, or
        name one image a point. Theirs are as good as any; in a model with longer tracks, a track of one image is a
        guess.
        """
        lengths = np.frombuffer(self.track_lengths, np.uint8)
        if (lengths >= _LEAST_TRACK_LENGTH).any():
            return lengths != 1
        return np.ones(len(lengths), bool)


def require(condition: bool, what: str, path: Path) -> None:
    if not condition:
        raise InputError(what, where=path, remedy=EXPORT_AGAIN)


def require_known_model(known: bool, model: object, path: Path) -> None:
    if not known:
        raise InputError(
            f"the camera model {str(model)[:_QUOTED]} is unknown",
            where=path,
            remedy=f"export it as one of {', '.join(_ACCEPTED)}, or undistort the photographs",
        )


def make_camera(number: int, model: str, size: Sequence[int], params: Sequence[float], path: Path) -> pycolmap.Camera:
    # What a camera cannot be is refused by `colmap.check_camera`; here, what pycolmap cannot hold.
    try:
        return pycolmap.Camera(camera_id=number, model=model, width=size[0], height=size[1], params=list(params))
    except (TypeError, ValueError, OverflowError, RuntimeError):
        raise InputError(f"camera {number} is damaged", where=path, remedy=EXPORT_AGAIN) from None
