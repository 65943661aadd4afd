"""Warp kernels of the CPU: one per stage, each a native body from the headers beside this file."""

# No `from __future__ import annotations`: Warp evaluates the annotations of kernels.
from enum import IntEnum

import warp as wp

from .state import State, read_headers

_HEADERS = (
    "numeric.h", "projection.h", "binning.h", "stages_cpu.h", "blend_cpu.h", "loss.h", "loss_cpu.h", "contrast.h",
    "adam.h",
)  # fmt: skip

wp.set_module_options(
    {
        "enable_backward": False,
        # `native` makes Warp name the cached object after this processor's features; contraction uses its fused
        # multiply-add. Nothing that lets the compiler assume finite numbers or reorder sums.
        "cpu_compiler_flags": "-march=native -O3 -ffp-contract=fast",
        "extra_build_options": wp.ModuleBuildOptions(extra_cpu_preamble=read_headers(_HEADERS)),
    }
)


class Stage(IntEnum):
    """As `Stage` in stages_cpu.h: index of a stage's chunk counter. Each is a function of the headers, too."""

    PROJECT = 0
    SORT = 1
    COUNT = 2
    OFFSETS = 3
    LIST = 4
    FORWARD = 5
    LOSS = 6
    BACKWARD = 7
    GATHER = 8
    ADAM = 9
    OBSERVE = 10
    PAIRS = 11
    CONTRAST = 12


def _kernel(stage: Stage) -> wp.Kernel:
    name, arguments = stage.name.lower(), "s, worker" if stage is Stage.LOSS else "s"

    @wp.func_native(f"raster::{name}_stage({arguments});")
    def native(s: State, worker: wp.int32): ...

    @wp.kernel(name=f"{name}_stage")
    def kernel(s: State, worker: wp.int32):
        native(s, worker)

    return kernel


KERNELS = {stage: _kernel(stage) for stage in Stage}
