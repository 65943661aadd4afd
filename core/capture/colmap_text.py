"""The text form of a COLMAP model's files, read line by line."""

from __future__ import annotations

import codecs
import os
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import BinaryIO

import numpy as np
import pycolmap
from numpy.typing import NDArray

from ..errors import InputError
from ..files.untrusted import opened
from ..runtime.protocol import Reporter
from .colmap_records import (
    BLOCK,
    EXPORT_AGAIN,
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

_LONGEST_LINE = 16 << 20  # bytes: the features of an image, hundreds of thousands
_START_BYTES = 4096  # COLMAP's header and the first entry have some 500
_MOST_POINT_NUMBER = 2**63 - 1


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
        require(whole, what, self.path)

    def next_line(self) -> str:
        """The line after an entry's, or "" at the end of the file."""
        return next(self._lines, "")

    def _read(self) -> Iterator[str]:
        while line := self._file.readline(_LONGEST_LINE):
            self.number += 1
            line = line.removeprefix(codecs.BOM_UTF8) if self.number == 1 else line
            self._ended = line.endswith(b"\n")
            require(self._ended or len(line) < _LONGEST_LINE, f"line {self.number} is too long", self.path)
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
        require(condition, f"line {self.number} is cut short or damaged", self.path)

    def parse(self, kind: Callable[[str], float], words: Sequence[str]) -> list:
        """The `words` as numbers."""
        try:
            return [kind(word) for word in words]
        except ValueError:
            self.require(False)
            raise


def lists_poses(path: Path) -> bool:
    """Whether an ``images.txt`` is of COLMAP, by its header or its first entry. Others list photographs in such a file.

    Raises:
        InputError: it cannot be read.
    """
    with opened(path, most_bytes=MOST_BYTES) as file:
        lines = file.read(_START_BYTES).removeprefix(codecs.BOM_UTF8).splitlines()
    if any(line.startswith(b"#") and b"IMAGE_ID" in line for line in lines):
        return True
    entry = next((words for line in lines if (words := line.split()) and not line.startswith(b"#")), [])
    try:
        return len([float(word) for word in entry[:9]]) == 9
    except ValueError:
        return False


def text_cameras(path: Path) -> Iterator[tuple[int, pycolmap.Camera]]:
    """The cameras of a ``cameras.txt`` and their numbers."""
    with opened(path, most_bytes=MOST_BYTES) as file:
        lines = _Lines(file, path)
        for words in lines.entries(4):
            model = words[1]
            require_known_model(model in PARAMETER_COUNTS, model, path)
            lines.require(len(words) == 4 + PARAMETER_COUNTS[model])
            number, *size = lines.parse(int, [words[0], *words[2:4]])
            yield number, make_camera(number, model, size, lines.parse(float, words[4:]), path)


def text_images(path: Path, *, observed: bool = False) -> Iterator[ColmapImage]:
    """The posed images of an ``images.txt``, with their observations where these are asked for."""
    with opened(path, most_bytes=MOST_BYTES) as file:
        lines = _Lines(file, path)
        for words in lines.entries(10, most_splits=9):
            pose = lines.parse(float, words[1:8])
            _, camera_id = lines.parse(int, [words[0], words[8]])
            # The observations; an image without any has an empty line here.
            features = lines.next_line().split()
            lines.require(len(features) % 3 == 0)
            observations = _observations(lines, features if observed else [])
            yield ColmapImage(words[9], camera_id, tuple(pose[:4]), tuple(pose[4:]), observations)


def _observations(lines: _Lines, words: Sequence[str]) -> NDArray[np.void]:
    """(F,) `OBSERVATION` of the features that have a point."""
    features = np.zeros(len(words) // 3, OBSERVATION)
    with np.errstate(invalid="ignore"):  # a number that is beyond the range is one of no point
        features["position"] = np.array([lines.parse(float, words[0::3]), lines.parse(float, words[1::3])]).T
        features["point"] = np.array(lines.parse(float, words[2::3])).astype(np.int64)
    return features[features["point"] >= 0]


def text_points(path: Path, reporter: Reporter) -> Points:
    """The points of a ``points3D.txt``."""
    points = Points()
    with opened(path, most_bytes=MOST_POINT_BYTES) as file:
        lines = _Lines(file, path)
        for words in lines.entries(8):
            lines.require(len(words) % 2 == 0)
            (number,), position, color = (
                lines.parse(kind, part) for kind, part in ((int, words[:1]), (float, words[1:4]), (int, words[4:7]))
            )
            lines.require(0 <= number <= _MOST_POINT_NUMBER)
            lines.require(all(0 <= channel <= 255 for channel in color))
            points.add(number, position, color, (len(words) - 8) // 2)
            if lines.count % BLOCK == 0:
                reporter.progress(STAGE, lines.fraction, f"{lines.count:,} points")
    return points
