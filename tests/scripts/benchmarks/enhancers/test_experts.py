"""The other measures: names against the survey's own list, appearance against colorspacious, areas by a count."""

from __future__ import annotations

import math

import numpy as np
import pytest
from colorspacious import cspace_convert
from matplotlib.colors import XKCD_COLORS, to_rgb
from scipy.ndimage import gaussian_filter

from cvdgs.core.color.simulation import Observer
from cvdgs.core.color.spaces import image_to_tensor
from cvdgs.core.settings import Layer
from cvdgs.scripts.benchmarks.enhancers.color_names import BASIC_NAMES, basic_names, confused_names
from cvdgs.scripts.benchmarks.enhancers.experts import (
    AREA_BLUR,
    AREA_DISTANCE,
    ExpertScorer,
    appearance,
    preserved_areas,
)
from cvdgs.scripts.benchmarks.enhancers.image_sets import TestImage
from cvdgs.scripts.benchmarks.enhancers.scores import Enhanced, Judge

DEUTAN = Observer("deutan", 1.0)
RED, GREEN = (181, 109, 109), (109, 139, 109)  # nearly one colour for a deutan


def random_pixels(size=24, seed=0):
    return np.random.default_rng(seed).integers(0, 256, (size, size, 3), np.uint8)


def halves(first, second, size=40):
    """A picture whose left half has one colour, and whose right half has another."""
    pixels = np.empty((size, size, 3), np.uint8)
    pixels[:, : size // 2], pixels[:, size // 2 :] = first, second
    return pixels


def in_ucs(pixels):
    return cspace_convert(pixels.reshape(-1, 3), "sRGB255", "CAM02-UCS")


@pytest.mark.parametrize("name", BASIC_NAMES)
def test_the_colour_that_the_survey_lists_for_a_basic_name_has_that_name(name):
    assert BASIC_NAMES[basic_names(np.array(to_rgb(XKCD_COLORS[f"xkcd:{name}"])))] == name


def test_most_shades_of_the_surveys_list_have_the_basic_name_that_they_are_called_by():
    listed = [(name.removeprefix("xkcd:").split(), to_rgb(code)) for name, code in XKCD_COLORS.items()]
    shades = [(words, color) for words, color in listed if len(words) == 2 and words[1] in BASIC_NAMES]
    plain = [(words[1], color) for words, color in shades if words[0] in ("dark", "light", "bright", "deep", "pale")]
    found = [BASIC_NAMES[index] for index in basic_names(np.array([color for _, color in plain]))]
    agreeing = [name == expected for name, (expected, _) in zip(found, plain, strict=True)]
    assert len(plain) > 30
    assert np.mean(agreeing) > 0.9


def test_names_are_confused_where_two_become_one():
    red, green, blue = ([0.9, 0.0, 0.0], [0.1, 0.7, 0.1], [0.0, 0.2, 0.9])
    original = np.array([red, green, blue]).repeat(100, 0).reshape(15, 20, 3)
    merged = np.array([red, red, blue]).repeat(100, 0).reshape(15, 20, 3)
    assert confused_names(original, original) == 0.0
    assert confused_names(original, np.full_like(original, 0.5)) == 1.0
    assert confused_names(original, merged) == pytest.approx(1 / 3, abs=0.01)  # one of three pairs of names
    assert math.isnan(confused_names(np.full_like(original, 0.5), original))


def test_appearance_is_that_of_another_implementation():
    pixels = np.concatenate([random_pixels(), np.zeros((1, 24, 3), np.uint8), np.full((1, 24, 3), 255, np.uint8)])
    found = appearance(image_to_tensor(pixels)).reshape(-1, 3)
    np.testing.assert_allclose(found, in_ucs(pixels), atol=0.03)  # its white is rounded otherwise


def test_the_gap_is_to_what_others_see_and_the_change_to_what_was():
    original, version = random_pixels(seed=1), random_pixels(seed=2)
    figures = ExpertScorer(original, DEUTAN).score(version)
    seen = 255.0 * DEUTAN.simulate(image_to_tensor(version)).numpy().transpose(1, 2, 0)
    expected = {
        "cam_gap": np.linalg.norm(in_ucs(seen) - in_ucs(original), axis=1).mean(),
        "cam_change": np.linalg.norm(in_ucs(version) - in_ucs(original), axis=1).mean(),
    }
    for name, value in expected.items():
        assert figures[name] == pytest.approx(value, rel=1e-3)
    unchanged = ExpertScorer(original, Observer("deutan", 0.0)).score(original)
    assert unchanged["cam_gap"] == unchanged["cam_change"] == unchanged["name_confusions"] == 0.0


def test_chromatic_difference_leaves_lightness_out():
    original = random_pixels(seed=3)
    labs = [cspace_convert(pixels.reshape(-1, 3), "sRGB255", "CIELab") for pixels in (original, 255 - original)]
    expected = np.linalg.norm((labs[0] - labs[1])[:, 1:], axis=1).mean()
    found = ExpertScorer(original, DEUTAN).score(255 - original)["chromatic_difference"]
    assert found == pytest.approx(expected, rel=1e-3)
    greys = original[..., :1].repeat(3, -1)
    assert ExpertScorer(greys, DEUTAN).score(255 - greys)["chromatic_difference"] == pytest.approx(0.0, abs=1e-2)


def test_areas_are_pairs_eight_pixels_apart_without_texture():
    observer = Observer("protan", 1.0)
    original, version = (gaussian_filter(random_pixels(32, seed), (3, 3, 0)) for seed in (4, 5))
    labs = []
    for pixels, blind in ((original, False), (version, True)):
        linear = np.where(pixels <= 0.04045 * 255, pixels / 255 / 12.92, ((pixels / 255 + 0.055) / 1.055) ** 2.4)
        blurred = gaussian_filter(linear, (AREA_BLUR, AREA_BLUR, 0), mode="nearest", truncate=3.0)
        encoded = cspace_convert(blurred, "sRGB1-linear", "sRGB1")
        if blind:
            encoded = observer.simulate(image_to_tensor(encoded)).numpy().transpose(1, 2, 0)
        labs.append(cspace_convert(encoded, "sRGB1", "CIELab"))
    step = AREA_DISTANCE
    before, after = (
        np.concatenate(
            [
                np.linalg.norm(lab[:, step:] - lab[:, :-step], axis=-1).ravel(),
                np.linalg.norm(lab[step:] - lab[:-step], axis=-1).ravel(),
            ]
        )
        for lab in labs
    )
    assert 0 < (before >= 6).sum() < before.size
    found = preserved_areas(image_to_tensor(original), image_to_tensor(version), observer)
    assert found == pytest.approx((after >= 6)[before >= 6].mean(), abs=0.01)


def test_texture_is_no_area_and_confused_areas_are_lost():
    checks = np.indices((40, 40)).sum(0)[..., None] % 2
    texture = np.where(checks, RED, GREEN).astype(np.uint8)
    lost, kept = halves(RED, GREEN), halves((60, 60, 60), (200, 200, 200))
    scores = [ExpertScorer(pixels, DEUTAN).score(pixels)["ccpr_areas"] for pixels in (texture, lost, kept)]
    assert math.isnan(scores[0])
    assert scores[1:] == [0.0, 1.0]
    assert math.isnan(ExpertScorer(random_pixels(6), DEUTAN).score(random_pixels(6))["ccpr_areas"])


def test_the_worst_model_is_the_one_that_keeps_least():
    pixels = random_pixels(32, seed=6) // 4 + 96
    for observer in (Layer("protan", 1.0), Layer("tritan", 1.0)):
        row = Judge("s", TestImage("x", pixels), observer).score(Enhanced("none", pixels, 0.0, 0.0))
        assert row["ccpr_worst"] == np.nanmin([row["ccpr"], row["ccpr_vienot"], row["ccpr_brettel"]])
        assert row["ccpr_worst"] < 1.0
