"""Warp kernels of CUDA: native bodies from the headers beside this file, compiled by Warp's NVRTC."""

# No `from __future__ import annotations`: Warp evaluates the annotations of kernels.
# mypy: disable-error-code="misc"
import warp as wp

from .headers import read_headers
from .state import State

BLEND_THREADS = 128  # of a block: the pixels of a tile
LOSS_THREADS = 256  # of a block: the pixels of a square of loss_cuda.h
LOSS_SQUARE = 16  # pixels; as in loss_cuda.h

_HEADERS = (
    "numeric.h", "projection.h", "binning.h", "stages_cuda.h", "blend_cuda.h", "loss.h", "loss_cuda.h", "adam.h"
)  # fmt: skip

wp.set_module_options(
    {
        "enable_backward": False,
        "extra_build_options": wp.ModuleBuildOptions(extra_cuda_preamble=read_headers(_HEADERS)),
    }
)


@wp.func_native("raster::project_one(s, n);")
def native_project(s: State, n: wp.int32): ...


@wp.func_native("raster::count_slots(s, rank);")
def native_count(s: State, rank: wp.int32): ...


@wp.func_native("raster::fill_slots(s, rank);")
def native_fill(s: State, rank: wp.int32): ...


@wp.func_native("raster::list_entry(s, k, count);")
def native_list(s: State, k: wp.int32, count: wp.int32): ...


@wp.func_native("raster::forward_tile(s, tile, thread);")
def native_forward(s: State, tile: wp.int32, thread: wp.int32): ...


@wp.func_native("raster::ssim_block(s, block, thread);")
def native_ssim(s: State, block: wp.int32, thread: wp.int32): ...


@wp.func_native("raster::loss_block(s, block, thread);")
def native_loss(s: State, block: wp.int32, thread: wp.int32): ...


@wp.func_native("raster::backward_tile(s, tile, thread);")
def native_backward(s: State, tile: wp.int32, thread: wp.int32): ...


@wp.func_native("raster::gather_one(s, rank);")
def native_gather(s: State, rank: wp.int32): ...


@wp.func_native("raster::adam_one(s, n);")
def native_adam(s: State, n: wp.int32): ...


@wp.kernel
def project(s: State):
    native_project(s, wp.tid())


@wp.kernel
def count_slots(s: State):
    native_count(s, wp.tid())


@wp.kernel
def fill_slots(s: State):
    native_fill(s, wp.tid())


@wp.kernel
def list_entries(s: State, count: wp.int32):
    native_list(s, wp.tid(), count)


@wp.kernel
def forward(s: State):
    tile, thread = wp.tid()
    native_forward(s, tile, thread)


@wp.kernel
def ssim(s: State):
    block, thread = wp.tid()
    native_ssim(s, block, thread)


@wp.kernel
def loss(s: State):
    block, thread = wp.tid()
    native_loss(s, block, thread)


@wp.kernel
def backward(s: State):
    tile, thread = wp.tid()
    native_backward(s, tile, thread)


@wp.kernel
def gather(s: State):
    native_gather(s, wp.tid())


@wp.kernel
def adam(s: State):
    native_adam(s, wp.tid())
