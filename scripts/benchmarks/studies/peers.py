"""Other programs that fit Gaussians to the same photographs on the same machine, if they are installed."""

from __future__ import annotations

import os
import subprocess
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ....core.capture.normalised import write_capture
from ....core.errors import InputError
from ....core.runtime.protocol import Reporter
from ....core.splats import raster
from ....core.splats.io.ply import read_ply
from ....core.splats.renderer import SceneRenderer
from ....core.splats.targets import Background
from .captures import Subject
from .recipe import Recipe, Trial, described

STAGE = "peers"
OPENSPLAT = "OpenSplat"


@dataclass(frozen=True)
class OpenSplatRun:
    """Options of a run of OpenSplat.

    Attributes:
        label: of the run.
        iterations: of the training.
        downscales: how often the photographs are halved at the start.
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
    program: Path, capture: str, subject: Subject, reporter: Reporter, runs: Sequence[OpenSplatRun] = OPENSPLAT_RUNS
) -> list[Trial]:
    """Trials of OpenSplat (1.1 or later) on the CPU, on the training views; its scenes are rendered by ours.

    Args:
        program: its executable.
        capture: the name of `subject` in tables.

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
            found.append(_run(program, capture, place, Path(scratch) / f"{done}.ply", run, subject))
    reporter.progress(STAGE, 1.0, OPENSPLAT)
    return found


def _run(program: Path, capture: str, folder: Path, scene: Path, run: OpenSplatRun, subject: Subject) -> Trial:
    # --keep-crs: otherwise the scene has its own coordinates.
    command = [str(program), str(folder), "--output", str(scene), "--num-iters", str(run.iterations)]
    command += ["--num-downscales", str(run.downscales), "--resolution-schedule", str(run.schedule)]
    command += ["--keep-crs", "--cpu"]
    started, processor = time.perf_counter(), _processor_seconds_of_children()
    try:
        result = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    except OSError as error:
        reason = f"cannot be run ({error.strerror})"
        raise InputError(reason, where=program, remedy="give the path of OpenSplat's executable") from None
    seconds, processor = time.perf_counter() - started, _processor_seconds_of_children() - processor
    if result.returncode or not scene.is_file():
        last = (result.stderr or result.stdout).strip().splitlines()[-1:]
        raise InputError(f"no scene was made ({' '.join(last)})", where=program, remedy="use OpenSplat 1.1 or later")
    gaussians = read_ply(scene)
    views = subject.judged.views
    drawn = SceneRenderer(raster.Rasterizer("cpu"), views, Background.of(views))
    psnr = [drawn.fidelity(i, drawn.color(gaussians, i))["psnr"] for i in subject.judged_split.test]
    recipe = Recipe(f"{OPENSPLAT}, {run.label}", mode="", enhancer="", iterations=run.iterations)
    return Trial(
        **described(capture, recipe),
        gaussians=len(gaussians),
        sh_degree=gaussians.sh_degree,
        psnr=float(np.mean(psnr)),
        geometry_seconds=seconds,
        processor_seconds=processor,
    )


def _processor_seconds_of_children() -> float:
    used = os.times()
    return used.children_user + used.children_system
