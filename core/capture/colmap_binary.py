"""The binary form of a COLMAP model's files, read record by record."""

from __future__ import annotations

import mmap
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np
import pycolmap

from ..errors import InputError
from ..files.untrusted import opened
from ..runtime.protocol import Reporter
from .colmap_records import (
    BLOCK,
    MOST_BYTES,
    MOST_POINT_BYTES,
    OBSERVATION,
    PARAMETER_COUNTS,
    STAGE,
    ColmapImage,
    Points,
    make_camera,
    require,
    require_known_model,
)

_MOST_NAME_BYTES = 4096  # Linux' own limit for a path
_MODEL_NAMES = {int(pycolmap.CameraModelId.__members__[name]): name for name in PARAMETER_COUNTS}

_U64 = struct.Struct("<Q")
_CAMERA = struct.Struct("<IiQQ")  # id, model, width, height
_IMAGE = struct.Struct("<I7dI")  # id, quaternion wxyz, translation, camera
_POINT = np.dtype(
    [("id", "<u8"), ("position", "<f8", 3), ("color", "u1", 3), ("error", "<f8"), ("track_length", "<u8")]
)
_TRACK_LENGTH = slice(_POINT.itemsize - _U64.size, None)
_TRACK_ELEMENT_BYTES = 8


class _BinaryReader:
    """A position in a binary file that never passes its end."""

    def __init__(self, file: BinaryIO, path: Path) -> None:
        self.path = path
        self.size = file.seek(0, 2)
        self.data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) if self.size else b""
        self.position = 0

    @property
    def fraction(self) -> float:
        return self.position / self.size

    def take(self, layout: struct.Struct) -> tuple:
        return layout.unpack_from(self.data, self.skip(layout.size))

    def skip(self, size: int) -> int:
        start = self.position
        require(size <= self.size - start, "the file is cut short or damaged", self.path)
        self.position = start + size
        return start

    def take_name(self) -> str:
        start = self.position
        end = self.data.find(b"\0", start, start + _MOST_NAME_BYTES)
        require(end >= 0, "the file is cut short or damaged", self.path)
        self.position = end + 1
        try:
            return self.data[start:end].decode("utf-8")
        except UnicodeDecodeError:
            what = f"the image name {self.data[start:end]!r} is not UTF-8"
            raise InputError(what, where=self.path, remedy="rename the image") from None

    def records(self) -> Iterator[None]:
        """Once for each record that the count at the start promises; afterwards the file must be at its end."""
        (count,) = self.take(_U64)
        for _ in range(count):
            yield
        self.require_end()

    def require_end(self) -> None:
        require(self.position == self.size, "the file is longer than its counts say", self.path)


def binary_cameras(path: Path) -> Iterator[tuple[int, pycolmap.Camera]]:
    """The cameras of a ``cameras.bin`` and their numbers."""
    with opened(path, most_bytes=MOST_BYTES) as file:
        reader = _BinaryReader(file, path)
        for _ in reader.records():
            number, model, *size = reader.take(_CAMERA)
            require_known_model(model in _MODEL_NAMES, model, path)
            name = _MODEL_NAMES[model]
            params = reader.take(struct.Struct(f"<{PARAMETER_COUNTS[name]}d"))
            yield number, make_camera(number, name, size, params, path)


def binary_images(path: Path, *, observed: bool = False) -> Iterator[ColmapImage]:
    """The posed images of an ``images.bin``, with their observations where these are asked for."""
    with opened(path, most_bytes=MOST_BYTES) as file:
        reader = _BinaryReader(file, path)
        for _ in reader.records():
            _, *pose, camera_id = reader.take(_IMAGE)
            name = reader.take_name()
            (count,) = reader.take(_U64)
            start = reader.skip(OBSERVATION.itemsize * count)
            features = np.frombuffer(reader.data, OBSERVATION, count if observed else 0, start)
            yield ColmapImage(name, camera_id, tuple(pose[:4]), tuple(pose[4:]), features[features["point"] >= 0])


def binary_points(path: Path, reporter: Reporter) -> Points:
    """The points of a ``points3D.bin``."""
    points = Points()
    with opened(path, most_bytes=MOST_POINT_BYTES) as file:
        reader = _BinaryReader(file, path)
        (count,) = reader.take(_U64)
        for start in range(0, count, BLOCK):
            if start:
                reporter.progress(STAGE, reader.fraction, f"{start:,} of {count:,} points")
            block = np.frombuffer(b"".join(_point_records(reader, min(BLOCK, count - start))), _POINT)
            points.add_block(block["id"], block["position"], block["color"], block["track_length"])
        reader.require_end()
    return points


def _point_records(reader: _BinaryReader, count: int) -> list[bytes]:
    """The next `count` records of `_POINT`, without the tracks that follow each one."""
    # There may be tens of millions: no call for each that is not needed. Beyond the end of the file there are empty
    # records, and after them the end of the block is refused.
    data, size, position = reader.data, _POINT.itemsize, reader.position
    records = []
    for _ in range(count):
        record = data[position : position + size]
        track_length = int.from_bytes(record[_TRACK_LENGTH], "little")
        position += size + _TRACK_ELEMENT_BYTES * track_length
        records.append(record)
    reader.skip(position - reader.position)
    return records
