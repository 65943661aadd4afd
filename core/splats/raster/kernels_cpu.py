"""Warp kernels of the CPU: one per stage, each a native body from the headers beside this file."""

# No `from __future__ import annotations`: Warp evaluates the annotations of kernels.
from enum import IntEnum

import warp as wp

from .headers import read_headers
from .state import State

_HEADERS = ("numeric.h", "projection.h", "binning.h", "stages_cpu.h", "blend_cpu.h", "loss.h", "loss_cpu.h", "adam.h")


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
    """As `Stage` in stages_cpu.h: index of a stage's chunk counter."""

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


@wp.func_native("raster::project_stage(s);")
def native_project(s: State): ...


@wp.func_native("raster::sort_stage(s);")
def native_sort(s: State): ...


@wp.func_native("raster::count_stage(s);")
def native_count(s: State): ...


@wp.func_native("raster::offsets_stage(s);")
def native_offsets(s: State): ...


@wp.func_native("raster::list_stage(s);")
def native_list(s: State): ...


@wp.func_native("raster::forward_stage(s);")
def native_forward(s: State): ...


@wp.func_native("raster::loss_stage(s, worker);")
def native_loss(s: State, worker: wp.int32): ...


@wp.func_native("raster::backward_stage(s);")
def native_backward(s: State): ...


@wp.func_native("raster::gather_stage(s);")
def native_gather(s: State): ...


@wp.func_native("raster::adam_stage(s);")
def native_adam(s: State): ...


@wp.kernel
def project(s: State, worker: wp.int32):
    native_project(s)


@wp.kernel
def sort(s: State, worker: wp.int32):
    native_sort(s)


@wp.kernel
def count(s: State, worker: wp.int32):
    native_count(s)


@wp.kernel
def offsets(s: State, worker: wp.int32):
    native_offsets(s)


@wp.kernel
def list_tiles(s: State, worker: wp.int32):
    native_list(s)


@wp.kernel
def forward(s: State, worker: wp.int32):
    native_forward(s)


@wp.kernel
def loss(s: State, worker: wp.int32):
    native_loss(s, worker)


@wp.kernel
def backward(s: State, worker: wp.int32):
    native_backward(s)


@wp.kernel
def gather(s: State, worker: wp.int32):
    native_gather(s)


@wp.kernel
def adam(s: State, worker: wp.int32):
    native_adam(s)


KERNELS = {
    Stage.PROJECT: project,
    Stage.SORT: sort,
    Stage.COUNT: count,
    Stage.OFFSETS: offsets,
    Stage.LIST: list_tiles,
    Stage.FORWARD: forward,
    Stage.LOSS: loss,
    Stage.BACKWARD: backward,
    Stage.GATHER: gather,
    Stage.ADAM: adam,
}
