"""Runs trials in separate processes and stores their figures, so that a long comparison can be resumed.

With a process for each job, peak memory can be measured and a crash does not affect other jobs. A trial is known by its
subject, by what its recipe does and by the product's settings, weights and revisions: studies that store in
one folder share trials, whatever they call them, and none is used again after one of these has changed. How trials are
measured is not among them: after a change of that, they have to be repeated (``--again``).
"""

from __future__ import annotations

import json
import math
import multiprocessing
import os
import signal
import threading
import traceback
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from itertools import count
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from pathlib import Path
from typing import Any

import torch

from .... import __version__
from ....core.errors import Cancelled, InputError
from ....core.files.untrusted import replacing
from ....core.runtime.process import follow_parent
from ....core.runtime.protocol import Reporter
from ....core.runtime.resources import available_processors
from ....core.runtime.supervisor import was_killed
from ....core.settings import WEIGHTS_SUFFIX
from ....core.splats import raster
from ..enhancers.drift import cached_matches
from ..enhancers.methods import FIT_MARK, NETWORK
from ..provenance import Facts, digest_of, fingerprint, predicting_weights, trained_product, weights_of_product
from .captures import SubjectSource
from .recipe import Recipe, Trial
from .trials import CaptureTrials, recipe_folder

STAGE = "trials"
TRIALS_FILE = "trials.jsonl"
MATCHES_FOLDER = "matches"
PICTURES_FOLDER = "pictures"

_Keep = Callable[[SubjectSource, Recipe, Trial, bool], None]  # the last: whether for later sessions, too


@dataclass(frozen=True)
class Job:
    """Recipes to try on one subject, one after the other, in one process.

    Attributes:
        source: of the subject.
        recipes: those that share enhanced views or a geometry should be in one job, which makes these once.
    """

    source: SubjectSource
    recipes: tuple[Recipe, ...]


def run_jobs(
    jobs: Sequence[Job], folder: Path, reporter: Reporter, *, processes: int = 1, again: bool = False
) -> list[Trial]:
    """The trials of all jobs, in order; those that `folder` has from an earlier call are not repeated.

    A trial that is interrupted, or whose process somebody else ends, is not stored.

    Args:
        folder: for the trials and their pictures (`pictures_of`).
        processes: number of parallel processes, which share the cores.
        again: repeat all of them.
    """
    store = TrialStore(folder / TRIALS_FILE)
    if again:
        store.forget(jobs)
    missing = store.missing_of(jobs)
    threads = max(available_processors() // processes, 1)
    total, finished, lock = sum(len(job.recipes) for job in missing), count(1), threading.Lock()
    if missing:
        raster.load("cpu", reporter)
        reporter.progress(STAGE, 0.0, f"0 of {total} trials")

    def keep(source: SubjectSource, recipe: Recipe, trial: Trial, lasting: bool) -> None:
        with lock:
            store.add(source, recipe, trial, lasting=lasting)
            number = next(finished)
            reporter.progress(STAGE, number / total, f"{number} of {total} trials")

    children = _Children()
    with ThreadPoolExecutor(processes) as pool:
        try:
            running = [pool.submit(_run_in_process, job, folder, threads, keep, children) for job in missing]
            for job_run in as_completed(running):
                job_run.result()
        except BaseException:  # Ctrl-C, or trials that cannot be stored: the threads would go on to the last job
            children.stop()
            raise
    return [store.trial(job.source, recipe) for job in jobs for recipe in job.recipes]


def pictures_of(folder: Path, source: SubjectSource, recipe: Recipe) -> Path:
    """The folder with a trial's ``renders`` and ``enhanced``, under the folder of its comparison."""
    return recipe_folder(_subject_folder(folder, source), recipe)


def _subject_folder(folder: Path, source: SubjectSource) -> Path:
    """For a subject's pictures: another one for each size of its photographs, which may be tried at the same time."""
    return folder / PICTURES_FOLDER / f"{source.name}-{fingerprint(source.key, tuple)}"


class TrialStore:
    """Trials in a file of JSON lines, by keys of subject and recipe.

    Args:
        path: of the file; need not exist.
        product: what shapes the figures of every trial.
    """

    def __init__(self, path: Path, *, product: Facts = trained_product) -> None:
        self._path = path
        self._product = fingerprint(__version__, product)
        self._trials: dict[str, Trial] = {}
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.exists():
            self._trials = dict(_read(path))
            _end_with_a_line(path)

    def missing(self, job: Job) -> tuple[Recipe, ...]:
        """The recipes of a job that have not been tried yet, each once."""
        first = {self._key(job.source, recipe): recipe for recipe in reversed(job.recipes)}
        wanted = [recipe for key, recipe in first.items() if key not in self._trials]
        return tuple(reversed(wanted))

    def missing_of(self, jobs: Sequence[Job]) -> list[Job]:
        """The jobs with the recipes that have not been tried yet, each in the first job that asks for it."""
        found, known = [], set(self._trials)
        for job in jobs:
            recipes = tuple(r for r in self.missing(job) if self._key(job.source, r) not in known)
            known |= {self._key(job.source, recipe) for recipe in recipes}
            found += [Job(job.source, recipes)] if recipes else []
        return found

    def forget(self, jobs: Sequence[Job]) -> None:
        """Discard the trials of jobs; other studies keep theirs."""
        keys = {self._key(job.source, recipe) for job in jobs for recipe in job.recipes}
        self._trials = {key: trial for key, trial in self._trials.items() if key not in keys}
        with replacing(self._path) as unfinished:
            unfinished.write_text("".join(map(_line, self._trials, self._trials.values())), encoding="utf-8")

    def trial(self, source: SubjectSource, recipe: Recipe) -> Trial:
        """The trial of a recipe, under its label and the subject's name."""
        found = self._trials[self._key(source, recipe)]
        return replace(found, capture=source.name, label=recipe.label)

    def add(self, source: SubjectSource, recipe: Recipe, trial: Trial, *, lasting: bool = True) -> None:
        """Store a trial, for this session alone unless it is `lasting`."""
        key = self._key(source, recipe)
        self._trials[key] = trial
        if lasting:
            with open(self._path, "a", encoding="utf-8") as file:
                file.write(_line(key, trial))

    def _key(self, source: SubjectSource, recipe: Recipe) -> str:
        return fingerprint(source.key, lambda: (self._product, recipe.identity, weights_of(recipe)))


def weights_of(recipe: Recipe) -> str:
    """The digest of the weights that a recipe needs; "" for none."""
    name, _, steps = recipe.enhancer.partition(FIT_MARK)
    if name == NETWORK:
        return weights_of_product() if steps == "0" else predicting_weights()
    file = Path(name)
    return digest_of(file) if file.suffix == WEIGHTS_SUFFIX and file.is_file() else ""


def _line(key: str, trial: Trial) -> str:
    values = {name: _to_json(value) for name, value in asdict(trial).items()}
    return json.dumps({"key": key, **values}) + "\n"


def _read(path: Path) -> Iterator[tuple[str, Trial]]:
    lines = path.read_text(encoding="utf-8").splitlines()
    for number, line in enumerate(lines, start=1):
        try:
            values = json.loads(line)
            key = values.pop("key")
            yield key, Trial(**{name: _from_json(name, value) for name, value in values.items()})
        except (ValueError, TypeError, KeyError):
            # A power cut leaves half a line at most, the last.
            if number < len(lines):
                raise InputError(f"line {number} is not a trial", where=path, remedy="remove the file") from None


def _end_with_a_line(path: Path) -> None:
    """Remove an unfinished last line, so that the next one does not continue it."""
    text = path.read_bytes()
    if not text.endswith(b"\n"):
        path.write_bytes(text[: text.rfind(b"\n") + 1])


def _to_json(value: Any) -> Any:
    """A value for JSON, which has neither NaN nor infinity."""
    return value if not isinstance(value, float) or math.isfinite(value) else str(value)


def _from_json(name: str, value: Any) -> Any:
    return float(value) if Trial.__annotations__[name] == "float" else value


class _Children:
    """The processes of one comparison, which can be stopped from any thread."""

    def __init__(self) -> None:
        self._context = multiprocessing.get_context("spawn")
        self._lock = threading.Lock()
        self._started: list[SpawnProcess] = []
        self._stopped = False

    def pipe(self) -> tuple[Connection, Connection]:
        """To receive from a process, and for it to send."""
        return self._context.Pipe(duplex=False)

    def start(self, target: Callable[..., None], *arguments: Any) -> SpawnProcess:
        """A process that calls `target`.

        Raises:
            Cancelled: `stop` was called.
        """
        with self._lock:
            self.check()
            process = self._context.Process(target=target, args=arguments, daemon=True)
            process.start()
            self._started.append(process)
            return process

    def check(self) -> None:
        """Raises `Cancelled` after `stop`."""
        if self._stopped:
            raise Cancelled

    def stop(self) -> None:
        """End all processes, and start no more."""
        with self._lock:
            self._stopped = True
            for process in self._started:
                process.terminate()


def _run_in_process(job: Job, folder: Path, threads: int, keep: _Keep, children: _Children) -> None:
    """Run a job in a new process and keep its trials; if a recipe kills the process, continue after it in another."""
    children.start(_find_matches, job.source, folder, threads).join()
    waiting = list(job.recipes)
    while waiting:
        receiver, sender = children.pipe()
        process = children.start(_try_all, Job(job.source, tuple(waiting)), folder, threads, sender)
        sender.close()
        try:
            while waiting:
                keep(job.source, waiting[0], receiver.recv(), True)
                waiting.pop(0)
        except EOFError:
            process.join()
            children.check()
            code = process.exitcode or 0
            failed = Trial.failed(job.source.name, waiting[0], f"the process ended with exit code {code}")
            keep(job.source, waiting[0], failed, not was_killed(code))
            waiting.pop(0)
        process.join()


def _begin(threads: int) -> None:
    """What each process does first."""
    # The terminal sends Ctrl-C to every process; the parent decides.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    follow_parent(lambda: os._exit(1))
    torch.set_num_threads(threads)


def _find_matches(source: SubjectSource, folder: Path, threads: int) -> None:
    """Find and store a subject's matches in a process of its own: a reconstruction, whose memory is no trial's."""
    _begin(threads)
    with suppress(Exception):  # the trials meet it again, and keep it
        cached_matches(folder / MATCHES_FOLDER, source.load().judged)


def _try_all(job: Job, folder: Path, threads: int, sender: Connection) -> None:
    """In a process of its own: send one trial for each recipe."""
    _begin(threads)
    trials: CaptureTrials | None = None
    for recipe in job.recipes:
        try:
            if trials is None:
                subject = job.source.load()
                matches = cached_matches(folder / MATCHES_FOLDER, subject.judged)
                place = _subject_folder(folder, job.source)
                trials = CaptureTrials(job.source.name, subject, matches, place, threads)
            trial = trials.try_recipe(recipe)
        except Exception as error:  # any failure under stress is a result
            trial = Trial.failed(job.source.name, recipe, f"{type(error).__name__}: {error}")
            if not isinstance(error, InputError):
                traceback.print_exc()
        sender.send(trial)
    if trials is not None:
        trials.close()
    sender.close()
