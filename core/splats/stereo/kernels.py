"""The Warp kernel of dense stereo: its state, and the native body from the header beside this file. CPU only."""

# No `from __future__ import annotations`: Warp evaluates the annotations of kernels and structures.
from importlib import resources

import warp as wp

from ..raster.state import read_headers

MOST_NEIGHBOURS = 8  # as in stereo.h
_PLANES, _LANES = 7, 8  # as in stereo.h and numeric.h

wp.set_module_options(
    {
        "enable_backward": False,
        "cpu_compiler_flags": "-march=native -O3 -ffp-contract=fast",  # as the rasteriser's kernels
        "extra_build_options": wp.ModuleBuildOptions(
            extra_cpu_preamble=read_headers(("numeric.h",))
            + resources.files(__package__).joinpath("stereo.h").read_text(encoding="utf-8").replace("#pragma once", "")
        ),
    }
)


@wp.struct
class StereoState:
    """All views: what is compared, and the depth of each of their pixels."""

    counter: wp.array(dtype=wp.int32)  # the next view
    views: wp.int32
    levels: wp.int32
    most_pixels: wp.int32  # of a view
    sizes: wp.array2d(dtype=wp.int32)  # width and height of each view
    first_pixel: wp.array(dtype=wp.int32)  # of each view
    images: wp.array2d(dtype=wp.float32)  # per pixel: red, green, blue in [0, 1], coverage
    neighbour_count: wp.int32
    neighbours: wp.array2d(dtype=wp.int32)  # of each view, -1 after the last
    pairs: wp.array3d(dtype=wp.float32)  # per view and neighbour: `PAIR_FLOATS` of stereo.h
    ranges: wp.array2d(dtype=wp.float32)  # per view: the first inverse depth and the step between levels
    noise: wp.float32
    color_weight: wp.float32
    most_difference: wp.float32
    unseen: wp.float32
    small_step: wp.float32
    large_step: wp.float32
    evidence: wp.float32
    scratch: wp.array(dtype=wp.float32)
    scratch_floats: wp.int64
    inverse_depth: wp.array(dtype=wp.float32)  # per pixel


@wp.func_native("raster::stereo_stage(s, worker);")
def _native(s: StereoState, worker: wp.int32): ...


@wp.kernel
def stereo(s: StereoState, worker: wp.int32):
    """Depth maps of the views that this worker takes."""
    _native(s, worker)


def scratch_floats(pixels: int, levels: int) -> int:
    """Floats that one worker needs; as `SweepMemory` of stereo.h lays them out."""
    padded = -(-pixels // _LANES) * _LANES
    row = levels + 2 * _LANES
    return padded * (2 * levels + 2 * _PLANES + MOST_NEIGHBOURS + row) + 2 * row
