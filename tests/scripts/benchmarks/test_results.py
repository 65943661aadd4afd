"""What short runs make of the demo is what the revisions of results stand for; what does not show there, they miss."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from cvdgs.core.capture.reader import read_capture
from cvdgs.core.demo import SHOWROOM
from cvdgs.scripts.benchmarks import provenance
from cvdgs.scripts.benchmarks.enhancers.drift import reconstruct_matches
from cvdgs.scripts.benchmarks.studies.captures import Subject
from cvdgs.scripts.benchmarks.studies.recipe import Recipe
from cvdgs.scripts.benchmarks.studies.trials import CaptureTrials

SIZE, STEPS = 96, 150
REMEDY = (
    "a run makes something else than before of the same photographs. If that is meant, raise a revision in "
    "provenance.py, write what runs make now here, and run `benchmark.py provenance` on the folders of pages, which "
    "are stale then"
)


@dataclass(frozen=True)
class Made:
    """Figures of a run: processors that add in another order change less of them than the tolerances allow."""

    gaussians: int
    psnr: float
    ccpr: float
    delta_e: float
    rwe: float

    def differences(self, other: Made) -> list[str]:
        """What differs from another run's."""
        allowed = {"gaussians": 0.02 * other.gaussians, "psnr": 0.1, "ccpr": 0.01, "delta_e": 0.03, "rwe": 0.03}
        pairs = {name: (getattr(self, name), getattr(other, name)) for name in allowed}
        return [f"{name} {a:.4g}, was {b:.4g}" for name, (a, b) in pairs.items() if abs(a - b) > allowed[name]]


MADE = {
    "all photographs": Made(4762, 26.62, 0.778, 2.62, 0.712),
    "ten photographs": Made(1092, 23.66, 0.595, 2.76, 0.716),
    "ten photographs with few points": Made(583, 21.44, 0.480, 2.76, 0.813),
}
"""By these revisions."""
REVISIONS = {"ENHANCEMENT": 1, "RECONSTRUCTION": 2}


def made_of(name: str, folder: Path, steps: int = STEPS) -> Made:
    """What a run makes of one of the captures of `MADE`."""
    capture = read_capture(SHOWROOM, max_size=SIZE)
    if name != "all photographs":
        capture = replace(capture, views=capture.views[::4])
    if name.endswith("few points"):
        capture = replace(capture, points=capture.points[::20], point_colors=capture.point_colors[::20])
    trials = CaptureTrials("demo", Subject.of(capture), reconstruct_matches(capture, 50), folder)
    trial = trials.try_recipe(Recipe("short", iterations=steps))
    trials.close()
    return Made(trial.gaussians, trial.psnr, trial.ccpr, trial.delta_e, trial.rwe)


@pytest.mark.parametrize("name", MADE)
def test_a_run_makes_what_its_revisions_say(name: str, tmp_path: Path) -> None:
    revisions = {revision: getattr(provenance, revision) for revision in REVISIONS}
    assert revisions == REVISIONS, "write what runs make by the new revisions into MADE"
    assert not made_of(name, tmp_path).differences(MADE[name]), REMEDY


def test_a_run_that_makes_something_else_is_noticed(tmp_path: Path) -> None:
    name = "ten photographs"
    assert made_of(name, tmp_path, STEPS * 9 // 10).differences(MADE[name])
