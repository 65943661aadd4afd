"""The arrangement test: published figures, and observers whose colour vision is simulated."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cvdgs.core.color.arrangement import (
    CAP_COUNT,
    CAPS_UV,
    ArrangementScore,
    cap_colors,
    score_arrangement,
    suggest,
)
from cvdgs.core.color.matrices import RGB_TO_XYZ, linear_simulation

IN_ORDER = list(range(1, CAP_COUNT + 1))


def uniform_space(linear: np.ndarray) -> np.ndarray:
    """(N, 3) CIELUV of linear sRGB, white being the screen's."""
    xyz, white = linear @ RGB_TO_XYZ.T, RGB_TO_XYZ.sum(axis=1)

    def chromaticity(values: np.ndarray) -> np.ndarray:
        return np.stack([4 * values[..., 0], 9 * values[..., 1]], -1) / (values @ [1.0, 15.0, 3.0])[..., None]

    lightness = 116.0 * np.cbrt(xyz[:, 1:2]) - 16.0
    return np.hstack([lightness, 13.0 * lightness * (chromaticity(xyz) - chromaticity(white))])


def linear_light(encoded: np.ndarray) -> np.ndarray:
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def arranged_by(cvd: str, severity: float) -> list[int]:
    """The row that an observer makes who always takes the cap that looks nearest to the last one."""
    seen = np.clip(linear_light(cap_colors()) @ linear_simulation(cvd, severity).matrix.T, 0.0, 1.0)
    looks = uniform_space(seen)
    row, left = [0], set(IN_ORDER)
    while left:
        row.append(min(left, key=lambda cap: np.linalg.norm(looks[cap] - looks[row[-1]])))
        left.remove(row[-1])
    return row[1:]


def test_caps_in_order_have_the_published_figures():
    score = score_arrangement(IN_ORDER)
    assert (score.angle, score.confusion, score.selectivity) == pytest.approx((61.97, 1.0, 1.38), abs=0.01)
    assert suggest(score).cvd is None


@pytest.mark.parametrize("first", range(1, 15))
def test_an_exchange_of_neighbours_is_no_deficiency(first):
    caps = IN_ORDER.copy()
    caps[first - 1 : first + 1] = [first + 1, first]
    score = score_arrangement(caps)
    assert score.confusion < 1.4
    assert suggest(score).cvd is None


@pytest.mark.parametrize("severity", [0.6, 0.8, 1.0])
@pytest.mark.parametrize("cvd", ["protan", "deutan"])
def test_a_simulated_observer_is_recognised(cvd, severity):
    suggestion = suggest(score_arrangement(arranged_by(cvd, severity)))
    assert suggestion.cvd == cvd
    assert suggestion.severity == pytest.approx(severity, abs=0.1)


def test_a_simulated_tritanope_is_recognised():
    suggestion = suggest(score_arrangement(arranged_by("tritan", 1.0)))
    assert (suggestion.cvd, suggestion.severity) == ("tritan", 1.0)


@pytest.mark.parametrize("angle", [75.0, 89.0, -89.0, -75.0])
def test_an_axis_a_little_past_the_vertical_is_a_tritans_still(angle):
    assert suggest(ArrangementScore(angle, confusion=2.7, selectivity=2.5)).cvd == "tritan"


def test_mistakes_in_all_directions_suggest_no_type():
    """Somebody who put the caps down anyhow is not told a deficiency."""
    assert suggest(ArrangementScore(10.0, confusion=3.0, selectivity=2.5)).cvd == "protan"
    assert suggest(ArrangementScore(10.0, confusion=3.0, selectivity=1.3)).cvd is None


@pytest.mark.parametrize("cvd", ["protan", "deutan", "tritan"])
def test_normal_vision_arranges_the_caps_in_order(cvd):
    assert arranged_by(cvd, 0.0) == IN_ORDER


@given(st.permutations(IN_ORDER))
def test_every_arrangement_can_be_scored(caps):
    score = score_arrangement(caps)
    assert -90.0 < score.angle <= 90.0
    assert score.confusion > 0.5
    assert score.selectivity >= 1.0
    suggestion = suggest(score)
    assert suggestion.message
    assert 0.0 <= suggestion.severity <= 1.0


def test_a_cap_that_is_missing_is_refused():
    with pytest.raises(ValueError, match="once"):
        score_arrangement([1, 1, *IN_ORDER[2:]])


def test_caps_have_the_colours_of_the_table_and_one_lightness():
    luv = uniform_space(linear_light(cap_colors()))
    np.testing.assert_allclose(luv[:, 1:], CAPS_UV, atol=1e-6)
    np.testing.assert_allclose(luv[:, 0], luv[0, 0], atol=1e-9)
