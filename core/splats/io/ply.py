"""Standard 3DGS PLY files, in and out. numpy only: Blender's Python imports this.

The layout is that of the 3D Gaussian Splatting paper, which viewers agree on: binary little endian,
float32 ``x y z [nx ny nz] f_dc_0..2 f_rest_0..3(K-1)-1 opacity scale_0..2 rot_0..3``; scales are natural logarithms,
opacity is a logit, rotation is wxyz, and ``f_rest`` is channel-major (all of red, then green, then blue). The reader
accepts these properties in any order, type and byte order, further properties beside them, and text files.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ...files.ply import VertexTable
from ...files.untrusted import opened, writing_whole
from ..floaters import PROPERTY
from ..gaussians import HIGHEST_SH_DEGREE, MOST_FILE_BYTES, SH_TERMS, Gaussians, require_room

_POSITION = ("x", "y", "z")
_BASE_COLOR = ("f_dc_0", "f_dc_1", "f_dc_2")
_SCALE = ("scale_0", "scale_1", "scale_2")
_ROTATION = ("rot_0", "rot_1", "rot_2", "rot_3")
_REQUIRED = (*_POSITION, *_BASE_COLOR, "opacity", *_SCALE, *_ROTATION)
EXPORT_PLAIN = "export a plain PLY (3DGS, not compressed) from the program it came from"
_NO_SCORES = f"its property {PROPERTY} holds no scores from 0 to 1"
_TERMS_KEPT = SH_TERMS[HIGHEST_SH_DEGREE]
_USE_ANOTHER = "choose a 3D Gaussian splatting .ply (from this software, SuperSplat, Postshot, ...)"


def write_ply(path: str | Path, gaussians: Gaussians, floaters: NDArray[np.float32] | None = None) -> None:
    """Write `gaussians` to `path`, through a temporary file in the same folder, so that it is never incomplete.

    Args:
        floaters: (N,) scores of `floaters.floater_scores`, which become a last property; `read_floaters` reads them.
    """
    rest = gaussians.sh.shape[1] - 1
    names = [*_POSITION, "nx", "ny", "nz", *_BASE_COLOR, *(f"f_rest_{i}" for i in range(3 * rest))]
    names += ["opacity", *_SCALE, *_ROTATION, *([] if floaters is None else [PROPERTY])]
    count = len(gaussians)
    table = np.zeros((count, len(names)), "<f4")
    columns = {name: i for i, name in enumerate(names)}
    table[:, 0:3] = gaussians.means
    table[:, 6:9] = gaussians.sh[:, 0]
    table[:, 9 : 9 + 3 * rest] = gaussians.sh[:, 1:].transpose(0, 2, 1).reshape(count, 3 * rest)
    table[:, columns["opacity"]] = gaussians.opacity_logits
    table[:, columns["scale_0"] : columns["scale_0"] + 3] = gaussians.log_scales
    table[:, columns["rot_0"] : columns["rot_0"] + 4] = gaussians.quaternions
    if floaters is not None:
        table[:, columns[PROPERTY]] = floaters
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {count}"]
    header += [f"property float {name}" for name in names] + ["end_header", ""]
    with writing_whole(Path(path)) as file:
        file.write("\n".join(header).encode("ascii"))
        file.write(table.data)


def read_ply(path: str | Path) -> Gaussians:
    """Read a 3DGS PLY of SH degree 0 to 4; terms above degree 3 are dropped.

    Raises:
        InputError: not a PLY, not a splat PLY (a mesh, a plain point cloud), cut short, or of an unknown layout.
    """
    path = Path(path)
    with opened(path, most_bytes=MOST_FILE_BYTES) as file:
        table = VertexTable(file, path, noun="Gaussians", remedy=_USE_ANOTHER, if_compressed=EXPORT_PLAIN)
        # Flat Gaussians (2DGS) have opacities too, and two scales.
        kind = "Gaussians of another kind" if "opacity" in table.names else "a mesh or point cloud, not Gaussians"
        table.require(_REQUIRED, kind)
        rest_count = sum(name.startswith("f_rest_") for name in table.names)
        if rest_count not in [3 * terms for terms in SH_TERMS]:
            raise InputError(
                f"its {rest_count} f_rest properties fit no SH degree from 0 to 4", where=path, remedy=_USE_ANOTHER
            )
        table.require(tuple(f"f_rest_{i}" for i in range(rest_count)), "its colour terms are not consecutive")
        require_room(table.count, min(rest_count // 3, _TERMS_KEPT), path)
        return _gather(table, rest_count // 3)


def read_floaters(path: str | Path) -> NDArray[np.float32] | None:
    """(N,) scores in [0, 1] that `write_ply` wrote with the Gaussians of a file; None where it has none.

    Raises:
        InputError: not a PLY, cut short, or scores that are no numbers from 0 to 1.
    """
    path = Path(path)
    with opened(path, most_bytes=MOST_FILE_BYTES) as file:
        table = VertexTable(file, path, noun="Gaussians", remedy=_USE_ANOTHER, if_compressed=EXPORT_PLAIN)
        if PROPERTY not in table.names:
            return None
        table.require((PROPERTY,), _NO_SCORES)
        require_room(table.count, 0, path)
        scores = np.concatenate([np.zeros(0, np.float32), *(block[PROPERTY] for block in table.blocks())])
    if not ((scores >= 0.0) & (scores <= 1.0)).all():
        raise InputError(_NO_SCORES, where=path, remedy=_USE_ANOTHER)
    return scores.astype(np.float32)


def _gather(table: VertexTable, rest: int) -> Gaussians:
    """The columns of the table, which has `rest` colour terms per channel above degree 0, as `Gaussians`."""
    count, kept = table.count, min(rest, _TERMS_KEPT)
    means, log_scales = np.empty((count, 3), np.float32), np.empty((count, 3), np.float32)
    quaternions, opacity_logits = np.empty((count, 4), np.float32), np.empty(count, np.float32)
    sh = np.empty((count, 1 + kept, 3), np.float32)
    targets = [(means[:, i], name) for i, name in enumerate(_POSITION)]
    targets += [(log_scales[:, i], name) for i, name in enumerate(_SCALE)]
    targets += [(quaternions[:, i], name) for i, name in enumerate(_ROTATION)]
    targets += [(opacity_logits, "opacity")]
    targets += [(sh[:, 0, i], name) for i, name in enumerate(_BASE_COLOR)]
    # Red's terms come first, then green's and blue's, so dropped ones are at the end of each channel.
    targets += [(sh[:, 1 + i % rest, i // rest], f"f_rest_{i}") for i in range(3 * rest) if i % rest < kept]
    start = 0
    with np.errstate(over="ignore"):  # what float32 cannot hold becomes infinite, which callers check for
        for block in table.blocks():
            end = start + len(block)
            for target, name in targets:
                target[start:end] = block[name]
            start = end
    return Gaussians(means, log_scales, quaternions, opacity_logits, sh)
