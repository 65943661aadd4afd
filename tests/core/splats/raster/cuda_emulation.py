"""Runs the CUDA stages without a GPU: their C++ is compiled by g++, a thread of a block being a fiber.

What a GPU would do at once happens in turns; a barrier, shuffle or vote hands over to the next fiber until all have
arrived. That checks the kernels' arithmetic and their use of shared memory, not races and not speed.
"""

from __future__ import annotations

import ctypes
import subprocess
from pathlib import Path

import warp as wp

from cvdgs.core.splats.raster import kernels_cuda
from cvdgs.core.splats.raster.runner_cuda import CudaRunner
from cvdgs.core.splats.raster.state import State, read_headers

_C_TYPES = {
    wp.float32: "float",
    wp.int32: "int",
    wp.uint8: "unsigned char",
    wp.uint32: "unsigned",
    wp.float64: "double",
}
_PER_THREAD_BODY = {
    "project": "project_one",
    "count_slots": "count_slots",
    "fill_slots": "fill_slots",
    "gather": "gather_one",
    "adam": "adam_one",
}
_PER_BLOCK_BODY = {"forward": "forward_tile", "backward": "backward_tile", "ssim": "ssim_block", "loss": "loss_block"}

_FIBERS = r"""
#include <ucontext.h>
#include <cmath>
#include <cstdlib>
#include <cstring>
#define __CUDACC__ 1
#define __device__
#define __forceinline__ inline
#define __shared__ static
struct float4 { float x, y, z, w; };

enum { MOST_THREADS = 256, STACK = 1 << 16 };
static ucontext_t fibers[MOST_THREADS], scheduler;
static char stacks[MOST_THREADS][STACK];
static bool finished[MOST_THREADS];
static int threads, current;

static int following(int thread) {
    for (int i = 1; i <= threads; i++)
        if (!finished[(thread + i) % threads]) return (thread + i) % threads;
    return -1;
}

struct Barrier {
    int arrived = 0;
    long generation = 0;
    void wait(int count) {
        long mine = generation;
        if (++arrived == count) {
            arrived = 0;
            generation++;
            return;
        }
        while (generation == mine) {
            int from = current, to = following(from);
            if (to == from) abort();  // the others have left: a GPU would hang
            current = to;
            swapcontext(&fibers[from], &fibers[to]);
        }
    }
};

static Barrier block_barrier, warp_barriers[MOST_THREADS / 32];
static void __syncthreads() { block_barrier.wait(threads); }
static int __syncthreads_and(bool value) {
    static int all;
    __syncthreads();
    all = 1;
    __syncthreads();
    if (!value) all = 0;
    __syncthreads();
    return all;
}
static bool __any_sync(unsigned, bool value) {
    static bool any[MOST_THREADS / 32];
    int warp = current / 32;
    warp_barriers[warp].wait(32);
    any[warp] = false;
    warp_barriers[warp].wait(32);
    if (value) any[warp] = true;
    warp_barriers[warp].wait(32);
    return any[warp];
}
static float __shfl_xor_sync(unsigned, float value, int distance) {
    static float values[MOST_THREADS];
    int me = current;
    values[me] = value;
    warp_barriers[me / 32].wait(32);
    float other = values[me ^ distance];
    warp_barriers[me / 32].wait(32);
    return other;
}
"""

_BLOCKS = r"""
typedef void (*Body)(int block, int thread);
static Body body;
static int block;

static void run_fiber(int thread) {
    body(block, thread);
    finished[thread] = true;
    current = following(thread);
    setcontext(current < 0 ? &scheduler : &fibers[current]);
}

static void run_blocks(Body what, int blocks, int count) {
    body = what;
    threads = count;
    for (block = 0; block < blocks; block++) {
        for (int t = 0; t < threads; t++) {
            finished[t] = false;
            getcontext(&fibers[t]);
            fibers[t].uc_stack.ss_sp = stacks[t];
            fibers[t].uc_stack.ss_size = STACK;
            fibers[t].uc_link = nullptr;
            makecontext(&fibers[t], (void (*)())run_fiber, 1, t);
        }
        current = 0;
        swapcontext(&scheduler, &fibers[0]);
    }
}
"""


def _fields() -> list[tuple[str, str, bool]]:
    """Name, C type and whether it is an array, of every field of the state."""
    fields = []
    for name, variable in State.vars.items():
        is_array = isinstance(variable.type, wp.array)
        fields.append((name, _C_TYPES[variable.type.dtype if is_array else variable.type], is_array))
    return fields


def _source() -> str:
    members, setters = [], []
    for i, (name, c_type, is_array) in enumerate(_fields()):
        members.append(f"Array<{c_type}> {name};" if is_array else f"{c_type} {name};")
        value = f"state.{name}.data = ({c_type}*)pointer" if is_array else f"state.{name} = ({c_type})number"
        setters.append(f"case {i}: {value}; break;")
    entries = [
        f"void {name}(int n) {{ for (int i = 0; i < n; i++) raster::{body}(state, i); }}"
        for name, body in _PER_THREAD_BODY.items()
    ]
    entries += [
        f"void {name}(int n, int t) {{ run_blocks([](int b, int i) {{ raster::{body}(state, b, i); }}, n, t); }}"
        for name, body in _PER_BLOCK_BODY.items()
    ]
    entries.append("void list_entries(int n, int c) { for (int i = 0; i < n; i++) raster::list_entry(state, i, c); }")
    return "\n".join(
        [
            _FIBERS,
            read_headers(kernels_cuda._HEADERS),
            "template <class T> struct Array { T* data; };",
            "struct Fields {",
            *members,
            "};",
            "static Fields state;",
            _BLOCKS,
            'extern "C" {',
            "void set_field(int field, void* pointer, double number) { switch (field) {",
            *setters,
            "} }",
            *entries,
            "}",
        ]
    )


def compile_kernels(folder: Path) -> ctypes.CDLL:
    """Needs g++."""
    source, library = folder / "kernels.cpp", folder / "kernels.so"
    source.write_text(_source())
    options = ["-std=c++20", "-O1", "-w", "-fPIC", "-shared", "-fno-strict-aliasing"]
    subprocess.run(["g++", *options, "-o", str(library), str(source)], check=True)
    kernels = ctypes.CDLL(str(library))
    kernels.set_field.argtypes = [ctypes.c_int, ctypes.c_void_p, ctypes.c_double]
    return kernels


class EmulatedCudaRunner(CudaRunner):
    """The stages of `CudaRunner` on arrays of the CPU; Warp's sort and scan work there too."""

    def __init__(self, kernels: ctypes.CDLL) -> None:
        super().__init__(wp.get_device("cpu"))
        self._kernels = kernels

    def _launch(self, kernel: wp.Kernel, dim: int | tuple[int, int], *arguments: int, block_dim: int = 256) -> None:
        for i, (name, _, is_array) in enumerate(_fields()):
            if is_array:
                bound = self._bound.get(name)
                self._kernels.set_field(i, bound.ptr if bound is not None else None, 0.0)
            else:
                self._kernels.set_field(i, None, float(getattr(self.state, name)))
        run = getattr(self._kernels, kernel.key.rsplit(".", 1)[-1])
        if isinstance(dim, tuple):
            assert dim[1] == block_dim
            run(*dim)
        else:
            run(dim, *arguments)
