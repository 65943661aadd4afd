"""Warp kernels of CUDA: native bodies from the headers beside this file, compiled by Warp's NVRTC."""

# No `from __future__ import annotations`: Warp evaluates the annotations of kernels.
# mypy: disable-error-code="misc"
import warp as wp

from .state import State, read_headers

BLEND_THREADS = 128  # of a block: the pixels of a tile
LOSS_THREADS = 256  # of a block: the pixels of a square of loss_cuda.h
LOSS_SQUARE = 16  # pixels; as in loss_cuda.h

_HEADERS = (
    "numeric.h", "projection.h", "binning.h", "stages_cuda.h", "blend_cuda.h", "loss.h", "loss_cuda.h", "contrast.h",
    "adam.h",
)  # fmt: skip

wp.set_module_options(
    {
        "enable_backward": False,
        "extra_build_options": wp.ModuleBuildOptions(extra_cuda_preamble=read_headers(_HEADERS)),
    }
)


def _per_thread(name: str, body: str) -> wp.Kernel:
    """A kernel with one thread for each element n, whose work is the function `body` of the headers."""

    @wp.func_native(f"raster::{body}(s, n);")
    def native(s: State, n: wp.int32): ...

    @wp.kernel(name=name)
    def kernel(s: State):
        native(s, wp.tid())

    return kernel


def _per_block(name: str, body: str) -> wp.Kernel:
    """A kernel with one block of threads for each tile or square, whose work is the function `body` of the headers."""

    @wp.func_native(f"raster::{body}(s, block, thread);")
    def native(s: State, block: wp.int32, thread: wp.int32): ...

    @wp.kernel(name=name)
    def kernel(s: State):
        block, thread = wp.tid()
        native(s, block, thread)

    return kernel


@wp.func_native("raster::list_entry(s, k, count);")
def native_list(s: State, k: wp.int32, count: wp.int32): ...


@wp.kernel
def list_entries(s: State, count: wp.int32):
    native_list(s, wp.tid(), count)


project = _per_thread("project", "project_one")
count_slots = _per_thread("count_slots", "count_slots")
fill_slots = _per_thread("fill_slots", "fill_slots")
gather = _per_thread("gather", "gather_one")
adam = _per_thread("adam", "adam_one")
observe = _per_thread("observe", "observe_one")
list_pairs = _per_thread("list_pairs", "list_pairs")
contrast = _per_thread("contrast", "contrast_gradient_one")
forward = _per_block("forward", "forward_tile")
ssim = _per_block("ssim", "ssim_block")
loss = _per_block("loss", "loss_block")
backward = _per_block("backward", "backward_tile")
