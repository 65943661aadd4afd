"""The trainer on a graphics card: a step beside the processor's and gsplat's, and whole trainings beside gsplat's.

Command: ``benchmark.py cuda``.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import torch
import warp as wp
from matplotlib.figure import Figure

from ....core.bootstrap import ROOT
from ....core.errors import InputError
from ....core.pipeline.device import choose_warp_device, describe_device, describe_processor
from ....core.runs.report import latest_seconds, read_report
from ....core.runtime.cli import ConsoleReporter
from ....core.runtime.protocol import Reporter
from ....core.splats import raster
from ....core.splats.raster import Rasterizer
from ....core.splats.raster.benchmark import STAGES, benchmark_camera, benchmark_step, random_gaussians
from ....core.splats.stereo import kernels as stereo_kernels
from ....core.splats.training.plan import TrainingPlan
from ..charts import Curve, Theme, draw_curves, picture, write_charts
from ..options import Part, add_study_arguments, chosen_sources, positive, with_quick_defaults
from ..provenance import trained_product
from ..studies.captures import DEMO, CaptureFolder
from ..studies.recipe import optimistic
from ..tables import Column, frame_of, markdown_table, number, write_csv, write_text
from .gsplat_peer import AT_MOST, DEFAULT, MCMC, Gsplat, GsplatRun
from .runs import TrainedRun, train_once

NAME = "cuda"
PAGE = f"{NAME}.md"
STAGE = "graphics card"
OURS, ON_PROCESSOR = "ours", "ours, on the processor"
_SCENES = ((20_000, 480, 360, 0), (100_000, 960, 720, 0), (300_000, 1600, 1200, 3))
"""Random ones that a step is timed on: Gaussians, width, height, degree of spherical harmonics."""
_REPETITIONS = {"cuda": 50, "cpu": 8}
_WARM_UP = 5  # repetitions that are not counted
_STEP_COLUMNS: tuple[Column, ...] = (
    ("scene", "scene", ""),
    ("who", "trainer", ""),
    *((name, name, ".2f") for name in STAGES),
    ("step", "step, ms", ".2f"),
)
_TRAINING_COLUMNS: tuple[Column, ...] = (
    ("capture", "capture", ""),
    ("label", "trainer", ""),
    ("steps", "steps", "d"),
    ("gaussians", "Gaussians", "d"),
    ("sh_degree", "SH degree", "d"),
    ("psnr", "PSNR, dB", ".2f"),
    ("seconds", "seconds", ".1f"),
)
_RUN_COLUMNS: tuple[Column, ...] = (
    ("capture", "capture", ""),
    ("size", "pixels", ""),
    ("views", "views", "d"),
    ("device", "device", ""),
    ("psnr", "PSNR, dB", ".2f"),
    ("gaussians", "Gaussians", "d"),
    ("geometry", "geometry, s", ".1f"),
    ("total", "whole run, s", ".1f"),
)


@dataclass(frozen=True)
class Step:
    """Milliseconds of a training step on random Gaussians; medians."""

    scene: str
    who: str
    render: float
    loss: float
    backward: float
    adam: float
    step: float


@dataclass(frozen=True)
class WholeRun:
    """A run of scripts/run.py: its figures, and seconds of its geometry and of all of it."""

    capture: str
    size: str
    views: int
    device: str
    psnr: float
    gaussians: int
    geometry: float
    total: float


def measure_steps(peer: Gsplat | None, scenes: Sequence[tuple[int, int, int, int]], reporter: Reporter) -> list[Step]:
    """A training step on random scenes, by ours on both devices and by gsplat on the card."""
    found: list[Step] = []
    for done, (count, width, height, degree) in enumerate(scenes):
        name = f"{count:,} of SH degree {degree}, {width}x{height}"
        reporter.progress(STAGE, done / len(scenes), f"steps, {name}")
        gaussians, camera = random_gaussians(count, width, height, sh_degree=degree), benchmark_camera(width, height)
        for device, who in (("cuda", OURS), ("cpu", ON_PROCESSOR)):
            times = benchmark_step(gaussians, camera, device=device, repetitions=_REPETITIONS[device])
            found.append(Step(name, who, *(times.stages[stage].wall for stage in (*STAGES, "step"))))
        if peer is not None:
            photograph = np.random.default_rng(1).integers(0, 256, (height, width, 3), np.uint8)
            step = peer.training_step(gaussians, camera, photograph)
            found.append(Step(name, f"gsplat {peer.version}", *_medians(step, _REPETITIONS["cuda"])))
    return found


def _medians(step: Callable[[], Iterator[None]], repetitions: int) -> list[float]:
    """Milliseconds of each stage and of all of them."""
    rows = []
    for _ in range(_WARM_UP + repetitions):
        times = [time.perf_counter()]
        for _ in step():
            torch.cuda.synchronize()
            times.append(time.perf_counter())
        rows.append([*np.diff(times), times[-1] - times[0]])
    return (1e3 * np.median(rows[_WARM_UP:], axis=0)).tolist()


def train_capture(
    source: CaptureFolder, peer: Gsplat | None, iterations: int, peer_iterations: int
) -> Iterator[TrainedRun]:
    """Trainings of a capture on the card: ours with everything decided automatically, then gsplat's."""
    capture = source.load().given
    ours = train_once(capture, OURS, TrainingPlan(steps=iterations, limit=None, sh_degree=None), device="cuda")
    yield replace(ours, capture=source.name)
    if peer is not None:
        for run in (GsplatRun(DEFAULT, peer_iterations), GsplatRun(MCMC, peer_iterations, ours.gaussians)):
            yield replace(peer.train(capture, run), capture=source.name)


def run_whole(source: CaptureFolder) -> WholeRun:
    """A run of scripts/run.py with its defaults on the best device there is, without the Blender scene.

    Raises:
        InputError: it failed.
    """
    with tempfile.TemporaryDirectory() as scratch:
        out = Path(scratch) / "run"
        words = [str(source.folder), "--out", str(out), "--cvd", "deutan", "--no-blend"]
        done = subprocess.run(
            [sys.executable, str(ROOT / "scripts" / "run.py"), *words], capture_output=True, text=True
        )
        if done.returncode:
            reason = (done.stderr.strip().splitlines() or ["it failed"])[-1]
            raise InputError(f"run.py said: {reason}", where=source.folder, remedy="try it by hand")
        report = read_report(out)
    capture, seconds = report["capture"], latest_seconds(report)
    return WholeRun(
        capture=source.name,
        size=f"{capture['width']}x{capture['height']}",
        views=capture["views"],
        device=str(report["device"]).partition(":")[0],
        psnr=report["reconstruction"]["psnr"],
        gaussians=report["gaussians"],
        geometry=seconds["geometry"] or 0.0,
        total=seconds["total"] or 0.0,
    )


def seconds_to_equal(runs: Sequence[TrainedRun]) -> list[str]:
    """For each capture, a line: when ours on the card had reached the best of gsplat, or gsplat that of ours."""
    lines = []
    for capture in dict.fromkeys(run.capture for run in runs):
        mine = next(run for run in runs if (run.capture, run.label) == (capture, OURS))
        others = [run for run in runs if run.capture == capture and run.label != OURS]
        if not others:
            continue
        best = max(others, key=lambda run: run.psnr)
        target = min(max(psnr for _, psnr in mine.curve), best.psnr)
        ours, theirs = mine.seconds_to(target), best.seconds_to(target)
        lines.append(
            f"- {capture}: {target:.2f} dB after {number(ours, '.1f')} s, {best.label} after "
            f"{number(theirs, '.1f')} s: {number(theirs / ours, '.1f')} times as long."
        )
    return lines


def write_card(
    folder: Path, machine: str, steps: Sequence[Step], runs: Sequence[TrainedRun], whole: Sequence[WholeRun]
) -> str:
    """Write ``cuda.csv``, its curves, steps and whole runs beside it, the chart and ``cuda.md``; returns the last.

    Args:
        machine: the card and the processor, in a line.
    """
    timed, trained = frame_of(Step, steps), frame_of(TrainedRun, [replace(run, curve=()) for run in runs])
    write_csv(folder / f"{NAME}.csv", trained.drop(columns="curve"))
    write_csv(folder / f"{NAME}_steps.csv", timed)
    captures = {run.capture for run in runs}
    write_charts(folder, NAME, (4.4 * len(captures), 3.4), partial(_draw, runs=runs), formats=("svg",))
    curves = [(run.capture, run.label, *point) for run in runs for point in run.curve]
    write_csv(folder / f"{NAME}_curves.csv", pd.DataFrame(curves, columns=["capture", "label", "seconds", "psnr"]))
    alternative = "PSNR of held-out views over seconds of training; the table has the ends"
    lines = ["# The trainer on a graphics card", "", f"{machine}.", "", _DEFINITIONS, "", *optimistic(trained)]
    lines += [picture(NAME, alternative), "", *seconds_to_equal(runs), ""]
    lines += [*markdown_table(trained, _TRAINING_COLUMNS), "", "## A training step", "", _STEPS, ""]
    lines += markdown_table(timed, _STEP_COLUMNS)
    if whole:
        found = frame_of(WholeRun, whole)
        write_csv(folder / f"{NAME}_runs.csv", found)
        lines += ["", "## Whole runs", "", _WHOLE, "", *markdown_table(found, _RUN_COLUMNS)]
    return write_text(folder / PAGE, lines)


_DEFINITIONS = """\
All of it on one machine, one after the other, each training once. Every eighth view is held out. Ours decides
everything by itself, as `run.py` does. gsplat has the settings of its example trainer: spherical harmonics of degree 3,
fused SSIM, photographs kept on the card. Its schedule, made for 30,000 steps, is shortened: *default* clones, splits
and prunes during half of them, *mcmc* relocates during five sixths and may have as many Gaussians as ours. Its scenes
are rendered and judged by our rasteriser. Seconds are of training alone: neither compiling nor reading nor measuring
counts. Ours include dense stereo, on the processor, and the trials by which it decides."""
_STEPS = "Random Gaussians against noise; medians, the card waited for after every stage."
_WHOLE = (
    "`scripts/run.py` with its defaults for a deutan, without the Blender scene: enhancement, geometry, layer, figures."
)


def _draw(figure: Figure, theme: Theme, runs: Sequence[TrainedRun]) -> None:
    """A panel for each capture, a series for each trainer."""
    curves = [Curve(run.capture, _kind(run), *zip(*run.curve, strict=True)) for run in runs]
    draw_curves(figure, theme, curves, y="PSNR of held-out views, dB", x="seconds", columns=4)


def _kind(run: TrainedRun) -> str:
    """The trainer, without its number of Gaussians."""
    return run.label.partition(AT_MOST)[0]


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_study_arguments(parser, captures=(DEMO,), max_size=640, iterations=3000, seeds=None, alone=True)
    add = parser.add_argument
    add("--gsplat", action="store_true", help="measure gsplat, too, which has to be installed with fused-ssim")
    add("--peer-iterations", type=positive, default=7000, metavar="N", help="steps of gsplat (7000)")


def _measure(options: argparse.Namespace) -> str:
    """Time steps, trainings and runs on the card; writes cuda.md, its tables and a chart."""
    options = with_quick_defaults(options)
    if choose_warp_device("auto") == "cpu":
        raise InputError("there is no CUDA device here", where="benchmark.py cuda", remedy="run it where there is one")
    peer = Gsplat() if options.gsplat else None
    reporter = ConsoleReporter(sys.stderr)
    for device in ("cuda", "cpu"):
        raster.load(device, reporter)  # compiles the kernels, which is no part of a training
    wp.load_module(stereo_kernels, device="cpu")
    runs, whole = list[TrainedRun](), list[WholeRun]()
    steps = measure_steps(peer, _SCENES, reporter)

    def written() -> str:  # after every measurement: a card may be lent for minutes only
        machine = f"{describe_device(Rasterizer('cuda'))}; beside it {describe_processor()}"
        return write_card(options.out, machine, steps, runs, whole)

    sources = chosen_sources(options)
    for done, source in enumerate(sources):
        reporter.progress(STAGE, done / (2 * len(sources)), f"training {source.name}")
        for run in train_capture(source, peer, options.iterations, options.peer_iterations):
            runs.append(run)
            written()
    for done, source in enumerate(sources):
        reporter.progress(STAGE, (len(sources) + done) / (2 * len(sources)), f"running {source.name}")
        whole.append(run_whole(source))
        written()
    return written()


PART = Part(
    NAME,
    "training on a graphics card, beside the processor and gsplat",
    _add_arguments,
    _measure,
    pages=(PAGE,),
    shaped_by=lambda: (*trained_product(), _SCENES),
)
