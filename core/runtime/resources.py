"""The resources of this machine that tasks share, and what a process has used. Standard library only."""

from __future__ import annotations

import ctypes
import math
import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path

_CONTROL_GROUP = Path("/sys/fs/cgroup")  # where a container sees its own limits
_STATUS = Path("/proc/self/status")
_UNKNOWN_MEMORY_MB = 8192  # where the system does not tell
_MIB = 1 << 20

CARDS_VARIABLE = "CUDA_VISIBLE_DEVICES"
"""Environment variable with the graphics cards that a process may use: numbers or UUIDs with commas between them."""
# Of a line of ``nvidia-smi -L``; parts of a card (MIG) have an identifier and no such number.
_CARD_NUMBER = re.compile(r"^GPU (\d+):", re.MULTILINE)
_CARD_IDENTIFIER = re.compile(r"\(UUID: ([^)]+)\)")


@dataclass(frozen=True)
class Resources:
    """Processor cores, main memory in MiB, graphics cards: of a machine, or of a task."""

    cores: int
    memory_mb: int
    gpus: int

    def __add__(self, other: Resources) -> Resources:
        return Resources(self.cores + other.cores, self.memory_mb + other.memory_mb, self.gpus + other.gpus)

    def __sub__(self, other: Resources) -> Resources:
        return Resources(self.cores - other.cores, self.memory_mb - other.memory_mb, self.gpus - other.gpus)

    def covers(self, other: Resources) -> bool:
        """Whether there is enough of everything."""
        return self.cores >= other.cores and self.memory_mb >= other.memory_mb and self.gpus >= other.gpus

    def capped(self, limit: Resources) -> Resources:
        """These resources, or all of `limit` where it has less."""
        return Resources(min(self.cores, limit.cores), min(self.memory_mb, limit.memory_mb), min(self.gpus, limit.gpus))


def this_machine(cores: int | None = None, memory_mb: int | None = None, gpus: int | None = None) -> Resources:
    """What this machine has, as far as it is not given."""
    return Resources(
        available_processors() if cores is None else cores,
        _memory_mb() if memory_mb is None else memory_mb,
        len(_graphics_cards()) if gpus is None else gpus,
    )


def _memory_mb() -> int:
    """Main memory, or the container's share of it."""
    try:
        memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // _MIB
    except (AttributeError, ValueError, OSError):
        return _UNKNOWN_MEMORY_MB
    limits = [*_limit("memory.max"), *_limit("memory/memory.limit_in_bytes")]  # control groups of version 2 and 1
    return min([memory, *(limit // _MIB for limit in limits)])


def _limit(*files: str) -> list[int]:
    """The numbers that state a limit of this container; none without one (the word "max", or no such files)."""
    try:
        return [int(number) for name in files for number in (_CONTROL_GROUP / name).read_text().split()]
    except (OSError, ValueError):
        return []


def card_names(count: int) -> list[str]:
    """Names for `CARDS_VARIABLE` of the first `count` graphics cards that this process may use.

    They are fewer where the variable is set and has fewer. Whether the machine has them is not looked at.
    """
    allowed = _allowed_cards()
    return [str(number) for number in range(count)] if allowed is None else allowed[:count]


def _allowed_cards() -> list[str] | None:
    """The entries of `CARDS_VARIABLE` up to the first that is none to CUDA, such as -1; None where it is not set."""
    text = os.environ.get(CARDS_VARIABLE)
    if text is None:
        return None
    entries = [entry.strip() for entry in text.split(",")]
    return list(takewhile(lambda entry: entry and not entry.startswith("-"), dict.fromkeys(entries)))


def _graphics_cards() -> list[str]:
    """CUDA devices that this process may use, of those that the driver's own program reports."""
    numbers, identifiers = _listed_cards()
    allowed = _allowed_cards()
    if allowed is None:
        return numbers

    def is_listed(entry: str) -> bool:
        return entry in numbers or any(name.startswith(entry) for name in identifiers)

    return list(takewhile(is_listed, allowed))  # as CUDA does, which stops at the first that is not there


def _listed_cards() -> tuple[list[str], list[str]]:
    """Numbers and UUIDs of all cards of this machine; the driver's program does not look at `CARDS_VARIABLE`."""
    program = shutil.which("nvidia-smi")
    if program is None:
        return [], []
    try:
        listed = subprocess.run([program, "-L"], capture_output=True, text=True, timeout=20.0, check=True).stdout
    except (OSError, subprocess.SubprocessError):
        return [], []
    return _CARD_NUMBER.findall(listed), _CARD_IDENTIFIER.findall(listed)


def available_processors() -> int:
    """At least one; fewer than the machine has where the process is confined to some, or its container to a quota."""
    count = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(count, processor_quota() or count)


def processor_quota() -> int | None:
    """As many processors as this container has time of, rounded up; None without a limit."""
    # In microseconds, by control groups of version 2 and 1; without a quota, version 1 states -1.
    for limit in (_limit("cpu.max"), _limit("cpu/cpu.cfs_quota_us", "cpu/cpu.cfs_period_us")):
        if len(limit) == 2 and min(limit) > 0:
            quota, period = limit
            return math.ceil(quota / period)
    return None


def return_freed_memory() -> None:
    """Give memory that was freed back to the system; glibc keeps it until some of it is asked for again."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None
    if trim is not None:
        trim(0)


def peak_memory_mb() -> int | None:
    """Largest resident size of this process so far, in MiB; None where the system does not say."""
    # What getrusage says on Linux includes the process that started this one: Blender, with its scene.
    lines = _STATUS.read_text(encoding="utf-8", errors="replace").splitlines() if _STATUS.exists() else []
    for line in lines:  # some sandboxes have the file without the peak
        if line.startswith("VmHWM:"):
            return round(int(line.split()[1]) / 1024)
    try:
        import resource
    except ImportError:  # Windows
        return None
    peak_bytes = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
    return round(peak_bytes / _MIB)
