"""Drift is measured between the enhanced views themselves, on correspondences that can be kept."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cvdgs.core.capture.model import Capture, PinholeCamera, View
from cvdgs.core.consistency import Correspondences
from cvdgs.core.evaluate.evaluation import SceneMatches
from cvdgs.core.settings import Layer
from cvdgs.scripts.benchmarks.enhancers.drift import load_matches, measure_drift, save_matches, write_drift

SIZE = 24


@pytest.fixture
def capture():
    """Nine views of the same wall, each a little brighter than the one before."""
    wall = np.random.default_rng(0).integers(40, 160, (SIZE, SIZE, 3))
    camera = PinholeCamera(SIZE, SIZE, SIZE, SIZE, SIZE / 2, SIZE / 2)
    views = tuple(View(f"{i}", Path(f"{i}.png"), camera, np.eye(4), (wall + 4 * i).astype(np.uint8)) for i in range(9))
    return Capture(Path("wall"), "test", views, np.zeros((0, 3), np.float32), np.zeros((0, 3), np.uint8), ())


@pytest.fixture
def matches():
    """Every pixel of a view is seen at the same place in the others."""
    rows, columns = np.divmod(np.arange(SIZE * SIZE), SIZE)
    places = np.stack([columns, rows], 1).astype(np.float32) + 0.5

    def pair(first, second):
        return Correspondences(first, second, np.arange(SIZE * SIZE, dtype=np.int32), places)

    return SceneMatches(list(range(9)), [pair(i, i + 1) for i in range(8)], [pair(0, 7), pair(1, 8)])


def test_views_that_are_left_alone_drift_as_the_photographs_do(capture, matches):
    row = measure_drift(capture, matches, ["none"], [Layer("deutan", 1.0)]).iloc[0]
    assert (row.ratio, row.normalised_ratio, row.long_ratio) == (pytest.approx(1.0),) * 3
    assert row.absolute == pytest.approx(4 / 255)  # the brightening from view to view
    assert row.long_absolute == pytest.approx(28 / 255)
    assert row.ccpr == row.ccpr_input
    assert row.correspondences == 8 * SIZE * SIZE


def test_an_enhancer_that_changes_colours_changes_the_drift(capture, matches):
    none, fidaner = measure_drift(capture, matches, ["none", "fidaner"], [Layer("deutan", 1.0)]).itertuples()
    assert fidaner.absolute_original == none.absolute_original
    assert fidaner.absolute != none.absolute
    assert fidaner.ratio == pytest.approx(fidaner.absolute / none.absolute)


def test_correspondences_survive_a_file(matches, tmp_path):
    path = tmp_path / "kept" / "matches.npz"
    save_matches(path, matches)
    read = load_matches(path)
    assert read.views == matches.views
    for kept, written in zip(read.short + read.long, matches.short + matches.long, strict=True):
        assert (kept.first, kept.second) == (written.first, written.second)
        np.testing.assert_array_equal(kept.first_pixels, written.first_pixels)
        np.testing.assert_array_equal(kept.second_positions, written.second_positions)


def test_the_table_has_a_line_for_each_enhancer(capture, matches, tmp_path):
    rows = measure_drift(capture, matches, ["none", "fidaner"], [Layer("protan", 0.4)])
    text = write_drift(tmp_path, rows)
    assert text.count("| wall | protan | 0.4 |") == 2
    assert (tmp_path / "drift.csv").read_text().count("\n") == 3
