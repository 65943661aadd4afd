"""Plates keep their promise: normal vision reads them, the type they are made for does not. Oracle: colorspacious."""

from __future__ import annotations

import numpy as np
import pytest
from colorspacious import cspace_convert

from cvdgs.scripts.training.data.plates import SMALLEST_PLATE, Plate, draw_plate

SEEDS = range(20)
_DEFICIENCY = {"protan": "protanomaly", "deutan": "deuteranomaly", "tritan": "tritanomaly"}


def mean_lab(colors: np.ndarray, cvd: str | None) -> np.ndarray:
    """Mean CIELAB of (N, 3) bytes, seen by normal vision or by a dichromat under Machado 2009."""
    srgb = colors / 255.0
    if cvd is not None:
        space = {"name": "sRGB1+CVD", "cvd_type": _DEFICIENCY[cvd], "severity": 100}
        srgb = np.clip(cspace_convert(srgb, space, "sRGB1"), 0.0, 1.0)
    return cspace_convert(srgb, "sRGB1", {"name": "CIELab", "XYZ100_w": "D65"}).mean(0)


def difference(plate: Plate, cvd: str | None) -> float:
    """ΔE76 between the mean colours of figure and ground."""
    return float(np.linalg.norm(mean_lab(plate.image[plate.figure], cvd) - mean_lab(plate.image[plate.ground], cvd)))


@pytest.mark.parametrize("cvd", ["protan", "deutan", "tritan"])
def test_a_plate_is_read_by_normal_vision_and_not_by_the_type_it_is_made_for(cvd: str) -> None:
    for seed in SEEDS:
        plate = draw_plate(cvd, 128, np.random.default_rng(seed))
        assert difference(plate, None) >= 20.0
        assert difference(plate, cvd) < 2.0


def test_the_light_of_the_dots_varies_more_than_the_figure_differs_from_the_ground() -> None:
    for seed in range(4):
        plate = draw_plate("deutan", 192, np.random.default_rng(seed))
        luminance = (plate.image / 255.0) ** 2.2 @ [0.2126, 0.7152, 0.0722]
        figure, ground = luminance[plate.figure], luminance[plate.ground]
        assert ground.std() > 2.0 * abs(_seen_lightness(plate, "deutan"))
        assert figure.std() > 0.0


def _seen_lightness(plate: Plate, cvd: str) -> float:
    """Difference of mean lightness of figure and ground as the observer sees it, as a share of white's."""
    return float(mean_lab(plate.image[plate.figure], cvd)[0] - mean_lab(plate.image[plate.ground], cvd)[0]) / 100.0


def test_figure_and_ground_are_apart_and_both_are_there() -> None:
    shares = []
    for seed in range(4):
        plate = draw_plate("protan", SMALLEST_PLATE, np.random.default_rng(seed))
        assert not (plate.figure & plate.ground).any()
        shares.append(plate.figure.sum() / plate.ground.sum())
    assert min(shares) > 0.02


def test_a_plate_too_small_for_dots_is_refused() -> None:
    with pytest.raises(ValueError, match="at least 96"):
        draw_plate("deutan", 64, np.random.default_rng(0))
