"""Plain settings against the product's: both have room for as many Gaussians, and the table counts losses."""

from dataclasses import replace

import pandas as pd

from cvdgs.core.capture.reader import read_capture
from cvdgs.core.demo import SHOWROOM
from cvdgs.core.splats.training.decisions import GrowthRule
from cvdgs.scripts.benchmarks.studies.plain import Comparison, compare, write_plain


def test_both_are_trained_within_the_same_room():
    capture = read_capture(SHOWROOM, max_size=64)
    found = compare(capture, 64, 20)
    assert found.gain == found.ours - found.plain
    room = GrowthRule().ceiling(35 * 64 * 48)
    assert 0 < found.our_gaussians <= room
    assert 0 < found.plain_gaussians <= room


def test_the_page_counts_where_plain_settings_are_better(tmp_path):
    rows = [Comparison("demo", 160, steps, 30.0, 30.0 + gain, gain, 5, 6) for steps, gain in ((1, 1.0), (2, -0.2))]
    rows.append(replace(rows[0], capture="kermit", decided_on_held_out=True))
    text = write_plain(tmp_path, rows)
    assert "in 1 of 3 cases" in text
    assert "slightly optimistic: kermit (1 of 1 runs)." in text
    assert list(pd.read_csv(tmp_path / "plain.csv").gain) == [1.0, -0.2, 1.0]
