"""Runs trials in processes of their own, and keeps what they gave, so that a long comparison can be gone on with.

A process for each job makes its peak memory a figure of it, and keeps a crash from taking the others along.
"""

from __future__ import annotations

import hashlib
import json
import math
import multiprocessing
import threading
import traceback
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import torch

from .... import __version__
from ...errors import InputError
from ...events import Reporter
from ...processors import available_processors
from ...splats import raster
from ..drift import cached_matches
from .recipe import Recipe, Trial
from .subject import SubjectSource
from .trials import CaptureTrials, recipe_folder

STAGE = "trials"
TRIALS_FILE = "trials.jsonl"
MATCHES_FOLDER = "matches"
PICTURES_FOLDER = "pictures"


@dataclass(frozen=True)
class Job:
    """Recipes that are tried on one subject, one after the other, in one process.

    Attributes:
        source: of the subject.
        recipes: labels differ between those of one seed. Those that have enhanced views or a geometry in common should
            be in one job, which makes them once.
    """

    source: SubjectSource
    recipes: tuple[Recipe, ...]


def run_jobs(
    jobs: Sequence[Job], folder: Path, reporter: Reporter, *, processes: int = 1, again: bool = False
) -> list[Trial]:
    """The trials of all jobs, in their order; those that `folder` has from an earlier call are not made again.

    Args:
        folder: for the trials and the pictures of each (`pictures_of`).
        processes: that run at a time, and share the processor's cores.
        again: make all of them anew.
    """
    store = TrialStore(folder / TRIALS_FILE, again=again)
    missing = [Job(job.source, recipes) for job in jobs if (recipes := store.missing(job))]
    threads = max(available_processors() // processes, 1)
    if missing:
        raster.load("cpu", reporter)
    progress = _Progress(reporter, sum(len(job.recipes) for job in missing))

    def keep(source: SubjectSource, recipe: Recipe, trial: Trial) -> None:
        store.add(source, recipe, trial)
        progress.advance()

    with ThreadPoolExecutor(processes) as pool:
        running = [pool.submit(_run_in_process, job, folder, threads, keep) for job in missing]
        for finished in as_completed(running):
            finished.result()
    return [store.trial(job.source, recipe) for job in jobs for recipe in job.recipes]


def pictures_of(folder: Path, source: SubjectSource, recipe: Recipe) -> Path:
    """Where a trial's ``renders`` and ``enhanced`` folders are, under the folder of its comparison."""
    return recipe_folder(folder / PICTURES_FOLDER / source.name, recipe)


class _Progress:
    """Counts trials that several threads bring in."""

    def __init__(self, reporter: Reporter, total: int) -> None:
        self._reporter, self._total, self._done = reporter, total, 0
        self._lock = threading.Lock()
        if total:
            reporter.progress(STAGE, 0.0, f"0 of {total} trials")

    def advance(self) -> None:
        """One more is there."""
        with self._lock:
            self._done += 1
            self._reporter.progress(STAGE, self._done / self._total, f"{self._done} of {self._total} trials")


class TrialStore:
    """Trials in a file, one JSON object a line, under keys of what was tried.

    Args:
        path: of the file; need not be there.
        again: forget what it holds.
    """

    def __init__(self, path: Path, *, again: bool = False) -> None:
        self._path = path
        self._lock = threading.Lock()
        self._trials: dict[str, Trial] = {}
        path.parent.mkdir(parents=True, exist_ok=True)
        if again:
            path.unlink(missing_ok=True)
        if path.exists():
            self._trials = dict(_read(path))
            _end_with_a_line(path)

    def missing(self, job: Job) -> tuple[Recipe, ...]:
        """The job's recipes that have not been tried yet."""
        return tuple(recipe for recipe in job.recipes if _key(job.source, recipe) not in self._trials)

    def trial(self, source: SubjectSource, recipe: Recipe) -> Trial:
        """What a recipe gave."""
        return self._trials[_key(source, recipe)]

    def add(self, source: SubjectSource, recipe: Recipe, trial: Trial) -> None:
        """Keep a trial."""
        key = _key(source, recipe)
        values = {name: _to_json(value) for name, value in asdict(trial).items()}
        with self._lock, open(self._path, "a", encoding="utf-8") as file:
            self._trials[key] = trial
            file.write(json.dumps({"key": key, **values}) + "\n")


def _key(source: SubjectSource, recipe: Recipe) -> str:
    return hashlib.sha256(repr((__version__, source.key, recipe)).encode()).hexdigest()[:20]


def _read(path: Path) -> Iterator[tuple[str, Trial]]:
    lines = path.read_text(encoding="utf-8").splitlines()
    for number, line in enumerate(lines, start=1):
        try:
            values = json.loads(line)
            key = values.pop("key")
            yield key, Trial(**{name: _from_json(name, value) for name, value in values.items()})
        except (ValueError, TypeError, KeyError):
            # A power cut leaves half a line at most, and only the last.
            if number < len(lines):
                raise InputError(f"line {number} is no trial", where=path, remedy="remove the file") from None


def _end_with_a_line(path: Path) -> None:
    """Remove what a power cut left of a line, so that the next one does not continue it."""
    text = path.read_bytes()
    if not text.endswith(b"\n"):
        path.write_bytes(text[: text.rfind(b"\n") + 1])


def _to_json(value: Any) -> Any:
    """JSON has neither NaN nor infinity."""
    return value if not isinstance(value, float) or math.isfinite(value) else str(value)


def _from_json(name: str, value: Any) -> Any:
    return float(value) if Trial.__annotations__[name] == "float" else value


def _run_in_process(job: Job, folder: Path, threads: int, keep: Callable[[SubjectSource, Recipe, Trial], None]) -> None:
    """Run a job in a fresh process and keep its trials; where one kills the process, go on behind it in another."""
    waiting = list(job.recipes)
    while waiting:
        waiting = _run_until_it_dies(Job(job.source, tuple(waiting)), folder, threads, keep)


def _run_until_it_dies(
    job: Job, folder: Path, threads: int, keep: Callable[[SubjectSource, Recipe, Trial], None]
) -> list[Recipe]:
    """Run a job in one process and keep its trials; returns the recipes behind the one that it died of."""
    context = multiprocessing.get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_try_all, args=(job, folder, threads, sender), daemon=True)
    process.start()
    sender.close()
    waiting = list(job.recipes)
    try:
        while waiting:
            keep(job.source, waiting[0], receiver.recv())
            waiting.pop(0)
    except EOFError:
        process.join()
        reason = f"the process ended with exit code {process.exitcode}"
        keep(job.source, waiting[0], Trial.failed(job.source.name, waiting[0], reason))
        waiting.pop(0)
    process.join()
    return waiting


def _try_all(job: Job, folder: Path, threads: int, sender: Connection) -> None:
    """What a process does: send one trial a recipe."""
    torch.set_num_threads(threads)
    trials: CaptureTrials | None = None
    for recipe in job.recipes:
        try:
            if trials is None:
                subject = job.source.load()
                matches = cached_matches(folder / MATCHES_FOLDER, subject.judged)
                place = folder / PICTURES_FOLDER / job.source.name
                trials = CaptureTrials(job.source.name, subject, matches, place, threads)
            trial = trials.try_recipe(recipe)
        except Exception as error:  # whatever a method does under stress is a result
            trial = Trial.failed(job.source.name, recipe, f"{type(error).__name__}: {error}")
            if not isinstance(error, InputError):
                traceback.print_exc()
        sender.send(trial)
    if trials is not None:
        trials.close()
    sender.close()
