"""The doctor's look at the machine: processor cores, memory, disk, graphics card. Standard library only."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

from ..batch.machine import this_machine
from ..bootstrap import ROOT
from .finding import Finding, State

# The demo's worker peaks at 1.1 GB (README); Blender and the system want as much again.
LEAST_MEMORY_MB = 2500
# An environment takes 2.8 GB, and 7 GB where torch brings CUDA (README); pip needs room for what it downloads besides.
LEAST_DISK_MB = 10_000
# A run of the demo leaves 36 MB; captures of larger photographs take ten times that.
LEAST_TEMPORARY_MB = 500
_MB = 1_000_000


def examine_computer(*, environment_is_here: bool) -> Iterator[Finding]:
    """What this machine has; `environment_is_here`: nothing has to be installed any more."""
    machine = this_machine()
    yield Finding("cores", State.OK, str(machine.cores))
    found = f"{machine.memory_mb / 1000:.1f} GB"
    if machine.memory_mb < LEAST_MEMORY_MB:
        yield Finding("memory", State.NOTE, found, "close other programs, and use --max-size 320 and --gaussians 20000")
    else:
        yield Finding("memory", State.OK, found)
    yield _disk("disk", ROOT, LEAST_TEMPORARY_MB if environment_is_here else LEAST_DISK_MB)
    yield _disk("temporary files", Path(tempfile.gettempdir()), LEAST_TEMPORARY_MB)
    yield _graphics_card()


def _disk(name: str, folder: Path, least_mb: int) -> Finding:
    free = shutil.disk_usage(folder).free // _MB
    found = f"{free / 1000:.1f} GB free at {folder}"
    if free < least_mb:
        return Finding(name, State.NOTE, found, f"free {least_mb / 1000:g} GB, or use another disk")
    return Finding(name, State.OK, found)


def _graphics_card() -> Finding:
    program = shutil.which("nvidia-smi")
    if program is None:
        return Finding("graphics card", State.NOTE, "no NVIDIA driver; the CPU is used")
    query = [program, "--query-gpu=name,driver_version,memory.total", "--format=csv,noheader"]
    try:
        answer = subprocess.run(query, capture_output=True, text=True, timeout=20.0, check=True).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return Finding("graphics card", State.NOTE, "NVIDIA's driver does not answer; the CPU is used", "restart it")
    return Finding("graphics card", State.OK, "; ".join(answer.splitlines()))
