"""Frames are selected as Hu and Xiao (2026) do: hard below 0.8, sequences of more than sixty."""

from __future__ import annotations

import csv
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cvdgs.core.enhance import IdentityEnhancer
from cvdgs.core.errors import InputError
from cvdgs.core.files.images import write_png
from cvdgs.core.settings import Layer
from cvdgs.scripts.benchmarks.enhancers.frames import (
    SelectionRule,
    measure_selection,
    read_frames,
    select_frames,
    write_selection,
)

SHORT = SelectionRule(longer_than=2)
ccprs = st.lists(st.sampled_from([0.3, 0.79, 0.8, 0.9, 0.97, 0.98, 1.0, math.nan]), max_size=30)


@given(ccprs)
def test_sequences_are_the_maximal_runs_of_hard_frames_that_are_long_enough(values):
    selection = select_frames(values, SHORT)
    text = "".join("h" if kind == "hard" else "." for kind in selection.kinds)
    inside = set()
    for run in selection.sequences:
        assert text[run.start : run.stop] == "h" * len(run)
        assert len(run) > 2
        assert run.start == 0 or text[run.start - 1] == "."
        assert run.stop == len(text) or text[run.stop] == "."
        inside |= set(run)
    left = "".join("." if index in inside else mark for index, mark in enumerate(text))
    assert "hhh" not in left
    assert list(selection.sequences) == sorted(selection.sequences, key=lambda run: run.start)


@given(ccprs)
def test_a_frame_is_hard_or_easy_by_its_own_ccpr_alone(values):
    kinds = select_frames(values, SHORT).kinds
    assert [kind == "hard" for kind in kinds] == [value < 0.8 for value in values]
    assert [kind == "easy" for kind in kinds] == [value > 0.97 for value in values]


@pytest.mark.parametrize(("hard", "sequences"), [(60, 0), (61, 1)])
def test_sixty_hard_frames_are_not_yet_a_sequence(hard, sequences):
    assert len(select_frames([0.9] + [0.5] * hard + [0.9]).sequences) == sequences


def test_a_folder_is_measured_in_natural_order_and_written(tmp_path):
    stripes = np.zeros((32, 32, 3), np.uint8)
    stripes[:, ::4] = (255, 255, 255)
    confused = np.zeros((32, 32, 3), np.uint8)
    confused[:] = (181, 109, 109)
    confused[:, ::4] = (109, 139, 109)
    for number, image in [(10, confused), (2, stripes), (9, confused), (11, confused)]:
        write_png(tmp_path / "images" / f"{number}.png", image)
    frames = read_frames(tmp_path, 640)
    assert list(frames) == ["2.png", "9.png", "10.png", "11.png"]
    found = measure_selection(frames, IdentityEnhancer(), Layer("deutan", 1.0), SHORT)
    assert found.kind.tolist() == ["easy", "hard", "hard", "hard"]
    assert found.sequence.tolist() == [0, 1, 1, 1]
    assert (found.psnr == math.inf).all()
    assert found.ssim.tolist() == pytest.approx([1.0] * 4)
    text = write_selection(tmp_path / "out", found, SHORT)
    assert "sequence 1: 3 frames, 9.png to 11.png" in text
    with open(tmp_path / "out" / "selection.csv", newline="") as file:
        assert [row["frame"] for row in csv.DictReader(file)] == list(frames)


def test_what_is_not_covered_makes_no_frame_hard():
    image = np.full((32, 32, 3), 90, np.uint8)
    image[:, :16:4] = 200
    image[:, 17:] = (181, 109, 109)
    image[:, 17::4] = (109, 139, 109)
    shown = np.zeros((32, 32), np.uint8)
    shown[:, :16] = 255
    asked = ({"a": image}, IdentityEnhancer(), Layer("deutan", 1.0))
    assert measure_selection(*asked).ccpr.item() < 0.8
    assert measure_selection(*asked, shown=[shown]).ccpr.item() == 1.0


def test_a_folder_without_photographs_is_refused(tmp_path):
    with pytest.raises(InputError, match="no photographs"):
        read_frames(tmp_path, 640)
