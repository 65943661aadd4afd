"""The files of a COLMAP model, in both their forms: cameras, posed images and points, and how bad ones are refused.

The binary form is read record by record and the text form line by line. pycolmap's own readers take whatever a file
claims, so a damaged or hostile one could end the process or fill the memory.
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
from ..files.untrusted import is_file, is_there, opened
from ..runtime.protocol import Reporter
from .points import as_float32
from .source import MOST_VIEWS

EXPORT_AGAIN = "copy or export the COLMAP model again"
# Of each file. A binary one is mapped, not copied, and what is kept of it is less than half of it.
_MOST_BYTES = 4 << 30
_MOST_POINT_BYTES = 1 << 30  # ten million points of ordinary tracks
# One view alone gives a point no depth; COLMAP writes none with a shorter track.
_LEAST_TRACK_LENGTH = 2
_STAGE = "points"
_QUOTED = 40  # characters of a camera model's name, which may be anything
_BLOCK = 1 << 16  # points that are read between two reports of progress

_PARAMETER_COUNTS = {
    name: len(pycolmap.Camera.create_from_model_id(0, model, 1.0, 2, 2).params)
    for name, model in pycolmap.CameraModelId.__members__.items()
    if name != "INVALID"
}
_ACCEPTED = [name for name in _PARAMETER_COUNTS if name != "EQUIRECTANGULAR"]  # a full panorama, which is refused

_MOST_NAME_BYTES = 4096  # Linux' own limit for a path
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


def read_model(folder: Path, reporter: Reporter | None = None) -> ColmapModel:
    """The model in `folder`, binary if it has both forms whole; without points where it has no file of them.

    Args:
        reporter: told how far the points are read.

    Raises:
        InputError: the cameras or the images are missing, or a file is cut or damaged.
    """
    forms = [[folder / (name + suffix) for name in ("cameras", "images", "points3D")] for suffix in (".bin", ".txt")]
    whole = [form for form in forms if all(map(is_file, form))]
    # Of a model that is incomplete in both forms, the message is about the form of which more is there.
    most = forms[0] if is_file(forms[0][1]) else max(reversed(forms), key=lambda form: sum(map(is_file, form)))
    cameras, images, points = whole[0] if whole else most
    for path in (cameras, images):
        if not is_file(path):
            raise InputError(f"{path.name} is missing", where=folder, remedy=EXPORT_AGAIN)
    binary = cameras.suffix == ".bin"
    model = ColmapModel()
    for number, camera in (_binary_cameras if binary else _text_cameras)(cameras):
        _require(number not in model.cameras, f"two cameras have the number {number}", cameras)
        _require(len(model.cameras) < MOST_VIEWS, f"the model has more than {MOST_VIEWS:,} cameras", cameras)
        model.cameras[number] = camera
    for image in (_binary_images if binary else _text_images)(images):
        known = image.camera_id in model.cameras
        _require(known, f"damaged: {image.name} refers to camera {image.camera_id}, which is missing", images)
        _require(len(model.images) < MOST_VIEWS, f"the model has more than {MOST_VIEWS:,} images", images)
        model.images.append(image)
    if not is_there(points):
        return model
    read = (_binary_points if binary else _text_points)(points, reporter or Reporter())
    model.points = np.frombuffer(read.positions, np.float32).reshape(-1, 3)
    model.point_colors = np.frombuffer(read.colors, np.uint8).reshape(-1, 3)
    trusted = read.are_trusted()
    if not trusted.all():  # else there is no need for copies, of tens of millions of points in the worst case
        model.points, model.point_colors = model.points[trusted], model.point_colors[trusted]
    return model


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


def _require(condition: bool, what: str, path: Path) -> None:
    if not condition:
        raise InputError(what, where=path, remedy=EXPORT_AGAIN)


def _require_known_model(known: bool, model: object, path: Path) -> None:
    if not known:
        raise InputError(
            f"the camera model {str(model)[:_QUOTED]} is unknown",
            where=path,
            remedy=f"export it as one of {', '.join(_ACCEPTED)}, or undistort the photographs",
        )


def _make_camera(number: int, model: str, size: Sequence[int], params: Sequence[float], path: Path) -> pycolmap.Camera:
    # What a camera cannot be is refused by `colmap.check_camera`; here, what pycolmap cannot hold.
    try:
        return pycolmap.Camera(camera_id=number, model=model, width=size[0], height=size[1], params=list(params))
    except (TypeError, ValueError, OverflowError, RuntimeError):
        raise InputError(f"camera {number} is damaged", where=path, remedy=EXPORT_AGAIN) from None


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
        reader = _BinaryReader(file, path)
        for _ in reader.records():
            number, model, *size = reader.take(_CAMERA)
            _require_known_model(model in _MODEL_NAMES, model, path)
            name = _MODEL_NAMES[model]
            params = reader.take(struct.Struct(f"<{_PARAMETER_COUNTS[name]}d"))
            yield number, _make_camera(number, name, size, params, path)


def _binary_images(path: Path) -> Iterator[ColmapImage]:
    with opened(path, most_bytes=_MOST_BYTES) as file:
        reader = _BinaryReader(file, path)
        for _ in reader.records():
            _, *pose, camera_id = reader.take(_IMAGE)
            name = reader.take_name()
            (observations,) = reader.take(_U64)
            reader.skip(_OBSERVATION_BYTES * observations)
            yield ColmapImage(name, camera_id, tuple(pose[:4]), tuple(pose[4:]))


def _binary_points(path: Path, reporter: Reporter) -> _Points:
    points = _Points()
    with opened(path, most_bytes=_MOST_POINT_BYTES) as file:
        reader = _BinaryReader(file, path)
        (count,) = reader.take(_U64)
        for start in range(0, count, _BLOCK):
            if start:
                reporter.progress(_STAGE, reader.fraction, f"{start:,} of {count:,} points")
            block = np.frombuffer(b"".join(_point_records(reader, min(_BLOCK, count - start))), _POINT)
            points.add_block(block["position"], block["color"], block["track_length"])
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


_LONGEST_LINE = 16 << 20  # bytes: the features of an image, hundreds of thousands


class _Lines:
    """The lines of a text file that are not comments, with their numbers, and the entries among them.

    Programs that write the number of entries into a comment end every line; a file that has fewer is cut short.
    """

    def __init__(self, file: BinaryIO, path: Path) -> None:
        self.path, self.number, self.count = path, 0, 0
        self._file, self._size = file, os.fstat(file.fileno()).st_size
        self._promised: int | None = None
        self._ended = True
        self._lines = self._read()

    @property
    def fraction(self) -> float:
        return self._file.tell() / self._size

    def entries(self, least: int, *, most_splits: int = -1) -> Iterator[list[str]]:
        """The words of every line that has any, `least` at least; checks at the end that none is missing."""
        for line in self._lines:
            words = line.split(maxsplit=most_splits)
            if not words:
                continue
            self.require(len(words) >= least)
            self.count += 1
            yield words
        # More than promised are whole too: some programs write the comment before they know.
        whole = self._promised is None or (self._promised <= self.count and self._ended)
        what = f"the file is cut short or damaged ({self.count} of {self._promised} entries are there)"
        _require(whole, what, self.path)

    def next_line(self) -> str:
        """The line after an entry's, or "" at the end of the file."""
        return next(self._lines, "")

    def _read(self) -> Iterator[str]:
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
                what = f"line {self.number} is not UTF-8 text"
                raise InputError(what, where=self.path, remedy=EXPORT_AGAIN) from None

    def require(self, condition: bool) -> None:
        _require(condition, f"line {self.number} is cut short or damaged", self.path)

    def parse(self, kind: Callable[[str], float], words: Sequence[str]) -> list:
        """The `words` as numbers."""
        try:
            return [kind(word) for word in words]
        except ValueError:
            self.require(False)
            raise


def _text_cameras(path: Path) -> Iterator[tuple[int, pycolmap.Camera]]:
    with opened(path, most_bytes=_MOST_BYTES) as file:
        lines = _Lines(file, path)
        for words in lines.entries(4):
            model = words[1]
            _require_known_model(model in _PARAMETER_COUNTS, model, path)
            lines.require(len(words) == 4 + _PARAMETER_COUNTS[model])
            number, *size = lines.parse(int, [words[0], *words[2:4]])
            yield number, _make_camera(number, model, size, lines.parse(float, words[4:]), path)


def _text_images(path: Path) -> Iterator[ColmapImage]:
    with opened(path, most_bytes=_MOST_BYTES) as file:
        lines = _Lines(file, path)
        for words in lines.entries(10, most_splits=9):
            pose = lines.parse(float, words[1:8])
            _, camera_id = lines.parse(int, [words[0], words[8]])
            # The observations; an image without any has an empty line here.
            lines.require(len(lines.next_line().split()) % 3 == 0)
            yield ColmapImage(words[9], camera_id, tuple(pose[:4]), tuple(pose[4:]))


def _text_points(path: Path, reporter: Reporter) -> _Points:
    points = _Points()
    with opened(path, most_bytes=_MOST_POINT_BYTES) as file:
        lines = _Lines(file, path)
        for words in lines.entries(8):
            lines.require(len(words) % 2 == 0)
            position, color = lines.parse(float, words[1:4]), lines.parse(int, words[4:7])
            lines.require(all(0 <= channel <= 255 for channel in color))
            points.add(position, color, (len(words) - 8) // 2)
            if lines.count % _BLOCK == 0:
                reporter.progress(_STAGE, lines.fraction, f"{lines.count:,} points")
    return points
