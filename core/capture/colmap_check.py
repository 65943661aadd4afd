"""Structure checks of COLMAP model files, before pycolmap opens them.

pycolmap trusts the counts in a file: a cut or hostile one makes it loop for minutes, allocate without bound, or return
numbers from behind the end. These functions walk over the records without building anything.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Iterator
from pathlib import Path

import pycolmap

from ..errors import InputError

_CUT = "copy or export the COLMAP model again"
_PARAMETER_COUNTS = {
    int(model): len(pycolmap.Camera.create_from_model_id(0, model, 1.0, 2, 2).params)
    for name, model in pycolmap.CameraModelId.__members__.items()
    if name != "INVALID"
}
_MODEL_NAMES = {
    name: _PARAMETER_COUNTS[int(model)]
    for name, model in pycolmap.CameraModelId.__members__.items()
    if name != "INVALID"
}
_POSE_BYTES = 7 * 8
_CAMERA_SENSOR = 0


class _Walker:
    """A position in a binary file that never passes its end."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.data = path.read_bytes()
        self.position = 0

    def take(self, layout: struct.Struct) -> tuple:
        start = self.skip(layout.size)
        return layout.unpack_from(self.data, start)

    def skip(self, size: int) -> int:
        start = self.position
        if size > len(self.data) - start:
            raise InputError("the file is cut short or damaged", where=self.path, remedy=_CUT)
        self.position = start + size
        return start

    def skip_text(self) -> None:
        end = self.data.find(b"\0", self.position)
        self.skip((end if end >= 0 else len(self.data)) + 1 - self.position)

    def records(self) -> Iterator[None]:
        """Once for each record that the count at the start promises; afterwards the file must be at its end."""
        (count,) = self.take(_U64)
        for _ in range(count):
            yield
        if self.position != len(self.data):
            raise InputError("the file is longer than its counts say", where=self.path, remedy=_CUT)


_U64 = struct.Struct("<Q")
_U32 = struct.Struct("<I")
_CAMERA = struct.Struct("<IiQQ")
_IMAGE = struct.Struct("<I7dI")
_POINT = struct.Struct("<Q3d3BdQ")
_SENSOR = struct.Struct("<iI")
_FRAME = struct.Struct("<II7dI")
_FLAG = struct.Struct("<B")


def check_binary(folder: Path) -> None:
    """Walk over the binary model in `folder`.

    Raises:
        InputError: a file's counts and length disagree, or a camera model is unknown.
    """
    checks: dict[str, Callable[[_Walker], None]] = {
        "cameras.bin": _check_cameras,
        "images.bin": _check_images,
        "points3D.bin": _check_points,
        "rigs.bin": _check_rigs,
        "frames.bin": _check_frames,
    }
    for name, check in checks.items():
        if (folder / name).exists():
            check(_Walker(folder / name))


def _check_cameras(walker: _Walker) -> None:
    for _ in walker.records():
        _, model, _, _ = walker.take(_CAMERA)
        if model not in _PARAMETER_COUNTS:
            raise InputError(f"the camera model {model} is unknown", where=walker.path, remedy=_CUT)
        walker.skip(8 * _PARAMETER_COUNTS[model])


def _check_images(walker: _Walker) -> None:
    for _ in walker.records():
        walker.skip(_IMAGE.size)
        walker.skip_text()
        (observations,) = walker.take(_U64)
        walker.skip(24 * observations)


def _check_points(walker: _Walker) -> None:
    for _ in walker.records():
        track_length = walker.take(_POINT)[-1]
        walker.skip(8 * track_length)


def _check_rigs(walker: _Walker) -> None:
    for _ in walker.records():
        walker.skip(_U32.size)
        (sensors,) = walker.take(_U32)
        if sensors:
            walker.skip(_SENSOR.size)
        for _ in range(sensors - 1 if sensors else 0):
            walker.skip(_SENSOR.size)
            (has_pose,) = walker.take(_FLAG)
            walker.skip(_POSE_BYTES if has_pose else 0)


def _check_frames(walker: _Walker) -> None:
    for _ in walker.records():
        data_count = walker.take(_FRAME)[-1]
        walker.skip(data_count * (_SENSOR.size + _U64.size))


def check_text(folder: Path) -> None:
    """Check the text model in `folder` line by line.

    Raises:
        InputError: a line has the wrong number of fields or a word for a number, or the header's comment promises more
            lines.
    """
    checks: dict[str, Callable[[Path, list[tuple[int, str]]], int]] = {
        "cameras.txt": _check_camera_lines,
        "images.txt": _check_image_lines,
        "points3D.txt": _check_point_lines,
    }
    for name, check in checks.items():
        path = folder / name
        if not path.exists():
            continue
        try:
            text = path.read_text(encoding="utf-8")
        except UnicodeDecodeError:
            raise InputError("not a text file", where=path, remedy=_CUT) from None
        numbered = list(enumerate(text.split("\n"), start=1))
        count = check(path, [(number, line.strip()) for number, line in numbered if not line.startswith("#")])
        promised = re.search(r"^# Number of \w+: (\d+)", text, re.MULTILINE)
        # Whoever writes the count ends every line; without it, a last line without an end may be somebody's editor.
        if promised and (int(promised[1]) != count or not text.endswith("\n")):
            raise InputError(
                f"the file is cut short or damaged ({count} of {promised[1]} entries are there)",
                where=path,
                remedy=_CUT,
            )


def _check_camera_lines(path: Path, lines: list[tuple[int, str]]) -> int:
    entries = [(number, line.split()) for number, line in lines if line]
    for number, words in entries:
        if len(words) < 4 or words[1] not in _MODEL_NAMES or len(words) != 4 + _MODEL_NAMES[words[1]]:
            _refuse_line(path, number)
        _check_numbers(path, number, [words[0], *words[2:]])
    return len(entries)


def _check_image_lines(path: Path, lines: list[tuple[int, str]]) -> int:
    count, position = 0, 0
    while position < len(lines):
        number, line = lines[position]
        position += 1
        if not line:
            continue
        words = line.split(maxsplit=9)
        if len(words) < 10:
            _refuse_line(path, number)
        _check_numbers(path, number, words[:9])
        count += 1
        if position < len(lines):
            # The observations; an image without any has an empty line here.
            number, line = lines[position]
            position += 1
            words = line.split()
            if len(words) % 3:
                _refuse_line(path, number)
            _check_numbers(path, number, words)
    return count


def _check_point_lines(path: Path, lines: list[tuple[int, str]]) -> int:
    entries = [(number, line.split()) for number, line in lines if line]
    for number, words in entries:
        if len(words) < 8 or len(words) % 2:
            _refuse_line(path, number)
        _check_numbers(path, number, words)
    return len(entries)


def _check_numbers(path: Path, number: int, words: list[str]) -> None:
    try:
        for word in words:
            float(word)
    except ValueError:
        _refuse_line(path, number)


def _refuse_line(path: Path, number: int) -> None:
    raise InputError(f"line {number} is cut short or damaged", where=path, remedy=_CUT)
