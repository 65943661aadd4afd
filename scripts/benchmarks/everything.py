"""Every study with its own defaults, and the claims that have to hold on any machine and in the shortest of runs.

Command: ``benchmark.py all``, which fails if a claim does not hold.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ...core.demo import SHOWROOM
from ...core.runtime.cli import ConsoleReporter
from ...core.runtime.protocol import Reporter
from ...core.settings import Layer
from ...core.splats.training.decisions import GrowthRule
from .enhancers.methods import NONE
from .options import QUICK, Part
from .provenance import trained_product
from .stress import command as stress
from .studies import ablation, budget, cost, figure, pareto, table
from .studies.captures import DEMO, CaptureFolder
from .studies.jobs import Job, run_jobs
from .studies.recipe import DEUTAN, Recipe, Trial
from .tables import Column, frame_of, markdown_table, write_csv, write_text

STUDIES = tuple(module.PART for module in (table, pareto, budget, stress, ablation, figure, cost))
DRIFT = 40.0
"""Degrees of hue by which an enhancer is inconsistent from picture to picture: nobody would miss it."""
_ROUNDING = 1e-9  # of ΔE00 between equal images, which is not always 0
_COLUMNS: tuple[Column, ...] = (
    ("statement", "", ""),
    ("ours", "figure", ".3f"),
    ("limit", "at most", ".3f"),
    ("verdict", "holds", ""),
)


@dataclass(frozen=True)
class Claim:
    """A statement about results.

    Attributes:
        statement: in words.
        ours: the figure that it is about.
        limit: the largest value of that figure for which it holds.
        strictly: whether the figure has to be below the limit.
    """

    statement: str
    ours: float
    limit: float
    strictly: bool = False

    @property
    def holds(self) -> bool:
        """Whether the figures confirm it; NaN confirms nothing."""
        return self.ours < self.limit if self.strictly else self.ours <= self.limit


def measure_claims(source: CaptureFolder, iterations: int, folder: Path, reporter: Reporter) -> list[Claim]:
    """Try the recipes that the claims are about on a capture."""
    subject = source.load()
    cameras = [subject.given.views[i].camera for i in subject.split.train]
    most = GrowthRule().ceiling(sum(camera.width * camera.height for camera in cameras))
    layers = Recipe("claims layers", enhancer=NONE, iterations=iterations, drift=DRIFT)
    post = replace(layers, label="claims post", mode="post")
    fixed = replace(layers, label="claims fixed", gaussians=most)
    normal = Recipe("claims severity 0", layer=Layer(DEUTAN.cvd, 0.0), iterations=iterations)
    trials = run_jobs([Job(source, (layers, post, fixed, normal))], folder, reporter)
    return claims_of(*trials)


def claims_of(layers: Trial, post: Trial, fixed: Trial, normal: Trial) -> list[Claim]:
    """The claims about four trials.

    Args:
        layers, post: with an inconsistent enhancer and an automatic number of Gaussians.
        fixed: as `layers`, with as many Gaussians as the photographs can determine.
        normal: for an observer of severity 0, with the product's enhancer.
    """
    return [
        Claim("RWE of layers is below that of post", layers.rwe, post.rwe, strictly=True),
        Claim("auto takes no more Gaussians than a fixed budget", layers.gaussians, fixed.gaussians),
        Claim("severity 0 changes no photograph (mean ΔE00)", normal.delta_e, _ROUNDING),
    ]


def write_claims(folder: Path, claims: Sequence[Claim]) -> str:
    """Write ``claims.csv`` and ``claims.md``; returns the text of the latter."""
    found = frame_of(Claim, claims)
    write_csv(folder / "claims.csv", found)
    shown = found.assign(verdict=["yes" if claim.holds else "**no**" for claim in claims])
    lines = ["# What has to hold", "", *markdown_table(shown, _COLUMNS)]
    return write_text(folder / "claims.md", lines)


def options_of(part: Part, options: argparse.Namespace, work: Path) -> argparse.Namespace:
    """The options of a part: its own defaults, with the folders and ``--quick`` of `options`."""
    parser = argparse.ArgumentParser()
    part.add_arguments(parser)
    arguments = ["--work", str(work), *(["--quick"] if options.quick else [])]
    return argparse.Namespace(**vars(parser.parse_args(arguments)), out=options.out, part=part.name)


def _command_of(part: Part, options: argparse.Namespace) -> str:
    """The command that makes a part's pages alone."""
    return f"python scripts/benchmark.py {part.name} --out DIR" + (" --quick" if options.quick else "")


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--work", type=Path, metavar="DIR", help="folder for scenes, pictures and finished trials (OUT/work)")
    add("--quick", action="store_true", help="the demo alone, small and short: a smoke test")


def _measure(options: argparse.Namespace) -> str:
    """Measure everything; writes the files of all parts, claims.csv and claims.md. Exits with 1 if a claim fails."""
    work = options.work or options.out / "work"
    texts = [part.run(options_of(part, options, work), _command_of(part, options)) for part in STUDIES]
    source = CaptureFolder(DEMO, SHOWROOM, QUICK["max_size"])
    claims = measure_claims(source, QUICK["iterations"], work, ConsoleReporter(sys.stderr))
    texts.append(write_claims(options.out, claims))
    if failed := [claim.statement for claim in claims if not claim.holds]:
        raise SystemExit(f"{texts[-1]}\nbenchmark.py: does not hold: {'; '.join(failed)}")
    return "\n".join(texts)


PART = Part(
    "all",
    "every study, and the claims that have to hold",
    _add_arguments,
    _measure,
    pages=("claims.md",),
    shaped_by=lambda: (*trained_product(), Recipe("any"), QUICK, DRIFT, _ROUNDING),
)
