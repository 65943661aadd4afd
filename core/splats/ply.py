"""Standard 3DGS PLY files, in and out. numpy only: Blender's Python imports this.

The layout is that of the 3D Gaussian Splatting paper, which viewers agree on: binary little endian,
float32 ``x y z [nx ny nz] f_dc_0..2 f_rest_0..3(K-1)-1 opacity scale_0..2 rot_0..3``; scales are natural logarithms,
opacity is a logit, rotation is wxyz, and ``f_rest`` is channel-major (all of red, then green, then blue).
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from ..errors import InputError
from .gaussians import Gaussians

_REQUIRED = (
    "x",
    "y",
    "z",
    "f_dc_0",
    "f_dc_1",
    "f_dc_2",
    "opacity",
    "scale_0",
    "scale_1",
    "scale_2",
    "rot_0",
    "rot_1",
    "rot_2",
    "rot_3",
)
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
_HEADER_LIMIT = 64 * 1024
_USE_ANOTHER = "choose a 3D Gaussian splatting .ply (from this software, SuperSplat, Postshot, ...)"


def write_ply(path: str | Path, gaussians: Gaussians) -> None:
    """Write `gaussians` to `path` through a temporary name in the same folder, so that no half file is ever seen."""
    path = Path(path)
    rest = gaussians.sh.shape[1] - 1
    names = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"]
    names += [f"f_rest_{i}" for i in range(3 * rest)]
    names += ["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
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
    temporary = path.with_name(path.name + ".partial")
    try:
        with open(temporary, "wb") as file:
            file.write("\n".join(header).encode("ascii"))
            file.write(table.data)
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def read_ply(path: str | Path) -> Gaussians:
    """Read a 3DGS PLY of SH degree 0 to 3.

    Raises:
        InputError: not a PLY, not a splat PLY (a mesh, a plain point cloud), cut short, or of an unknown layout.
    """
    path = Path(path)
    try:
        with open(path, "rb") as file:
            count, dtype = _read_header(file, path)
            available = path.stat().st_size - file.tell()
            if count * dtype.itemsize > available:
                missing = count - available // dtype.itemsize
                raise InputError(
                    f"the file is cut short: {missing} of {count} Gaussians are missing",
                    where=path,
                    remedy="copy or export it again",
                )
            table = np.fromfile(file, dtype, count)
    except OSError as error:
        raise InputError(
            f"cannot be read ({error.strerror})", where=path, remedy="check the path and its permissions"
        ) from None
    rest_count = sum(name.startswith("f_rest_") for name in dtype.names or ())
    if rest_count not in (0, 9, 24, 45):
        raise InputError(
            f"{rest_count} f_rest properties fit no SH degree from 0 to 3", where=path, remedy=_USE_ANOTHER
        )
    rest = rest_count // 3

    def columns(*names: str) -> np.ndarray:
        return np.stack([table[name].astype(np.float32) for name in names], axis=1)

    sh = np.empty((count, 1 + rest, 3), np.float32)
    sh[:, 0] = columns("f_dc_0", "f_dc_1", "f_dc_2")
    if rest:
        sh[:, 1:] = columns(*(f"f_rest_{i}" for i in range(rest_count))).reshape(count, 3, rest).transpose(0, 2, 1)
    return Gaussians(
        means=columns("x", "y", "z"),
        log_scales=columns("scale_0", "scale_1", "scale_2"),
        quaternions=columns("rot_0", "rot_1", "rot_2", "rot_3"),
        opacity_logits=table["opacity"].astype(np.float32),
        sh=sh,
    )


def _read_header(file, path: Path) -> tuple[int, np.dtype]:
    """Parse the header; leave `file` at the first vertex."""
    if file.readline(8).strip() != b"ply":
        raise InputError("not a PLY file", where=path, remedy=_USE_ANOTHER)
    count, element = -1, ""
    fields: list[tuple[str, str]] = []
    encoding = ""
    while file.tell() < _HEADER_LIMIT:
        words = file.readline(1024).decode("ascii", "replace").split()
        if not words or words[0] == "comment":
            if not words and file.tell() >= path.stat().st_size:
                break
            continue
        if words[0] == "end_header":
            break
        if words[0] == "format" and len(words) > 1:
            encoding = words[1]
        elif words[0] == "element" and len(words) == 3:
            if count >= 0 and element == "vertex" and not fields:
                break
            element = words[1]
            if element == "vertex":
                count = int(words[2]) if words[2].isdigit() else -1
            elif count < 0:
                raise InputError(f"its first element is '{element}', not 'vertex'", where=path, remedy=_USE_ANOTHER)
        elif words[0] == "property" and element == "vertex":
            if len(words) != 3 or words[1] not in _TYPES:
                raise InputError(
                    f"a vertex property is not a plain number: {' '.join(words)}", where=path, remedy=_USE_ANOTHER
                )
            fields.append((words[2], "<" + _TYPES[words[1]]))
    else:
        raise InputError("its header has no end", where=path, remedy=_USE_ANOTHER)
    names = [name for name, _ in fields]
    missing = [name for name in _REQUIRED if name not in names]
    if missing or count < 0 or len(set(names)) != len(names):
        raise InputError(
            f"a mesh or point cloud, not Gaussians (no {', '.join(missing[:3]) or 'vertex count'})",
            where=path,
            remedy=_USE_ANOTHER,
        )
    if encoding != "binary_little_endian":
        raise InputError(
            f"encoding '{encoding}' is not supported", where=path, remedy="export it as binary little endian"
        )
    return count, np.dtype(fields)
