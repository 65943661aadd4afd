"""Standard 3DGS PLY files, in and out. numpy only: Blender's Python imports this.

The layout is that of the 3D Gaussian Splatting paper, which viewers agree on: binary little endian,
float32 ``x y z [nx ny nz] f_dc_0..2 f_rest_0..3(K-1)-1 opacity scale_0..2 rot_0..3``; scales are natural logarithms,
opacity is a logit, rotation is wxyz, and ``f_rest`` is channel-major (all of red, then green, then blue). Read are any
order, type and byte order of these properties, others beside them, and files in text.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from .gaussians import Gaussians
from .whole_file import reading, writing_whole

_POSITION = ("x", "y", "z")
_BASE_COLOR = ("f_dc_0", "f_dc_1", "f_dc_2")
_SCALE = ("scale_0", "scale_1", "scale_2")
_ROTATION = ("rot_0", "rot_1", "rot_2", "rot_3")
_REQUIRED = (*_POSITION, *_BASE_COLOR, "opacity", *_SCALE, *_ROTATION)
_TYPES = {
    "char": "i1",
    "int8": "i1",
    "uchar": "u1",
    "uint8": "u1",
    "short": "i2",
    "int16": "i2",
    "ushort": "u2",
    "uint16": "u2",
    "int": "i4",
    "int32": "i4",
    "uint": "u4",
    "uint32": "u4",
    "float": "f4",
    "float32": "f4",
    "double": "f8",
    "float64": "f8",
}
_BYTE_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">"}
_TEXT = "ascii"
_HEADER_LIMIT = 64 * 1024  # bytes
_BLOCK = 1 << 20  # bytes read at a time: what stays in a processor's second cache while its columns are taken apart
_USE_ANOTHER = "choose a 3D Gaussian splatting .ply (from this software, SuperSplat, Postshot, ...)"


def write_ply(path: str | Path, gaussians: Gaussians) -> None:
    """Write `gaussians` to `path` through a temporary name in the same folder, so that no half file is ever seen."""
    rest = gaussians.sh.shape[1] - 1
    names = [*_POSITION, "nx", "ny", "nz", *_BASE_COLOR, *(f"f_rest_{i}" for i in range(3 * rest))]
    names += ["opacity", *_SCALE, *_ROTATION]
    count = len(gaussians)
    table = np.zeros((count, len(names)), "<f4")
    columns = {name: i for i, name in enumerate(names)}
    table[:, 0:3] = gaussians.means
    table[:, 6:9] = gaussians.sh[:, 0]
    table[:, 9 : 9 + 3 * rest] = gaussians.sh[:, 1:].transpose(0, 2, 1).reshape(count, 3 * rest)
    table[:, columns["opacity"]] = gaussians.opacity_logits
    table[:, columns["scale_0"] : columns["scale_0"] + 3] = gaussians.log_scales
    table[:, columns["rot_0"] : columns["rot_0"] + 4] = gaussians.quaternions
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {count}"]
    header += [f"property float {name}" for name in names] + ["end_header", ""]
    with writing_whole(Path(path)) as file:
        file.write("\n".join(header).encode("ascii"))
        file.write(table.data)


def read_ply(path: str | Path) -> Gaussians:
    """Read a 3DGS PLY of SH degree 0 to 3.

    Raises:
        InputError: not a PLY, not a splat PLY (a mesh, a plain point cloud), cut short, or of an unknown layout.
    """
    path = Path(path)
    with reading(path) as file:
        header = _read_header(file, path)
        rest_count = sum(name.startswith("f_rest_") for name in header.names)
        if rest_count not in (0, 9, 24, 45):
            raise InputError(
                f"{rest_count} f_rest properties fit no SH degree from 0 to 3", where=path, remedy=_USE_ANOTHER
            )
        _require_whole(header, path, path.stat().st_size - file.tell())
        return _gather(header, _blocks(header, file, path), rest_count // 3)


@dataclass
class _Header:
    """The header's account of the vertices: their number, byte order (or text) and properties (name, numpy type)."""

    count: int = -1
    encoding: str = ""
    properties: list[tuple[str, str]] = field(default_factory=list)

    @property
    def names(self) -> list[str]:
        return [name for name, _ in self.properties]

    @property
    def dtype(self) -> np.dtype:
        """Of one vertex; text is read as double precision throughout."""
        if self.encoding == _TEXT:
            return np.dtype([(name, "f8") for name in self.names])
        order = _BYTE_ORDERS[self.encoding]
        return np.dtype([(name, order + kind) for name, kind in self.properties])


def _read_header(file: BinaryIO, path: Path) -> _Header:
    """Parse the header; leave `file` at the first vertex."""
    if file.readline(8).strip() != b"ply":
        raise InputError("not a PLY file", where=path, remedy=_USE_ANOTHER)
    header, element = _Header(), ""
    while True:
        line = file.readline(_HEADER_LIMIT)
        if not line or file.tell() > _HEADER_LIMIT:
            raise InputError("its header has no end", where=path, remedy=_USE_ANOTHER)
        words = line.decode("ascii", "replace").split()
        if words == ["end_header"]:
            break
        if words[:1] == ["format"] and len(words) > 1:
            header.encoding = words[1]
        elif words[:1] == ["element"] and len(words) == 3:
            element = words[1]
            if element == "vertex":
                header.count = int(words[2]) if words[2].isdecimal() and header.count < 0 else -1
            elif header.count < 0:
                raise InputError(_why_not_first(element), where=path, remedy=_USE_ANOTHER)
        elif words[:1] == ["property"] and element == "vertex":
            if len(words) != 3 or words[1] not in _TYPES:
                raise InputError(
                    f"a vertex property is not a plain number: {' '.join(words)}", where=path, remedy=_USE_ANOTHER
                )
            header.properties.append((words[2], _TYPES[words[1]]))
    _require_gaussians(header, path)
    return header


def _why_not_first(element: str) -> str:
    if element == "chunk":
        return "a compressed PLY (SuperSplat), whose layout is another"
    return f"its first element is '{element}', not 'vertex'"


def _require_gaussians(header: _Header, path: Path) -> None:
    missing = [name for name in _REQUIRED if name not in header.names]
    if missing or header.count < 0:
        raise InputError(
            f"a mesh or point cloud, not Gaussians (no {', '.join(missing[:3]) or 'vertex count'})",
            where=path,
            remedy=_USE_ANOTHER,
        )
    if len(set(header.names)) != len(header.names):
        raise InputError("a property is there twice", where=path, remedy=_USE_ANOTHER)
    if header.encoding not in (*_BYTE_ORDERS, _TEXT):
        raise InputError(
            f"encoding '{header.encoding}' is unknown", where=path, remedy="export it as binary little endian"
        )


def _require_whole(header: _Header, path: Path, available: int) -> None:
    """Refuse a header that claims more than the `available` bytes can hold, before anything is allocated."""
    # A number in text takes a digit and a separator, which the last one may lack.
    size = 2 * len(header.names) if header.encoding == _TEXT else header.dtype.itemsize
    spare = 1 if header.encoding == _TEXT else 0
    if header.count * size > available + spare:
        raise _cut_short(header.count, available // size, path)


def _cut_short(count: int, present: int, path: Path) -> InputError:
    return InputError(
        f"the file is cut short: {count - present} of {count} Gaussians are missing",
        where=path,
        remedy="copy or export it again",
    )


def _blocks(header: _Header, file: BinaryIO, path: Path) -> Iterator[NDArray]:
    """The vertices as structured arrays, a block at a time."""
    dtype = header.dtype
    rows = max(_BLOCK // dtype.itemsize, 1)
    for start in range(0, header.count, rows):
        wanted = min(rows, header.count - start)
        if header.encoding == _TEXT:
            block = _numbers(file, wanted, len(header.names)).view(dtype)[:, 0]
        else:
            block = np.fromfile(file, dtype, wanted)
        if len(block) < wanted:
            raise _cut_short(header.count, start + len(block), path)
        yield block


def _numbers(file: BinaryIO, rows: int, columns: int) -> NDArray[np.float64]:
    """(R, columns) numbers in text; R is less than `rows` where the text ends or stops being numbers."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # numpy's way to say that it stops being numbers
        numbers = np.fromfile(file, np.float64, rows * columns, sep=" ")
    return numbers[: len(numbers) // columns * columns].reshape(-1, columns)


def _gather(header: _Header, blocks: Iterator[NDArray], rest: int) -> Gaussians:
    """The columns of all blocks as `Gaussians` with `rest` colour terms above degree 0."""
    count = header.count
    means, log_scales = np.empty((count, 3), np.float32), np.empty((count, 3), np.float32)
    quaternions, opacity_logits = np.empty((count, 4), np.float32), np.empty(count, np.float32)
    sh = np.empty((count, 1 + rest, 3), np.float32)
    targets = [(means[:, i], name) for i, name in enumerate(_POSITION)]
    targets += [(log_scales[:, i], name) for i, name in enumerate(_SCALE)]
    targets += [(quaternions[:, i], name) for i, name in enumerate(_ROTATION)]
    targets += [(opacity_logits, "opacity")]
    targets += [(sh[:, 0, i], name) for i, name in enumerate(_BASE_COLOR)]
    targets += [(sh[:, 1 + i % rest, i // rest], f"f_rest_{i}") for i in range(3 * rest)]
    start = 0
    with np.errstate(over="ignore"):  # what float32 cannot hold becomes infinite, which callers look for
        for block in blocks:
            end = start + len(block)
            for target, name in targets:
                target[start:end] = block[name]
            start = end
    return Gaussians(means, log_scales, quaternions, opacity_logits, sh)
