"""Chooses and prepares the kernels of a device."""

from __future__ import annotations

import types

import warp as wp

from ...errors import InputError
from ...events import Reporter
from .runner import Runner


def resolve_device(name: str | wp.Device) -> wp.Device:
    """The Warp device of a name such as "cpu", "cuda" or "cuda:1".

    Raises:
        InputError: there is no such device.
    """
    try:
        return wp.get_device(name)
    except (ValueError, RuntimeError) as error:
        if name == "cpu":  # which every machine has: something else is wrong
            raise
        raise InputError(f"there is no device {name!r} here", remedy='use "cpu"') from error


def _kernels(device: wp.Device) -> types.ModuleType:
    # Imported here: the kernels of the other device would be registered and hashed for nothing.
    if device.is_cuda:
        from . import kernels_cuda

        return kernels_cuda
    from . import kernels_cpu

    return kernels_cpu


def make_runner(device: wp.Device, threads: int | None) -> Runner:
    """The stages for a device; `threads` counts on the CPU only."""
    if device.is_cuda:
        from .runner_cuda import CudaRunner

        return CudaRunner(device)
    from .runner_cpu import CpuRunner

    return CpuRunner(device, threads)


def load(device: str = "cpu", reporter: Reporter | None = None) -> None:
    """Compiles the kernels for a device, or loads them from Warp's cache (`WARP_CACHE_PATH`). Needed once a process.

    Compiling takes seconds, the cache milliseconds; the first render would do the same, but without a word. Warp names
    cached objects after the processor's features, so a cache may be shared between machines.

    Raises:
        InputError: there is no such device.
    """
    resolved = resolve_device(device)
    (reporter or Reporter()).status("kernels", f"preparing the kernels for {resolved}; the first run compiles them")
    if resolved.is_cuda:
        from . import kernels_cuda as cuda

        for block_dim in (cuda.BLEND_THREADS, cuda.LOSS_THREADS):
            wp.load_module(_kernels(resolved), device=resolved, block_dim=block_dim)
    else:
        wp.load_module(_kernels(resolved), device=resolved)
