"""How long another program takes to the quality that it reaches, and ours to the same on the same photographs.

Command: ``benchmark.py peers``, which runs one training after the other, each with the machine to itself.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ....core.errors import InputError
from ....core.runtime.cli import ConsoleReporter
from ....core.runtime.protocol import Reporter
from ....core.settings import QUALITIES
from ....core.splats import raster
from ....core.splats.training.plan import TrainingPlan
from ..options import Part, add_study_arguments, chosen_sources, with_quick_defaults, work_folder
from ..provenance import trained_product
from ..tables import Column, frame_of, markdown_table, write_csv, write_text
from ..timing.runs import TrainedRun, train_once
from ..timing.trainer import QUICK_PLAN
from .captures import DEMO, CaptureFolder
from .jobs import TRIALS_FILE, Job, TrialStore
from .peers import OPENSPLAT, OPENSPLAT_RUNS, OpenSplatRun, train_opensplat
from .recipe import Recipe, Trial

NAME = "peers"
SIZE = 480
STANDARD = next(quality.iterations for quality in QUALITIES if quality.name == "STANDARD")
OURS = {
    "ours, quick": QUICK_PLAN,
    "ours, as it is by itself": TrainingPlan(steps=STANDARD, limit=None, sh_degree=None, curve_points=40),
}
"""Plans of our trainings, measured often enough to read off when they reach a quality."""
_COLUMNS: tuple[Column, ...] = (
    ("capture", "capture", ""),
    ("label", "program", ""),
    ("iterations", "steps", "d"),
    ("psnr", "PSNR", ".2f"),
    ("seconds", "seconds", ".1f"),
    ("processor_seconds", "processor seconds", ".1f"),
    ("gaussians", "Gaussians", "d"),
)
_EQUAL: tuple[Column, ...] = (
    ("capture", "capture", ""),
    ("label", "to the PSNR of", ""),
    ("psnr", "PSNR", ".2f"),
    ("seconds", "its seconds", ".1f"),
    ("ours", "our run", ""),
    ("our_seconds", "our seconds", ".1f"),
    ("times", "times faster", ".1f"),
)
_DEFINITIONS = """\
All trainings of a capture in one call, one after the other on the same processor cores. Each program gets the same
training views (every eighth is held out) and sparse points, and its scene is rendered by our rasteriser for the
held-out views. Seconds are by the clock, ours without the measurements for the curve; a peer's include reading the
photographs. *Our seconds* is when a measured PSNR first reached that of the peer at its end; a dash: never.
OpenSplat's own number of steps, 30,000, takes hours on a processor: it is stopped earlier, at its own settings
otherwise."""


@dataclass(frozen=True)
class Finish:
    """A training at its end.

    Attributes:
        capture, label: what was trained, and by which program and settings.
        iterations: steps.
        psnr: of the held-out views, dB.
        seconds, processor_seconds: wall time, and processor time of all threads.
        gaussians: their number.
    """

    capture: str
    label: str
    iterations: int
    psnr: float
    seconds: float
    processor_seconds: float
    gaussians: int


@dataclass(frozen=True)
class Equal:
    """When one of our runs had reached what a peer reaches at its end; NaN where it never did.

    Attributes:
        capture, label, psnr, seconds: of the peer's `Finish`.
        ours: label of our run.
        our_seconds: of it, until that PSNR was first measured.
        times: how many times as long the peer took.
    """

    capture: str
    label: str
    psnr: float
    seconds: float
    ours: str
    our_seconds: float
    times: float


def peer_finishes(
    program: Path,
    source: CaptureFolder,
    folder: Path,
    reporter: Reporter,
    runs: Sequence[OpenSplatRun] = OPENSPLAT_RUNS,
) -> list[Finish]:
    """OpenSplat's trainings of a capture; those that `folder` has from an earlier call are not repeated."""
    store, subject = TrialStore(folder / TRIALS_FILE), source.load()
    finishes = []
    for run in runs:
        name = f"{OPENSPLAT}, {run.label}"
        recipe = Recipe(name, mode="", enhancer=name, iterations=run.iterations)
        if store.missing(Job(source, (recipe,))):
            (trial,) = train_opensplat(program, source.name, subject, reporter, [run])
            store.add(source, recipe, trial)
        finishes.append(_finish(store.trial(source, recipe)))
    return finishes


def race(finish: Finish, runs: Sequence[TrainedRun]) -> list[Equal]:
    """When each of our runs had reached the quality of a peer."""
    found = []
    for run in runs:
        seconds = run.seconds_to(finish.psnr)
        times = math.nan if math.isnan(seconds) else finish.seconds / seconds
        found.append(Equal(finish.capture, finish.label, finish.psnr, finish.seconds, run.label, seconds, times))
    return found


def write_peers(folder: Path, finishes: Sequence[Finish], equals: Sequence[Equal]) -> str:
    """Write ``peers.csv`` and ``peers.md``; returns the text of the latter."""
    write_csv(folder / f"{NAME}.csv", frame_of(Finish, finishes))
    lines = ["# Time to equal quality", "", _DEFINITIONS, ""]
    lines += [*markdown_table(frame_of(Equal, equals), _EQUAL), "", "## All runs", ""]
    return write_text(folder / f"{NAME}.md", [*lines, *markdown_table(frame_of(Finish, finishes), _COLUMNS)])


def _finish(trial: Trial) -> Finish:
    cost = (trial.geometry_seconds, trial.processor_seconds)
    return Finish(trial.capture, trial.label, trial.iterations, trial.psnr, *cost, trial.gaussians)


def _our_finish(run: TrainedRun, capture: str) -> Finish:
    return Finish(capture, run.label, run.steps, run.psnr, run.seconds, run.processor_seconds, run.gaussians)


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_study_arguments(parser, captures=(DEMO,), max_size=SIZE, iterations=STANDARD, processes=1)
    parser.add_argument("--opensplat", type=Path, metavar="FILE", help="OpenSplat's executable")


def _measure(options: argparse.Namespace) -> str:
    """Train captures with other programs and with ours; writes peers.csv and peers.md."""
    options = with_quick_defaults(options)
    if options.opensplat is None:
        raise InputError("no other program is given", where="--opensplat", remedy="give OpenSplat's executable")
    reporter, finishes, equals = ConsoleReporter(sys.stderr), list[Finish](), list[Equal]()
    raster.load("cpu", reporter)  # compiles the kernels, which is no part of a training
    for source in chosen_sources(options):
        peers = peer_finishes(options.opensplat, source, work_folder(options), reporter)
        capture, plans = source.load().given, dict(OURS)
        plans["ours, as it is by itself"] = replace(plans["ours, as it is by itself"], steps=options.iterations)
        runs = [train_once(capture, label, plan) for label, plan in plans.items()]
        finishes += [*peers, *(_our_finish(run, source.name) for run in runs)]
        equals += [equal for peer in peers for equal in race(peer, runs)]
    return write_peers(options.out, finishes, equals)


PART = Part(
    NAME,
    "seconds to the quality of another program (OpenSplat), on the same photographs",
    _add_arguments,
    _measure,
    pages=(f"{NAME}.md",),
    shaped_by=lambda: (*trained_product(), OURS, OPENSPLAT_RUNS),
)
