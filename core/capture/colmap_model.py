"""COLMAP model files, binary and text: cameras, posed images and points, checked record by record.

Read here and not by pycolmap, which trusts what a file says: a damaged or hostile one ends the whole process, makes it
loop for minutes, or makes it allocate without bound. After the public description of the format
(https://colmap.github.io/format.html). ``rigs`` and ``frames`` of later versions are not needed: ``images`` repeats the
pose of every image that they make up, for programs that know nothing of them.
"""

from __future__ import annotations

import codecs
import mmap
import os
import re
import struct
from array import array
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

import numpy as np
import pycolmap
from numpy.typing import NDArray

from ..errors import InputError
from ..events import Reporter
from ..untrusted import is_file, opened
from .points import as_float32
from .source import MOST_VIEWS

EXPORT_AGAIN = "copy or export the COLMAP model again"
# Of each file. A binary one is mapped, not copied, and what is kept of it is less than half of it.
_MOST_BYTES = 4 << 30
_MOST_POINT_BYTES = 1 << 30  # ten million points of ordinary tracks
_MOST_NAME_BYTES = 4096  # Linux' own limit for a path
_LONGEST_LINE = 16 << 20  # bytes of text: the features of an image, hundreds of thousands
# One view alone gives a point no depth; COLMAP writes none with a shorter track.
_LEAST_TRACK_LENGTH = 2

_PARAMETER_COUNTS = {
    name: len(pycolmap.Camera.create_from_model_id(0, model, 1.0, 2, 2).params)
    for name, model in pycolmap.CameraModelId.__members__.items()
    if name != "INVALID"
}
_MODEL_NAMES = {int(pycolmap.CameraModelId.__members__[name]): name for name in _PARAMETER_COUNTS}

_U64 = struct.Struct("<Q")
_CAMERA = struct.Struct("<IiQQ")  # id, model, width, height
_IMAGE = struct.Struct("<I7dI")  # id, quaternion wxyz, translation, camera
_POINT = np.dtype(
    [("id", "<u8"), ("position", "<f8", 3), ("color", "u1", 3), ("error", "<f8"), ("track_length", "<u8")]
)
_TRACK_LENGTH = slice(_POINT.itemsize - _U64.size, None)
_OBSERVATION_BYTES = 24
_TRACK_ELEMENT_BYTES = 8

STAGE = "points"
_BLOCK = 1 << 16  # points that are read between two reports of progress


@dataclass(frozen=True)
class ColmapImage:
    """A posed image.

    Attributes:
        name: as the file has it.
        camera_id: of its camera.
        quaternion: (4,) wxyz and `translation` (3,): world to camera, OpenCV axes; as the file has them.
    """

    name: str
    camera_id: int
    quaternion: tuple[float, ...]
    translation: tuple[float, ...]

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
class ColmapModel:
    """What a model says.

    Attributes:
        cameras: by their numbers.
        images: in the file's order; their cameras are there.
        points: (P, 3) float32 positions of those that can be trusted (`_Points.are_trusted`), and `point_colors` (P, 3)
            uint8.
    """

    cameras: dict[int, pycolmap.Camera] = field(default_factory=dict)
    images: list[ColmapImage] = field(default_factory=list)
    points: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 3), np.float32))
    point_colors: NDArray[np.uint8] = field(default_factory=lambda: np.zeros((0, 3), np.uint8))


@dataclass
class _Points:
    """Points while they are read: three float32 coordinates, three bytes of colour, and how many images see each one.

    Attributes:
        track_lengths: counted up to `_LEAST_TRACK_LENGTH`.
    """

    positions: array = field(default_factory=lambda: array("f"))
    colors: bytearray = field(default_factory=bytearray)
    track_lengths: bytearray = field(default_factory=bytearray)

    def add(self, position: Sequence[float], color: Sequence[int], track_length: int) -> None:
        """Add a point."""
        self.positions.extend(position)
        self.colors.extend(color)
        self.track_lengths.append(min(track_length, _LEAST_TRACK_LENGTH))

    def add_block(self, positions: NDArray, colors: NDArray, track_lengths: NDArray) -> None:
        """Add (P, 3) positions, (P, 3) colours and (P,) lengths of tracks."""
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


def read_model(folder: Path, reporter: Reporter | None = None) -> ColmapModel:
    """The model in `folder`, binary if it has both forms.

    Args:
        reporter: told how far the points are read.

    Raises:
        InputError: a file is missing, cut or damaged.
    """
    suffix = ".bin" if is_file(folder / "images.bin") else ".txt"
    paths = [folder / (name + suffix) for name in ("cameras", "images", "points3D")]
    for path in paths:
        if not is_file(path):
            raise InputError(f"{path.name} is missing", where=folder, remedy=EXPORT_AGAIN)
    cameras, images, points = paths
    binary = suffix == ".bin"
    model = ColmapModel()
    for number, camera in (_binary_cameras if binary else _text_cameras)(cameras):
        _require(number not in model.cameras, f"two cameras have the number {number}", cameras)
        _require(len(model.cameras) < MOST_VIEWS, f"it has more than {MOST_VIEWS:,} cameras", cameras)
        model.cameras[number] = camera
    for image in (_binary_images if binary else _text_images)(images):
        known = image.camera_id in model.cameras
        _require(known, f"damaged: {image.name} is of camera {image.camera_id}, which is not there", images)
        _require(len(model.images) < MOST_VIEWS, f"it has more than {MOST_VIEWS:,} images", images)
        model.images.append(image)
    read = (_binary_points if binary else _text_points)(points, reporter or Reporter())
    model.points = np.frombuffer(read.positions, np.float32).reshape(-1, 3)
    model.point_colors = np.frombuffer(read.colors, np.uint8).reshape(-1, 3)
    trusted = read.are_trusted()
    if not trusted.all():  # else there is no need for copies, of tens of millions of points in the worst case
        model.points, model.point_colors = model.points[trusted], model.point_colors[trusted]
    return model


def _require(condition: bool, what: str, path: Path) -> None:
    if not condition:
        raise InputError(what, where=path, remedy=EXPORT_AGAIN)


def _make_camera(number: int, model: str, size: Sequence[int], params: Sequence[float], path: Path) -> pycolmap.Camera:
    # What a camera cannot be is refused by `colmap.check_camera`; here, what pycolmap cannot hold.
    try:
        return pycolmap.Camera(camera_id=number, model=model, width=size[0], height=size[1], params=list(params))
    except (TypeError, ValueError, OverflowError, RuntimeError):
        raise InputError(f"camera {number} is damaged", where=path, remedy=EXPORT_AGAIN) from None


# ---- binary


class _Walker:
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
        _require(size <= self.size - start, "the file is cut short or damaged", self.path)
        self.position = start + size
        return start

    def take_name(self) -> str:
        start = self.position
        end = self.data.find(b"\0", start, start + _MOST_NAME_BYTES)
        _require(end >= 0, "the file is cut short or damaged", self.path)
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
        _require(self.position == self.size, "the file is longer than its counts say", self.path)


def _binary_cameras(path: Path) -> Iterator[tuple[int, pycolmap.Camera]]:
    with opened(path, most_bytes=_MOST_BYTES) as file:
        walker = _Walker(file, path)
        for _ in walker.records():
            number, model, *size = walker.take(_CAMERA)
            _require(model in _MODEL_NAMES, f"the camera model {model} is unknown", path)
            name = _MODEL_NAMES[model]
            params = walker.take(struct.Struct(f"<{_PARAMETER_COUNTS[name]}d"))
            yield number, _make_camera(number, name, size, params, path)


def _binary_images(path: Path) -> Iterator[ColmapImage]:
    with opened(path, most_bytes=_MOST_BYTES) as file:
        walker = _Walker(file, path)
        for _ in walker.records():
            _, *pose, camera_id = walker.take(_IMAGE)
            name = walker.take_name()
            (observations,) = walker.take(_U64)
            walker.skip(_OBSERVATION_BYTES * observations)
            yield ColmapImage(name, camera_id, tuple(pose[:4]), tuple(pose[4:]))


def _binary_points(path: Path, reporter: Reporter) -> _Points:
    points = _Points()
    with opened(path, most_bytes=_MOST_POINT_BYTES) as file:
        walker = _Walker(file, path)
        (count,) = walker.take(_U64)
        for start in range(0, count, _BLOCK):
            if start:
                reporter.progress(STAGE, walker.fraction, f"{start:,} of {count:,} points")
            block = np.frombuffer(b"".join(_point_records(walker, min(_BLOCK, count - start))), _POINT)
            points.add_block(block["position"], block["color"], block["track_length"])
        walker.require_end()
    return points


def _point_records(walker: _Walker, count: int) -> list[bytes]:
    """The next `count` records of `_POINT`, without the tracks that follow each one."""
    # There may be tens of millions: no call for each that is not needed. Beyond the end of the file there are empty
    # records, and after them the end of the block is refused.
    data, size, position = walker.data, _POINT.itemsize, walker.position
    records = []
    for _ in range(count):
        record = data[position : position + size]
        track_length = int.from_bytes(record[_TRACK_LENGTH], "little")
        position += size + _TRACK_ELEMENT_BYTES * track_length
        records.append(record)
    walker.skip(position - walker.position)
    return records


# ---- text


class _Lines:
    """The lines of a text file that are no comments, with their numbers.

    Whoever writes into a comment how many entries there are ends every line; a file that has fewer is cut short.
    """

    def __init__(self, file: BinaryIO, path: Path) -> None:
        self.path, self.number = path, 0
        self._file, self._size = file, os.fstat(file.fileno()).st_size
        self._promised: int | None = None
        self._ended = True

    @property
    def fraction(self) -> float:
        return self._file.tell() / self._size

    def __iter__(self) -> Iterator[str]:
        while line := self._file.readline(_LONGEST_LINE):
            self.number += 1
            line = line.removeprefix(codecs.BOM_UTF8) if self.number == 1 else line
            self._ended = line.endswith(b"\n")
            _require(self._ended or len(line) < _LONGEST_LINE, f"line {self.number} is too long", self.path)
            if line.startswith(b"#"):
                found = re.match(rb"# Number of \w+: (\d{1,18})\b", line)
                self._promised = int(found[1]) if found and self._promised is None else self._promised
                continue
            try:
                yield line.decode("utf-8").strip()
            except UnicodeDecodeError:
                raise InputError(
                    f"line {self.number} is not UTF-8 text", where=self.path, remedy=EXPORT_AGAIN
                ) from None

    def check_count(self, count: int) -> None:
        """Make sure that there are no fewer entries than the file's own comment says."""
        # More are whole too: some programs write the comment before they know.
        whole = self._promised is None or (self._promised <= count and self._ended)
        _require(whole, f"the file is cut short or damaged ({count} of {self._promised} entries are there)", self.path)

    def refuse(self) -> InputError:
        return InputError(f"line {self.number} is cut short or damaged", where=self.path, remedy=EXPORT_AGAIN)

    def parse(self, kind: Callable[[str], float], words: Sequence[str]) -> list:
        """The `words` as numbers."""
        try:
            return [kind(word) for word in words]
        except ValueError:
            raise self.refuse() from None


def _text_cameras(path: Path) -> Iterator[tuple[int, pycolmap.Camera]]:
    with opened(path, most_bytes=_MOST_BYTES) as file:
        lines, count = _Lines(file, path), 0
        for line in lines:
            words = line.split()
            if not words:
                continue
            if len(words) < 4 or len(words) != 4 + _PARAMETER_COUNTS.get(words[1], -1):
                raise lines.refuse()
            number, *size = lines.parse(int, [words[0], *words[2:4]])
            count += 1
            yield number, _make_camera(number, words[1], size, lines.parse(float, words[4:]), path)
        lines.check_count(count)


def _text_images(path: Path) -> Iterator[ColmapImage]:
    with opened(path, most_bytes=_MOST_BYTES) as file:
        lines, count = _Lines(file, path), 0
        iterator = iter(lines)
        for line in iterator:
            if not line:
                continue
            words = line.split(maxsplit=9)
            if len(words) < 10:
                raise lines.refuse()
            pose = lines.parse(float, words[1:8])
            _, camera_id = lines.parse(int, [words[0], words[8]])
            count += 1
            # The observations; an image without any has an empty line here.
            if len(next(iterator, "").split()) % 3:
                raise lines.refuse()
            yield ColmapImage(words[9], camera_id, tuple(pose[:4]), tuple(pose[4:]))
        lines.check_count(count)


def _text_points(path: Path, reporter: Reporter) -> _Points:
    points = _Points()
    with opened(path, most_bytes=_MOST_POINT_BYTES) as file:
        lines, count = _Lines(file, path), 0
        for line in lines:
            words = line.split()
            if not words:
                continue
            if len(words) < 8 or len(words) % 2:
                raise lines.refuse()
            position, color = lines.parse(float, words[1:4]), lines.parse(int, words[4:7])
            if not all(0 <= channel <= 255 for channel in color):
                raise lines.refuse()
            points.add(position, color, (len(words) - 8) // 2)
            count += 1
            if count % _BLOCK == 0:
                reporter.progress(STAGE, lines.fraction, f"{count:,} points")
        lines.check_count(count)
    return points
