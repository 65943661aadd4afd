"""The failure criteria on known numbers, and the page that reports them."""

from __future__ import annotations

import csv
import itertools
import math
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest

from cvdgs.scripts.benchmarks.stress.axes import AXES, HARMLESS, Axis
from cvdgs.scripts.benchmarks.stress.failure import UNTOUCHED, curve, fails_by_the_line_of, standings
from cvdgs.scripts.benchmarks.stress.page import write_stress
from cvdgs.scripts.benchmarks.stress.plan import Attempt, StressPlan, StressResult
from cvdgs.scripts.benchmarks.studies.captures import CaptureFolder
from cvdgs.scripts.benchmarks.studies.recipe import Recipe, Trial

BASE = CaptureFolder("made", Path("made"), 160)
POSES, SATIN = (next(axis for axis in AXES if axis.name == name) for name in ("poses", "satin"))
GOOD = {"psnr": 30.0, "rwe": 0.8, "ccpr": 0.75, "ccpr_input": 0.65}


def result(method: str, level: int, seed: int = 0, *, axis: Axis | None = None, **figures: object) -> StressResult:
    recipe = Recipe(method, seed=seed)
    known = {"capture": "made", "label": method, "mode": "layers", "enhancer": "lut", "cvd": "deutan", "severity": 1.0}
    trial = Trial(**known, seed=seed, iterations=1, **{**GOOD, **figures})  # type: ignore[arg-type]
    axis = axis or (None if level == HARMLESS else POSES)
    pictures = Path(f"nowhere-{method}-{level}-{seed}-{axis.name if axis and level != HARMLESS else ''}")
    return StressResult(Attempt(method, axis, level, seed, BASE, recipe), trial, pictures)


def standing_of(**figures: object) -> pd.Series:
    """A method at level 1 with these figures, and good ones at the harmless level."""
    return standings([result("layers", HARMLESS), result("layers", 1, **figures)]).iloc[1]


def test_good_figures_stand() -> None:
    assert standing_of().failed == ""


@pytest.mark.parametrize(
    ("figures", "failed"),
    [
        ({"psnr": 27.1}, ""),
        ({"psnr": 26.9}, "PSNR 3.1 dB lower"),
        ({"rwe": 1.0}, ""),
        ({"rwe": 1.25}, "RWE 1.25"),
        ({"ccpr": 0.65}, ""),
        ({"ccpr": 0.6}, "CCPR 0.600, the input's is 0.650"),
        ({"psnr": math.nan}, "a figure is not finite"),
        ({"rwe": math.inf}, "a figure is not finite"),
        ({"skipped_steps": 1}, "a step was not finite"),
        ({"error": "InputError: too few", "psnr": math.nan}, "InputError: too few"),
        ({"psnr": 20.0, "rwe": 2.0}, "PSNR 10.0 dB lower; RWE 2.00"),
    ],
    ids=lambda value: str(value)[:40],
)
def test_each_line_is_where_it_was_drawn(figures: dict[str, object], failed: str) -> None:
    assert standing_of(**figures).failed == failed


def test_the_mean_over_the_seeds_decides_and_their_deviation_is_told() -> None:
    found = standings(
        [result("layers", HARMLESS, seed) for seed in (0, 1)]
        + [result("layers", 1, 0, rwe=0.8), result("layers", 1, 1, rwe=1.1)]
    ).iloc[1]
    assert found.rwe == pytest.approx(0.95)
    assert found.rwe_deviation == pytest.approx(0.3 / math.sqrt(2))
    assert (found.seeds, found.failed) == (2, "")


def test_one_seed_that_crashes_is_a_failure_of_the_method() -> None:
    found = standings(
        [result("layers", HARMLESS), result("layers", 1, 0), result("layers", 1, 1, psnr=math.nan, error="boom")]
    ).iloc[1]
    assert (found.seeds, found.failed) == (1, "boom")
    assert found.psnr == 30.0


def test_a_method_is_measured_against_its_own_harmless_level() -> None:
    found = standings(
        [
            result("layers", 0),
            result("plain", 0, psnr=25.0),
            result("layers", 1, psnr=26.0),
            result("plain", 1, psnr=23.0),
        ]
    )
    assert [(item.method, item.axis, bool(item.failed)) for item in found.itertuples()] == [
        ("layers", UNTOUCHED, False),
        ("plain", UNTOUCHED, False),
        ("layers", "poses", True),
        ("plain", "poses", False),
    ]


def test_what_is_rendered_anew_is_measured_against_its_own_harmless_level() -> None:
    attempts = [
        result("layers", HARMLESS),
        result("layers", 1, psnr=26.0),
        result("layers", HARMLESS, axis=SATIN, psnr=27.0),
        result("layers", 1, axis=SATIN, psnr=26.0),
    ]
    found = standings(attempts)
    assert found.failed.astype(bool).tolist() == [False, True, False, False]
    assert curve(found, "layers", "satin").psnr.tolist() == [27.0, 26.0]
    assert curve(found, "layers", "poses").psnr.tolist() == [30.0, 26.0]


@pytest.mark.parametrize(
    ("figures", "fails"),
    [
        ({"psnr": 26.0}, False),  # 4 dB below its own, 1 above the other's line
        ({"psnr": 24.9}, True),
        ({"rwe": 1.1}, True),
        ({"ccpr": 0.6}, True),
        ({"psnr": math.nan}, True),
    ],
)
def test_with_one_line_for_all_a_method_may_lose_what_it_has_more(figures: dict[str, object], fails: bool) -> None:
    untouched = [result("layers", HARMLESS), result("plain", HARMLESS, psnr=28.0)]
    found = standings([*untouched, result("layers", 1, **figures), result("plain", 1, psnr=27.0)])
    assert fails_by_the_line_of("plain", found).tolist() == [False, False, fails, False]


def test_the_page_says_where_each_method_fails_first_and_what_the_warnings_are(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    plan = StressPlan(BASE, (POSES,), (0, 1, 2, 3), (0,))
    results = [result(method, 0) for method in ("layers", "joint", "post", "plain")]
    for level in (1, 2, 3):
        results.append(result("layers", level, warnings="cameras-off" if level > 1 else ""))
        results += [result("joint", level), result("post", level)]
        results.append(result("plain", level, psnr=30.0 - 2.0 * level))
    text = write_stress(tmp_path, plan, results)
    assert "| cameras turned by | stands | stands | stands | 0.5° |" in text
    assert "| cameras turned by | plain | 0.5° | 4.0 | 0.80 | 0.750 | 0.650 |" in text
    assert "plain settings have failed on 1 of 1 axes; on 1 of these (poses) `layers` is" in text
    assert "these have failed on 1, and on 1 of these (poses) `layers` stands" in text
    for level, warnings in (("0.25°", "nothing"), ("0.5°", "cameras-off"), ("1°", "cameras-off")):
        assert f"| cameras turned by | {level} | {warnings} |" in text
    assert (tmp_path / "stress.md").read_text(encoding="utf-8") == text
    pictures = (tmp_path / "stress.html").read_text(encoding="utf-8")
    assert "cameras turned by: 1°" in pictures
    assert "A held-out photograph, enhanced, and each method's" in pictures
    assert {path.name for path in tmp_path.glob("stress*.svg")} == {"stress.svg", "stress-dark.svg"}
    with open(tmp_path / "stress.csv", encoding="utf-8") as file:
        assert len(list(csv.DictReader(file))) == 16


def test_a_trial_that_axes_share_is_counted_once(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    axes = tuple(axis for axis in AXES if axis.scene_option)[:2]
    results = [result(method, HARMLESS, trial_seconds=60.0) for method in ("layers", "plain")]
    for axis, method in itertools.product(axes, ("layers", "plain")):
        untouched = result(method, HARMLESS, axis=axis, trial_seconds=60.0)
        results.append(replace(untouched, pictures=Path(f"untouched-{method}")))
        results.append(result(method, 1, axis=axis, trial_seconds=60.0))
    text = write_stress(tmp_path, StressPlan(BASE, axes, (0, 1), (0,)), results, processes=2)
    assert "8 trials took 8 minutes together, up to 2 at a time." in text
