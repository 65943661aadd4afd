"""Where plain Gaussian splatting gives better held-out views than the product, over sizes and lengths of runs.

Command: ``benchmark.py plain``.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ....core.capture.model import Capture
from ....core.evaluate.evaluation import Split
from ....core.runtime.cli import ConsoleReporter
from ....core.runtime.protocol import Reporter
from ....core.splats import raster
from ....core.splats.training.decisions import GrowthRule
from ....core.splats.training.plan import TrainingPlan
from ..options import Part, names, positives
from ..provenance import trained_product
from ..tables import Column, frame_of, markdown_table, write_csv, write_text
from ..timing.runs import train_once
from .captures import DEMO, capture_sources
from .recipe import PLAIN, optimistic

NAME = "plain"
SIZES = (120, 160, 240, 320)
LENGTHS = (150, 400, 1000)
WORSE = 0.1
"""dB by which plain settings may be better than ours."""
_COLUMNS: tuple[Column, ...] = (
    ("capture", "capture", ""),
    ("size", "longer side", "d"),
    ("steps", "steps", "d"),
    ("plain", "plain, dB", ".2f"),
    ("ours", "ours, dB", ".2f"),
    ("gain", "gain, dB", ".2f"),
    ("plain_gaussians", "plain, Gaussians", "d"),
    ("our_gaussians", "ours, Gaussians", "d"),
)


@dataclass(frozen=True)
class Comparison:
    """Both settings on a capture at one size and length.

    Attributes:
        capture: what was trained.
        size: longer side of the views, pixels.
        steps: of either run.
        plain, ours: PSNR of the held-out views, dB.
        gain: of ours over plain settings, dB.
        plain_gaussians, our_gaussians: their numbers.
        decided_on_held_out: of our run, as of `TrainingResult`.
    """

    capture: str
    size: int
    steps: int
    plain: float
    ours: float
    gain: float
    plain_gaussians: int
    our_gaussians: int
    decided_on_held_out: bool = False


def compare(capture: Capture, size: int, steps: int, *, seed: int = 0) -> Comparison:
    """Train with plain settings, as many Gaussians as ours may have at most, and as the product does by itself."""
    split = Split.every(len(capture.views))
    cameras = [capture.views[i].camera for i in split.train]
    ceiling = GrowthRule().ceiling(sum(camera.width * camera.height for camera in cameras))
    plans = (
        replace(PLAIN.training, steps=steps, limit=ceiling, sh_degree=0, curve_points=1),
        TrainingPlan(steps=steps, sh_degree=0, curve_points=1),
    )
    plain, ours = (train_once(capture, NAME, plan, seed=seed) for plan in plans)
    gain = ours.psnr - plain.psnr
    rest = (plain.gaussians, ours.gaussians, ours.decided_on_held_out)
    return Comparison(capture.source.name, size, steps, plain.psnr, ours.psnr, gain, *rest)


def write_plain(folder: Path, found: Sequence[Comparison]) -> str:
    """Write ``plain.csv`` and ``plain.md``; returns the text of the latter."""
    frame = frame_of(Comparison, found)
    write_csv(folder / f"{NAME}.csv", frame)
    worse = sum(one.gain < -WORSE for one in found)
    lines = [
        "# Plain settings against the product's",
        "",
        f"Plain settings are better by more than {WORSE:g} dB in {worse} of {len(found)} cases.",
        "",
        *optimistic(frame),
        *markdown_table(frame, _COLUMNS),
    ]
    return write_text(folder / f"{NAME}.md", lines)


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--captures", type=names, default=(DEMO,), metavar="A,B", help=f"{DEMO}, folders or NAME=FOLDER ({DEMO})")
    add("--sizes", type=positives, default=SIZES, metavar="A,B", help="longer sides of the views in pixels")
    add("--lengths", type=positives, default=LENGTHS, metavar="A,B", help="training steps")


def _measure(options: argparse.Namespace) -> str:
    """Train captures with either settings; writes plain.csv and plain.md."""
    reporter: Reporter = ConsoleReporter(sys.stderr)
    raster.load("cpu", reporter)  # compiles the kernels
    found: list[Comparison] = []
    for size in options.sizes:
        for source in capture_sources(options.captures, size, options.out / "work", reporter):
            capture = source.load().given
            for steps in options.lengths:
                one = compare(capture, size, steps)
                found.append(replace(one, capture=source.name))
                reporter.status(NAME, f"{source.name}, {size} pixels, {steps} steps: {one.gain:+.2f} dB")
    return write_plain(options.out, found)


PART = Part(
    NAME,
    "held-out PSNR with plain settings and with the product's, over sizes and lengths of runs",
    _add_arguments,
    _measure,
    pages=(f"{NAME}.md",),
    shaped_by=lambda: (*trained_product(), PLAIN.training),
)
