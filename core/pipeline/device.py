"""What the worker's environment and machine can do: versions, device, compiled kernels, and how fast it trains."""

from __future__ import annotations

import importlib.metadata
import platform
import sys
from pathlib import Path
from typing import Any

import torch
import warp as wp

from ... import __version__
from ..errors import InputError
from ..runtime.devices import TORCH_WITHOUT_CUDA, choose_device, missing_for_cuda
from ..runtime.environment import PACKAGES
from ..runtime.protocol import Reporter
from ..runtime.resources import available_processors
from ..splats import raster
from ..splats.raster import Rasterizer
from ..splats.raster.benchmark import benchmark_camera, benchmark_step, random_gaussians

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
        ``versions``, ``device`` (one line), ``python``, ``cuda`` (whether there is such a device), and ``speed`` of the
        processor relative to the reference machine: most stages run there beside a graphics card too, and how fast
        that is in the others is learned from runs.

    Raises:
        InputError: there is no such device.
    """
    name = choose_warp_device(device, where="device")
    for needed in dict.fromkeys((name, "cpu")):
        raster.load(needed, reporter)
    reporter.progress(STAGE, 0.8, "measuring the speed")
    scene, camera = random_gaussians(_GAUSSIANS, _WIDTH, _HEIGHT), benchmark_camera(_WIDTH, _HEIGHT)
    times = benchmark_step(scene, camera, device="cpu", repetitions=_REPETITIONS)
    return {
        "versions": versions(),
        "device": describe_device(raster.Rasterizer(name)),
        "python": sys.executable,
        "cuda": choose_warp_device("auto") == "cuda",
        "speed": round(REFERENCE_STEP_MS / times.stages["step"].wall, 3),
    }


def choose_warp_device(asked: str, *, where: str = "--device") -> str:
    """The device, "cpu" or "cuda", of one of `DEVICES`; see `choose_device`.

    Corrections of cameras and exposures are torch's part of a training step, so both libraries have to find the card.

    Raises:
        InputError: there is no such device, its driver is too old for Warp, torch is a build without CUDA, or Warp can
            keep no kernels.
    """
    _start_warp()
    has_cuda = wp.is_cuda_available()
    if has_cuda and not torch.cuda.is_available():
        has_cuda, missing = False, TORCH_WITHOUT_CUDA
    else:
        missing = missing_for_cuda(wp.get_cuda_driver_version(), wp.get_cuda_toolkit_version())
    return choose_device(asked, has_cuda=has_cuda, where=where, missing=missing)


def _start_warp() -> None:
    """Make sure that Warp's folder for compiled kernels is there; services and containers often have no home for it.

    Raises:
        InputError: it cannot be made.
    """
    try:
        wp.init()
    except OSError as error:
        what = f"compiled kernels cannot be kept there ({error.strerror})"
        remedy = "set WARP_CACHE_PATH to a folder that you can write to"
        raise InputError(what, where=error.filename or "", remedy=remedy) from None


def versions() -> dict[str, str]:
    """Of this project, of Python and of the libraries that a result depends on."""
    packages = {name: _version(name) for name in PACKAGES.values()}
    return {"cvdgs": __version__, "python": platform.python_version(), **packages}


def _version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return "none"


def describe_device(rasterizer: Rasterizer) -> str:
    """One line, e.g. ``cpu: AMD EPYC, 2 threads``."""
    if rasterizer.device.is_cuda:
        return f"cuda: {rasterizer.device.name}"
    return f"cpu: {describe_processor()}"


def describe_processor() -> str:
    """One line, e.g. ``AMD EPYC, 2 threads``."""
    return f"{_processor_name()}, {available_processors()} threads"


def _processor_name() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()
