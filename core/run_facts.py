"""What a report says about the machine and the software of a run."""

from __future__ import annotations

import importlib.metadata
import platform
import sys
from pathlib import Path

from .. import __version__
from .environment import PACKAGES
from .processors import available_processors
from .splats.raster import Rasterizer


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
    return f"cpu: {_processor_name()}, {available_processors()} threads"


def _processor_name() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def peak_memory_mb() -> int | None:
    """Largest resident size of this process so far, in MiB; None where the system does not say."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return round(peak / (1024 * 1024 if sys.platform == "darwin" else 1024))
