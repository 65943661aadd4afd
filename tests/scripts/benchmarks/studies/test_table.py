"""The texts of studies say what the trials gave, and nothing else."""

from __future__ import annotations

import csv
import math
import re
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest

from cvdgs.scripts.benchmarks.studies.ablation import SETTINGS, ablation_jobs, write_ablation
from cvdgs.scripts.benchmarks.studies.captures import CaptureFolder
from cvdgs.scripts.benchmarks.studies.recipe import Recipe, Trial
from cvdgs.scripts.benchmarks.studies.table import (
    OBSERVERS,
    ROWS,
    compare,
    severity_jobs,
    table_jobs,
    write_severities,
    write_table,
)
from cvdgs.scripts.benchmarks.tables import frame_of

DEMO = CaptureFolder("demo", Path("nowhere"), 96)
HEADING = ["By `a command`."]


def trial(recipe: Recipe, **figures: float) -> Trial:
    return replace(Trial.failed("demo", recipe, ""), **figures)


def cells(lines: list[str], *start: str, table: int = 0) -> list[str]:
    """The row that starts with these cells, in the first or a later table that has one."""
    found = [line for line in lines if line.startswith("| " + " | ".join(start) + " |")]
    return [cell.strip() for cell in found[table].strip("|").split("|")]


def assert_one_number_in_a_cell(lines: list[str]) -> None:
    for line in lines:
        if line.startswith("|") and ":--" not in line:
            figures = [re.findall(r"(?<![\w`])[-+]?\d+(?:\.\d+)?", cell) for cell in line.strip("|").split("|")]
            assert max(map(len, figures)) <= 1, line


def compared(*trials: Trial, name: str = "lut") -> pd.DataFrame:
    return compare(frame_of(Trial, trials).assign(name=name))


def test_a_mode_is_compared_with_the_baseline_seed_by_seed():
    base, other = Recipe("post", "post"), Recipe("layers")
    again, other_again = replace(base, seed=1), replace(other, seed=1)
    found = compared(
        trial(other, rwe=0.9, ccpr=0.80),
        trial(other_again, rwe=1.2, ccpr=0.81),
        trial(again, rwe=1.6, rwe_unenhanced=0.8, ccpr=0.82),
        trial(base, rwe=1.8, rwe_unenhanced=0.8, ccpr=0.81),
    )
    assert found.rwe_ratio.tolist() == pytest.approx([0.5, 0.75])
    assert found.added_ratio.tolist() == pytest.approx([0.1 / 1.0, 0.4 / 0.8])
    assert found.ccpr_difference.tolist() == pytest.approx([-0.01, -0.01])


def test_what_drift_adds_is_told_from_what_contrast_adds():
    post, layers = Recipe("post", "post"), Recipe("layers")
    steady = frame_of(Trial, [trial(layers, rwe=0.8), trial(post, rwe=0.6)]).assign(name="scene")
    drifting = frame_of(Trial, [trial(layers, rwe=0.9), trial(post, rwe=1.6)]).assign(name="drifting")
    found = compare(pd.concat([drifting, steady], ignore_index=True)).set_index("name")
    assert found.drift_ratio["drifting"] == pytest.approx(0.1)
    assert math.isnan(found.drift_ratio["scene"])
    assert math.isnan(compare(drifting).drift_ratio.iloc[0])


def test_what_the_baseline_does_not_add_cannot_be_compared_with():
    found = compared(
        trial(Recipe("layers"), rwe=0.75, rwe_unenhanced=0.8),
        trial(Recipe("post", "post"), rwe=0.7, rwe_unenhanced=0.8),
    )
    assert math.isnan(found.added_ratio.iloc[0])


RWE = {"post": "1.000", "joint": "1.000", "layers": "0.900"}


def figures_of(recipe: Recipe) -> dict[str, float]:
    """Figures by which rows can be told apart; `layers` reaches what is to be reached with one enhancer only."""
    figures = {"rwe": 1.0, "rwe_unenhanced": 0.5, "ccpr": 0.8, "psnr": 30.0, "gaussians": 900, "processor_seconds": 8.0}
    if recipe.mode == "layers":
        figures |= {"rwe": 0.2, "ccpr": 0.7} if recipe.drift else {"rwe": 0.9, "ccpr": 0.8}
    return {**figures, "ccpr_input": 0.6, "psnr": 30.0 + recipe.seed}


def test_the_table_has_every_row_for_each_capture_and_says_what_is_reached(tmp_path):
    (job,) = table_jobs([DEMO], 100, seeds=2)
    trials = [trial(recipe, **figures_of(recipe)) for recipe in job.recipes]
    lines = write_table(tmp_path, frame_of(Trial, trials), ["demo"], HEADING, processes=2)
    assert "by the clock, with up to 2 trials at work on the same machine; **processor" in "\n".join(lines)
    for row in ROWS:
        for mode in row.modes:
            rwe = "0.200" if row.drift and mode == "layers" else RWE[mode]
            assert cells(lines, row.title, mode)[7] == rwe
            assert cells(lines, row.title, mode, table=1)[7] == "0.000"  # the deviation
            assert cells(lines, row.title, mode, table=2)[2:4] == ["30.50", "900"]
            assert cells(lines, row.title, mode, table=3)[2:4] == ["0.71", "0"]
    assert cells(lines, "input (photographs)")[2] == "0.600"
    assert cells(lines, "demo", "scene network, drifting", "layers")[3] == "0.200"
    assert cells(lines, "demo", "scene network", "layers")[4:6] == ["0.800", "–"]
    assert_one_number_in_a_cell(lines)
    reached = {line.split(":")[0]: line for line in lines if line.startswith("- demo")}
    drifting, coin = reached["- demo, scene network, drifting"], reached["- demo, LUT of each view"]
    assert "0.200 of `post`'s (reached)" in drifting
    assert "CCPR -0.100 (not reached)" in drifting
    assert "0.900 of `post`'s (not reached)" in coin
    assert "CCPR +0.000 (reached)" in coin
    with open(tmp_path / "table.csv", newline="", encoding="utf-8") as file:
        assert len(list(csv.DictReader(file))) == len(trials)


def test_a_trial_that_failed_is_named_and_leaves_dashes(tmp_path):
    (job,) = table_jobs([DEMO], 100, seeds=1)
    failed = frame_of(Trial, [Trial.failed("demo", recipe, "it broke") for recipe in job.recipes])
    lines = write_table(tmp_path, failed, ["demo"], HEADING)
    assert "by the clock; **processor" in "\n".join(lines)
    assert "- demo, scene-layers, seed 0: it broke" in lines
    for table in (0, 1):
        assert set(cells(lines, "scene network", "layers", table=table)[2:]) == {"–"}


def test_every_observer_has_a_row(tmp_path):
    (job,) = severity_jobs([DEMO], 100, seeds=2)
    trials = frame_of(Trial, [trial(recipe, ccpr=0.5 + 0.1 * recipe.seed) for recipe in job.recipes])
    lines = write_severities(tmp_path, trials, HEADING)
    for observer in OBSERVERS:
        assert cells(lines, observer.cvd, f"{observer.severity:g}")[4] == "0.550"
        assert cells(lines, observer.cvd, f"{observer.severity:g}", table=1)[4] == "0.071"
    assert_one_number_in_a_cell(lines)


def test_all_observers_of_a_capture_have_one_geometry():
    (job,) = severity_jobs([DEMO], 100, seeds=1)
    assert len({recipe.geometry_key for recipe in job.recipes}) == 1


def test_an_ablation_differs_from_the_default_in_one_thing_and_is_reported_by_its_difference(tmp_path):
    weights = {"instance norm": Path("/home/me/instance.safetensors")}
    (job,) = ablation_jobs([DEMO], 100, seeds=2, weights=weights)
    assert len({recipe.plans for recipe in job.recipes if recipe.mode == "layers"}) == 8
    trials = []
    for recipe in job.recipes:
        changed = recipe.label.startswith("no-pruning")
        figures = figures_of(recipe) | ({"psnr": 29.5 + 2 * recipe.seed, "gaussians": 1800} if changed else {})
        trials.append(trial(recipe, **figures))
    lines = write_ablation(tmp_path, frame_of(Trial, trials), HEADING, weights)
    assert cells(lines, "the default (`layers`)")[1] == "30.50"
    row, deviations = (cells(lines, "no pruning before the end", table=table) for table in (0, 1))
    assert (row[1], deviations[1]) == ("+0.00", "0.71")
    assert row[-2:] == ["2.00", "1.00"]
    assert cells(lines, "instance norm")[2] == "+0.000"
    assert_one_number_in_a_cell(lines)
    assert "/home" not in (tmp_path / "ablation.csv").read_text()


@pytest.mark.parametrize(
    ("seeds", "said"),
    [
        (1, "the others their differences to it. Figures"),
        (2, "seed by seed; second tables have the standard deviations over seeds."),
    ],
)
def test_an_ablation_speaks_of_deviations_only_over_seeds(tmp_path, seeds, said):
    (job,) = ablation_jobs([DEMO], 100, seeds=seeds)
    lines = write_ablation(tmp_path, frame_of(Trial, [trial(r, **figures_of(r)) for r in job.recipes]), HEADING)
    assert said in "\n".join(lines)
    assert ("Standard deviations:" in lines) == (seeds > 1)


def test_an_ablation_has_every_captures_own_differences(tmp_path):
    (job,) = ablation_jobs([DEMO], 100, seeds=1)
    trials = []
    for capture, without in (("demo", 30.2), ("room", 29.1)):
        for recipe in job.recipes:
            figures = figures_of(recipe) | ({"psnr": without} if recipe.label.startswith("no-pruning") else {})
            trials.append(replace(trial(recipe, **figures), capture=capture))
    lines = write_ablation(tmp_path, frame_of(Trial, trials), HEADING)
    assert [line for line in lines if line.startswith("## ")] == ["## demo", "## room"]
    gains = [cells(lines, "no pruning before the end", table=table)[1] for table in (0, 1)]
    assert float(gains[0]) - float(gains[1]) == pytest.approx(30.2 - 29.1)


def test_what_changes_the_geometry_alone_is_tried_with_one_enhancer():
    tried = [{variant.name for variant in setting.variants if variant.of_geometry} for setting in SETTINGS]
    assert [len(names) for names in tried] == [4, 0]
