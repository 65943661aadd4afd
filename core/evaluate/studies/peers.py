"""Other programs that fit Gaussians to the same photographs on the same machine, as far as they are here."""

from __future__ import annotations

import os
import subprocess
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...capture import write_capture
from ...errors import InputError
from ...events import Reporter
from ...splats import raster
from ...splats.ply import read_ply
from ...splats.renderer import SceneRenderer
from ...splats.targets import Background
from .subject import Subject

STAGE = "peers"
OPENSPLAT = "OpenSplat"


@dataclass(frozen=True)
class PeerFigures:
    """What a peer's training gave.

    Attributes:
        label: the program, and how it was asked.
        iterations: of the training.
        gaussians, sh_degree: of the result.
        psnr: of the held-out views, dB.
        seconds, processor_seconds: wall time, and that of all threads.
    """

    label: str
    iterations: int
    gaussians: int
    sh_degree: int
    psnr: float
    seconds: float
    processor_seconds: float


@dataclass(frozen=True)
class OpenSplatRun:
    """How OpenSplat is asked.

    Attributes:
        label: of the run.
        iterations: of the training.
        downscales: how often the photographs are halved at the start of a run.
        schedule: steps after which their size is doubled again.
    """

    label: str
    iterations: int
    downscales: int
    schedule: int


OPENSPLAT_RUNS = (
    OpenSplatRun("coarse to fine, as it is by itself", 2000, downscales=2, schedule=3000),
    OpenSplatRun("full resolution", 500, downscales=0, schedule=3000),
)


def train_opensplat(
    program: Path, subject: Subject, reporter: Reporter, runs: Sequence[OpenSplatRun] = OPENSPLAT_RUNS
) -> list[PeerFigures]:
    """OpenSplat (1.1 or later) on the processor, on the views that are not held out; its scenes are drawn by ours.

    Raises:
        InputError: the program cannot be run or fails.
    """
    found = []
    with tempfile.TemporaryDirectory() as scratch:
        place = Path(scratch) / "capture"
        training = tuple(subject.given.views[i] for i in subject.split.train)
        write_capture(replace(subject.given, views=training), place)
        for done, run in enumerate(runs):
            reporter.progress(STAGE, done / len(runs), f"{OPENSPLAT}, {run.label}")
            found.append(_run_opensplat(program, place, Path(scratch) / f"{done}.ply", run, subject))
    reporter.progress(STAGE, 1.0, OPENSPLAT)
    return found


def _run_opensplat(program: Path, capture: Path, scene: Path, run: OpenSplatRun, subject: Subject) -> PeerFigures:
    # Without --keep-crs the scene comes back in coordinates of its own.
    command = [str(program), str(capture), "--output", str(scene), "--num-iters", str(run.iterations)]
    command += ["--num-downscales", str(run.downscales), "--resolution-schedule", str(run.schedule)]
    command += ["--keep-crs", "--cpu"]
    started, processor = time.perf_counter(), _processor_seconds_of_children()
    try:
        result = subprocess.run(command, cwd=capture, capture_output=True, text=True, check=False)
    except OSError as error:
        reason = f"cannot be run ({error.strerror})"
        raise InputError(reason, where=program, remedy="name OpenSplat's executable") from None
    seconds, processor = time.perf_counter() - started, _processor_seconds_of_children() - processor
    if result.returncode or not scene.is_file():
        last = (result.stderr or result.stdout).strip().splitlines()[-1:]
        raise InputError(f"it made no scene ({' '.join(last)})", where=program, remedy="use OpenSplat 1.1 or later")
    gaussians = read_ply(scene)
    views = subject.judged.views
    drawn = SceneRenderer(raster.Rasterizer("cpu"), views, Background.of(views))
    psnr = [drawn.fidelity(i, drawn.color(gaussians, i))["psnr"] for i in subject.judged_split.test]
    label = f"{OPENSPLAT}, {run.label}"
    return PeerFigures(
        label, run.iterations, len(gaussians), gaussians.sh_degree, float(np.mean(psnr)), seconds, processor
    )


def _processor_seconds_of_children() -> float:
    used = os.times()
    return used.children_user + used.children_system
