"""Other programs that fit Gaussians to the same photographs on the same machine, if they are installed."""

from __future__ import annotations

import math
import os
import re
import subprocess
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ....core.capture.normalised import write_capture
from ....core.errors import InputError
from ....core.runtime.protocol import Reporter
from ....core.splats import raster
from ....core.splats.gaussians import Gaussians
from ....core.splats.io.ply import read_ply
from ....core.splats.renderer import SceneRenderer
from ....core.splats.targets import Background
from ..timing.runs import held_out_psnr
from .captures import Subject
from .recipe import Recipe, Trial, described

STAGE = "peers"
OPENSPLAT = "OpenSplat"
OPENSPLAT_ITERATIONS = 1000
_KEEP_COORDINATES = "--keep-crs"  # until 1.1; later versions keep them unless they are told to --center
_VERSION = re.compile(r"\d+\.\d+(\.\d+)?")
_STEP = re.compile(r"Step (\d+):")
_SAID_EVERY = 10  # steps


@dataclass(frozen=True)
class OpenSplatRun:
    """Options of a run of OpenSplat.

    Attributes:
        label: of the run.
        iterations: of the training.
        options: others than its own defaults, as on its command line.
        measured: how many times its scene is judged on the way.
    """

    label: str
    iterations: int
    options: tuple[str, ...] = ()
    measured: int = 4


def opensplat_runs(iterations: int = OPENSPLAT_ITERATIONS) -> tuple[OpenSplatRun, ...]:
    """OpenSplat's runs of a length: as its users start it, and with the best settings that we found.

    From 1.2 on, Adam takes a step only every 32 iterations once densification has ended, by default half-way.
    """
    best = {"densify-until": iterations, "densify-from": 100, "refine-every": 100}
    best |= {"num-downscales": 1, "resolution-schedule": iterations // 2}
    options = tuple(word for name, value in best.items() for word in (f"--{name}", str(value)))
    return OpenSplatRun("its defaults", iterations), OpenSplatRun("best settings found", iterations, options)


@dataclass(frozen=True)
class Point:
    """A training on its way.

    Attributes:
        processor_seconds: until then, of all threads.
        psnr: of the held-out views, dB.
    """

    processor_seconds: float
    psnr: float


@dataclass(frozen=True)
class PeerTraining:
    """A finished training of another program: its figures, and how it got there."""

    trial: Trial
    curve: tuple[Point, ...]


@dataclass(frozen=True)
class OpenSplat:
    """An executable of OpenSplat, 1.1 or later.

    Attributes:
        program: its path.
        version: as it gives it, without the commit.
        keeps_coordinates: the options that leave the scene where the cameras are.
    """

    program: Path
    version: str
    keeps_coordinates: tuple[str, ...]

    @classmethod
    def at(cls, program: Path) -> OpenSplat:
        """Ask it what it is; raises `InputError` if it cannot be run."""
        help_text, version = (_asked(program, option) for option in ("--help", "--version"))
        known = _VERSION.search(version)
        options = (_KEEP_COORDINATES,) if _KEEP_COORDINATES in help_text else ()
        return cls(program, known[0] if known else "", options)

    @property
    def name(self) -> str:
        return f"{OPENSPLAT} {self.version}".strip()

    def command(self, capture: Path, scene: Path, run: OpenSplatRun) -> list[str]:
        """Its command line, on the CPU."""
        words = [str(self.program), str(capture), "--output", str(scene), "--num-iters", str(run.iterations)]
        if run.measured:
            words += ["--save-every", str(_interval(run))]
        return [*words, *run.options, *self.keeps_coordinates, "--cpu"]


def train_opensplat(
    program: Path, capture: str, subject: Subject, reporter: Reporter, runs: Sequence[OpenSplatRun]
) -> list[PeerTraining]:
    """Trainings by OpenSplat on the CPU, on the training views; its scenes are rendered by ours.

    Args:
        program: its executable.
        capture: the name of `subject` in tables.

    Raises:
        InputError: the program cannot be run or fails.
    """
    peer, found = OpenSplat.at(program), []
    with tempfile.TemporaryDirectory() as scratch:
        place = Path(scratch) / "capture"
        training = tuple(subject.given.views[i] for i in subject.split.train)
        write_capture(replace(subject.given, views=training), place)
        for done, run in enumerate(runs):
            reporter.progress(STAGE, done / len(runs), f"{peer.name}, {run.label}")
            found.append(_run(peer, capture, place, Path(scratch) / f"{done}.ply", run, subject))
    reporter.progress(STAGE, 1.0, peer.name)
    return found


def _run(peer: OpenSplat, capture: str, folder: Path, scene: Path, run: OpenSplatRun, subject: Subject) -> PeerTraining:
    times: dict[int, float] = {}
    last = ""
    started, processor = time.perf_counter(), _processor_seconds_of_children()
    with subprocess.Popen(
        peer.command(folder, scene, run), cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as process:
        assert process.stdout is not None
        for line in process.stdout:
            last = line.strip() or last
            if step := _STEP.match(line):
                times[int(step[1])] = time.perf_counter() - started
    seconds, processor = time.perf_counter() - started, _processor_seconds_of_children() - processor
    if process.returncode or not scene.is_file():
        raise InputError(f"no scene was made ({last})", where=peer.program, remedy="use OpenSplat 1.1 or later")
    gaussians = read_ply(scene)
    recipe = Recipe(f"{peer.name}, {run.label}", mode="", enhancer="", iterations=run.iterations)
    trial = Trial(
        **described(capture, recipe),
        gaussians=len(gaussians),
        sh_degree=gaussians.sh_degree,
        psnr=_held_out_psnr(gaussians, subject),
        geometry_seconds=seconds,
        processor_seconds=processor,
    )
    # Steps are known by the clock alone; a training uses its processors evenly.
    busy = processor / seconds
    saved = {step: scene.with_name(f"{scene.stem}_{step}{scene.suffix}") for step in _measured_steps(run)}
    if missing := [step for step, path in saved.items() if step not in times or not path.is_file()]:
        reason = f"it did not say and save step {missing[0]:,} of {run.iterations:,}"
        raise InputError(reason, where=peer.program, remedy="use OpenSplat 1.1 or later")
    curve = [Point(busy * times[step], _held_out_psnr(read_ply(path), subject)) for step, path in saved.items()]
    return PeerTraining(trial, (*curve, Point(processor, trial.psnr)))


def _held_out_psnr(gaussians: Gaussians, subject: Subject) -> float:
    views = subject.judged.views
    drawn = SceneRenderer(raster.Rasterizer("cpu"), views, Background.of(views))
    return held_out_psnr(drawn, gaussians, subject.judged_split.test)


def _interval(run: OpenSplatRun) -> int:
    """Steps between two scenes that are judged on the way; it says when it was at multiples of `_SAID_EVERY` alone."""
    return _SAID_EVERY * math.ceil(run.iterations / (run.measured + 1) / _SAID_EVERY)


def _measured_steps(run: OpenSplatRun) -> range:
    return range(_interval(run), run.iterations, _interval(run)) if run.measured else range(0)


def _asked(program: Path, option: str) -> str:
    try:
        asked = subprocess.run([str(program), option], capture_output=True, text=True, check=False)
    except OSError as error:
        reason = f"cannot be run ({error.strerror})"
        raise InputError(reason, where=program, remedy="give the path of OpenSplat's executable") from None
    return asked.stdout + asked.stderr


def _processor_seconds_of_children() -> float:
    used = os.times()
    return used.children_user + used.children_system
