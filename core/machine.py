"""What the worker's environment and machine can do: versions, device, compiled kernels, and how fast it trains."""

from __future__ import annotations

import sys
from typing import Any

import warp as wp

from .evaluate.training.step_benchmark import benchmark_random_step
from .events import Reporter
from .run_facts import describe_device, versions
from .splats import raster
from .warp_device import choose_warp_device

STAGE = "check"

# A training step of a usual size. On the two threads of the reference machine of the time estimates it takes 60 ms of
# processor time, so half of that when nothing else runs.
_GAUSSIANS, _WIDTH, _HEIGHT = 20_000, 480, 360
_REPETITIONS = 20
REFERENCE_STEP_MS = 30.0


def check_machine(device: str, reporter: Reporter) -> dict[str, Any]:
    """Compile what the device needs, and time a training step; some seconds, the first time up to a minute.

    Args:
        device: "auto", "cpu" or "cuda".

    Returns:
        ``versions``, ``device`` (one line), ``python``, ``cuda`` (whether there is such a device), and ``speed``
        relative to the reference machine.

    Raises:
        InputError: there is no such device.
    """
    name = choose_warp_device(device, where="device")
    raster.load(name, reporter)
    reporter.progress(STAGE, 0.8, "measuring the speed")
    times = benchmark_random_step(_GAUSSIANS, _WIDTH, _HEIGHT, device=name, repetitions=_REPETITIONS)
    return {
        "versions": versions(),
        "device": describe_device(raster.Rasterizer(name)),
        "python": sys.executable,
        "cuda": wp.is_cuda_available(),
        "speed": round(REFERENCE_STEP_MS / times.stages["step"].wall, 3),
    }
