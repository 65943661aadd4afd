"""The text form of a COLMAP model, line by line."""

from __future__ import annotations

import codecs
import os
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import BinaryIO

import pycolmap

from ..errors import InputError
from ..files.untrusted import opened
from ..runtime.protocol import Reporter
from .colmap_records import (
    BLOCK,
    EXPORT_AGAIN,
    MOST_BYTES,
    MOST_POINT_BYTES,
    PARAMETER_COUNTS,
    STAGE,
    ColmapImage,
    Points,
    make_camera,
    require,
    require_known_model,
)

_LONGEST_LINE = 16 << 20  # bytes: the features of an image, hundreds of thousands


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
            require(self._ended or len(line) < _LONGEST_LINE, f"line {self.number} is too long", self.path)
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
        require(whole, f"the file is cut short or damaged ({count} of {self._promised} entries are there)", self.path)

    def refuse(self) -> InputError:
        return InputError(f"line {self.number} is cut short or damaged", where=self.path, remedy=EXPORT_AGAIN)

    def parse(self, kind: Callable[[str], float], words: Sequence[str]) -> list:
        """The `words` as numbers."""
        try:
            return [kind(word) for word in words]
        except ValueError:
            raise self.refuse() from None


def text_cameras(path: Path) -> Iterator[tuple[int, pycolmap.Camera]]:
    with opened(path, most_bytes=MOST_BYTES) as file:
        lines, count = _Lines(file, path), 0
        for line in lines:
            words = line.split()
            if not words:
                continue
            if len(words) < 4:
                raise lines.refuse()
            require_known_model(words[1] in PARAMETER_COUNTS, words[1], path)
            if len(words) != 4 + PARAMETER_COUNTS[words[1]]:
                raise lines.refuse()
            number, *size = lines.parse(int, [words[0], *words[2:4]])
            count += 1
            yield number, make_camera(number, words[1], size, lines.parse(float, words[4:]), path)
        lines.check_count(count)


def text_images(path: Path) -> Iterator[ColmapImage]:
    with opened(path, most_bytes=MOST_BYTES) as file:
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


def text_points(path: Path, reporter: Reporter) -> Points:
    points = Points()
    with opened(path, most_bytes=MOST_POINT_BYTES) as file:
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
            if count % BLOCK == 0:
                reporter.progress(STAGE, lines.fraction, f"{count:,} points")
        lines.check_count(count)
    return points
