"""What a process holds, and whether that stays the same while it does the same again and again."""

from __future__ import annotations

import gc
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from statistics import median

_COMPARED = 10  # rounds at either end whose medians are compared
_MEBIBYTE = 1 << 20


@dataclass(frozen=True)
class Held:
    """What this process has: resident memory in MiB, open files and sockets, threads."""

    memory: float
    handles: int
    threads: int

    @classmethod
    def now(cls) -> Held:
        """Measure; needs /proc."""
        gc.collect()  # objects that refer to each other go at times of Python's own
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        return cls(
            pages * os.sysconf("SC_PAGE_SIZE") / _MEBIBYTE,
            len(os.listdir("/proc/self/fd")),
            len(os.listdir("/proc/self/task")),
        )


@dataclass(frozen=True)
class Course:
    """What a process held after each round that came after the warm-up."""

    rounds: tuple[Held, ...]

    @property
    def growth(self) -> float:
        """MiB of resident memory a round: the medians of the first and the last rounds, over those between them."""
        memory = [held.memory for held in self.rounds]
        return (median(memory[-_COMPARED:]) - median(memory[:_COMPARED])) / (len(memory) - _COMPARED)

    def __str__(self) -> str:
        first, last = self.rounds[0], self.rounds[-1]
        return (
            f"{len(self.rounds)} rounds: "
            f"memory {first.memory:.1f} to {last.memory:.1f} MiB ({self.growth:+.3f} a round), "
            f"handles {first.handles} to {last.handles}, threads {first.threads} to {last.threads}"
        )


def repeat(work: Callable[[int], None], rounds: int, warm_up: int) -> Course:
    """Do `work` with the number of the round, `warm_up` times and then `rounds` times that are measured."""
    held = []
    for number in range(warm_up + rounds):
        work(number)
        if number >= warm_up:
            held.append(Held.now())
    return Course(tuple(held))
