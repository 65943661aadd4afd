"""What has to hold of the results on any machine and in the shortest of runs, measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ...events import Reporter
from ...settings import Layer
from ...splats.decisions import GrowthRule
from ..enhancers.methods import NONE
from ..tables import markdown_table, number, write_csv
from .jobs import Job, run_jobs
from .recipe import DEUTAN, Recipe, Trial
from .subject import CaptureFolder

NAME = "claims"
DRIFT = 40.0
"""Degrees of hue by which an enhancer contradicts itself from picture to picture: nobody would miss it."""
_NORMAL = Layer(DEUTAN.cvd, 0.0)


@dataclass(frozen=True)
class Claim:
    """A statement about results, and whether they bear it out.

    Attributes:
        statement: in words.
        ours: the figure that it is about.
        limit: which that may be at most.
        strictly: whether it has to be less.
    """

    statement: str
    ours: float
    limit: float
    strictly: bool = False

    @property
    def holds(self) -> bool:
        """Whether the figures say so; a NaN says nothing."""
        return self.ours < self.limit if self.strictly else self.ours <= self.limit


def measure_claims(
    source: CaptureFolder, iterations: int, folder: Path, reporter: Reporter, *, processes: int = 1, again: bool = False
) -> list[Claim]:
    """Try what the claims are about on a capture."""
    subject = source.load()
    cameras = [subject.given.views[i].camera for i in subject.split.train]
    most = GrowthRule().ceiling(sum(camera.width * camera.height for camera in cameras))
    layers = Recipe("claims layers", enhancer=NONE, iterations=iterations, drift=DRIFT)
    post = replace(layers, label="claims post", mode="post")
    fixed = replace(layers, label="claims fixed", gaussians=most)
    normal = Recipe("claims severity 0", layer=_NORMAL, iterations=iterations)
    trials = run_jobs([Job(source, (layers, post, fixed, normal))], folder, reporter, processes=processes, again=again)
    return claims_of(*trials)


def claims_of(layers: Trial, post: Trial, fixed: Trial, normal: Trial) -> list[Claim]:
    """What is claimed of four trials.

    Args:
        layers, post: of an enhancer that contradicts itself, the number of Gaussians decided automatically.
        fixed: as `layers`, with as many Gaussians as the photographs can determine.
        normal: of an observer of severity 0, with the product's enhancer.
    """
    return [
        Claim("RWE of layers is below that of post", layers.rwe, post.rwe, strictly=True),
        Claim("auto takes no more Gaussians than a fixed budget", layers.gaussians, fixed.gaussians),
        Claim("severity 0 changes no photograph (mean ΔE00)", normal.delta_e, 0.0),
    ]


def write_claims(folder: Path, claims: Sequence[Claim], heading: Sequence[str]) -> str:
    """Write ``claims.csv`` and ``claims.md``; returns the text of the latter."""
    write_csv(folder / f"{NAME}.csv", Claim, claims)
    rows = [
        [claim.statement, number(claim.ours, 3), number(claim.limit, 3), "yes" if claim.holds else "**no**"]
        for claim in claims
    ]
    lines = ["# What has to hold", "", *heading, "", *markdown_table(["", "figure", "at most", "holds"], rows), ""]
    text = "\n".join(lines)
    (folder / f"{NAME}.md").write_text(text, encoding="utf-8")
    return text
