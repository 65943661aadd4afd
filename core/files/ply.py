"""The vertices of a PLY file as a table of numbers, whatever their order, types and byte order. numpy only: Blender's
Python imports this.

Read are files whose first element is ``vertex`` and whose vertices are plain numbers, binary or in text; what follows
the vertices is left alone. A header that claims more than the file holds is refused before anything is allocated.
"""

from __future__ import annotations

import warnings
from bisect import bisect_left
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError

_TYPES = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"}
_TYPES |= {"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"}
_TYPES |= {"float": "f4", "double": "f8", "float32": "f4", "float64": "f8"}
_BYTE_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">"}
_TEXT = "ascii"
_HEADER_LIMIT = 64 * 1024  # bytes
_COUNT_DIGITS = 18  # of a number of vertices; more are no number that a file could hold
_BLOCK = 1 << 20  # bytes read at a time: what stays in a processor's second cache while its columns are taken apart


class VertexTable:
    """The vertices of an open PLY file.

    Args:
        file: at its beginning.
        path: of the file, for messages.
        noun: what a vertex stands for, in the plural.
        remedy: what the user can do where the file is something else.
        if_compressed: likewise where it is one of SuperSplat's compressed PLY files; `remedy` if it is left out.

    Attributes:
        count: of the vertices.
        names: of the properties, in the file's order.

    Raises:
        InputError: not a PLY file, cut short, or of a layout that is not read.
    """

    def __init__(self, file: BinaryIO, path: Path, *, noun: str, remedy: str, if_compressed: str = "") -> None:
        self._file, self._path, self._noun, self._remedy = file, path, noun, remedy
        self._if_compressed = if_compressed or remedy
        self.count = -1
        self._encoding = ""
        self._properties: list[tuple[str, str]] = []
        self._read_header()

    @property
    def names(self) -> list[str]:
        return [name for name, _ in self._properties]

    def declared_type(self, name: str) -> np.dtype:
        """What the header says that the property `name` is; text is read as double precision throughout."""
        return np.dtype(dict(self._properties)[name])

    def require(self, names: tuple[str, ...], what: str) -> None:
        """Raise `InputError` with `what` and the first missing names unless there are vertices with all of `names`."""
        missing = [name for name in names if name not in self.names]
        if missing or self.count < 0:
            raise self._refusal(f"{what} (no {', '.join(missing[:3]) or 'vertex count'})")
        if len(set(self.names)) != len(self.names):
            raise self._refusal("a property appears twice")
        if self._encoding not in (*_BYTE_ORDERS, _TEXT):
            raise InputError(
                f"encoding '{self._encoding}' is unknown", where=self._path, remedy="export it as binary little endian"
            )
        self._require_whole()

    def blocks(self) -> Iterator[NDArray]:
        """The vertices as structured arrays, a block at a time; for a table that `require` has accepted.

        Raises:
            InputError: the file is cut short.
        """
        dtype = self._dtype
        rows = max(_BLOCK // dtype.itemsize, 1)
        for start in range(0, self.count, rows):
            wanted = min(rows, self.count - start)
            if self._encoding == _TEXT:
                block = _numbers(self._file, wanted, len(self.names)).view(dtype)[:, 0]
            else:
                block = np.fromfile(self._file, dtype, wanted)
            if len(block) < wanted:
                raise self._cut_short(start + len(block))
            yield block

    @property
    def _dtype(self) -> np.dtype:
        if self._encoding == _TEXT:
            return np.dtype([(name, "f8") for name in self.names])
        order = _BYTE_ORDERS[self._encoding]
        return np.dtype([(name, order + kind) for name, kind in self._properties])

    def _read_header(self) -> None:
        """Parse the header; leave the file at the first vertex."""
        file, element = self._file, ""
        if file.readline(8).strip() != b"ply":
            raise self._refusal("not a PLY file")
        while True:
            line = file.readline(_HEADER_LIMIT)
            if not line or file.tell() > _HEADER_LIMIT:
                raise self._refusal("its header never ends")
            words = line.decode("ascii", "replace").split()
            if words == ["end_header"]:
                return
            if words[:1] == ["format"] and len(words) > 1:
                self._encoding = words[1]
            elif words[:1] == ["element"] and len(words) == 3:
                element = words[1]
                if element == "vertex":
                    self.count = self._parse_count(words[2])
                elif self.count < 0:
                    raise self._not_first(element)
            elif words[:1] == ["property"] and element == "vertex":
                self._add_property(words)

    def _parse_count(self, word: str) -> int:
        """The number of vertices, or -1 where it is none or the element is there twice."""
        if not word.isdecimal() or self.count >= 0:
            return -1
        if len(word) > _COUNT_DIGITS:
            raise self._refusal(f"it claims a number of {self._noun} with {len(word)} digits")
        return int(word)

    def _add_property(self, words: list[str]) -> None:
        if len(words) != 3 or words[1] not in _TYPES:
            raise self._refusal(f"a vertex property is not a plain number: {' '.join(words)}")
        self._properties.append((words[2], _TYPES[words[1]]))

    def _require_whole(self) -> None:
        """Refuse a header that claims more than the rest of the file can hold."""
        start = self._file.tell()
        available = self._file.seek(0, 2) - start
        self._file.seek(start)
        # A number in text takes a digit and a separator, which the last one may lack.
        size = 2 * len(self.names) if self._encoding == _TEXT else self._dtype.itemsize
        spare = 1 if self._encoding == _TEXT else 0
        if self.count * size > available + spare:
            raise self._cut_short(available // size)

    def _cut_short(self, present: int) -> InputError:
        return InputError(
            f"the file is cut short: {self.count - present} of {self.count} {self._noun} are missing",
            where=self._path,
            remedy="copy or export it again",
        )

    def _not_first(self, element: str) -> InputError:
        if element == "chunk":
            what = "a compressed PLY (SuperSplat), which has a different layout"
            return InputError(what, where=self._path, remedy=self._if_compressed)
        return self._refusal(f"its first element is '{element}', not 'vertex'")

    def _refusal(self, what: str) -> InputError:
        return InputError(what, where=self._path, remedy=self._remedy)


def _numbers(file: BinaryIO, rows: int, columns: int) -> NDArray[np.float64]:
    """(R, columns) numbers in text; R is less than `rows` where the text ends or stops being numbers."""
    start, wanted = file.tell(), rows * columns

    def read(count: int) -> NDArray[np.float64] | None:
        """Up to `count` numbers, or None: where the text stops being numbers, numpy may refuse all of them."""
        file.seek(start)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # or it may say this and return those before
            try:
                return np.fromfile(file, np.float64, count, sep=" ")
            except ValueError:
                return None

    numbers = read(wanted)
    if numbers is None:
        present = bisect_left(range(1, wanted), True, key=lambda count: read(count) is None)
        numbers = read(present) if present else np.empty(0)
        assert numbers is not None
    return numbers[: len(numbers) // columns * columns].reshape(-1, columns)
