"""Enhancement does what it is for: colours that an observer confuses become distinct, and nothing else changes much."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from cvdgs.core.color.metrics import ccpr, naturalness
from cvdgs.core.color.simulation import simulate
from cvdgs.core.color.spaces import image_to_tensor, srgb_to_lab
from cvdgs.core.enhance import ColorLut, LutEnhancer, make_enhancer
from cvdgs.core.enhance.lut import CUBE_SIZE
from cvdgs.core.enhance.lut_fit import LutSettings, fit_lut
from cvdgs.core.enhance.pairs import PairSampling, sample_neighbours, sample_pairs
from cvdgs.core.errors import InputError
from cvdgs.core.runtime.protocol import Reporter

from . import textiles

LEAN = LutSettings(pairs=1500)  # a quarter of the pairs: the same result for images this small, sooner
BRIEF = LutSettings(steps=60, pairs=1500, relaxations=0)  # enough to see the direction of a fit


@lru_cache
def fitted(cvd: str, severity: float = 1.0, model: str = "machado") -> ColorLut:
    return fit_lut([textiles.tartan(cvd, shift=s) for s in (0, 5)], cvd, severity, model, settings=LEAN)


def seen_contrast(image: np.ndarray, result: np.ndarray, cvd: str, severity: float = 1.0) -> float:
    return ccpr(image_to_tensor(image), simulate(image_to_tensor(result), cvd, severity))[0]


@pytest.mark.parametrize("cvd", ["protan", "deutan", "tritan"])
def test_a_tartan_in_confused_colours_becomes_distinct_in_views_that_the_fit_never_saw(cvd: str) -> None:
    unseen = textiles.tartan(cvd, shift=11, seed=9)
    before = seen_contrast(unseen, unseen, cvd)
    after = seen_contrast(unseen, fitted(cvd)(unseen), cvd)
    assert after >= min(before + 0.5, 0.95)


@pytest.mark.parametrize("cvd", ["protan", "deutan"])
def test_an_unreadable_plate_becomes_readable(cvd: str) -> None:
    image, labels = textiles.plate(cvd)

    def difference(picture: np.ndarray) -> float:
        lab = srgb_to_lab(simulate(image_to_tensor(picture), cvd, 1.0)).numpy()
        return float(np.linalg.norm(lab[:, labels == 2].mean(1) - lab[:, labels == 1].mean(1)))

    assert difference(image) < 2.0
    assert difference(fit_lut([image], cvd, 1.0, settings=LEAN)(image)) >= 10.0


def test_a_mild_deficiency_is_helped_with_a_smaller_change_than_a_severe_one() -> None:
    image = textiles.tartan()
    shift = {}
    for severity in (0.4, 1.0):
        result = fitted("deutan", severity)(image)
        assert seen_contrast(image, result, "deutan", severity) > 0.95
        shift[severity] = naturalness(image_to_tensor(image), image_to_tensor(result)).delta_e_76
    assert 0.0 < shift[0.4] < 0.85 * shift[1.0]


def test_greys_are_kept_and_the_map_is_smooth() -> None:
    lut = fitted("deutan")
    ramp = np.repeat(np.linspace(0, 1, 256, dtype=np.float32)[None, :, None], 3, axis=2)
    assert naturalness(image_to_tensor(ramp), image_to_tensor(lut(ramp))).delta_e_76 < 1.5
    first, second = (np.array(c) for c in ([0.7, 0.3, 0.25], [0.3, 0.5, 0.25]))
    gradient = np.linspace(first, second, 256, dtype=np.float32)[None]
    steps = np.abs(np.diff(lut(gradient), axis=1))
    assert steps.max() < 8 / 255  # a gradient of 8-bit steps must not turn into bands


def test_an_image_without_confusable_colours_is_nearly_left_alone() -> None:
    generator = np.random.default_rng(0)
    blues_and_yellows = np.array([[40, 60, 150], [220, 200, 90]])[generator.integers(0, 2, (64, 64))]
    image = np.clip(blues_and_yellows + generator.normal(0, 5, (64, 64, 3)), 0, 255).astype(np.uint8)
    result = fit_lut([image], "deutan", 1.0, settings=LEAN)(image)
    assert naturalness(image_to_tensor(image), image_to_tensor(result)).delta_e_2000 < 2.5


def test_the_fit_continues_while_a_scene_is_hard_and_only_then() -> None:
    # One step from the identity leaves the tartan hard.
    short = replace(BRIEF, initial_shift=0.0, steps=1, relaxations=2, relaxation_steps=10)
    hard = textiles.tartan(size=64)
    easy = np.repeat(np.where(np.indices((64, 64)).sum(0) % 2, 60, 200).astype(np.uint8)[..., None], 3, axis=2)

    def fit(image: np.ndarray, sufficient_ccpr: float) -> ColorLut:
        return fit_lut([image], "deutan", 1.0, settings=replace(short, sufficient_ccpr=sufficient_ccpr))

    default = LutSettings().sufficient_ccpr
    stopped, continued = fit(hard, 0.0), fit(hard, default)
    assert seen_contrast(hard, continued(hard), "deutan") > seen_contrast(hard, stopped(hard), "deutan") + 0.1
    assert torch.equal(fit(easy, 0.0).residual, fit(easy, default).residual)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_reds_move_towards_yellow_from_their_greens_whatever_the_seed(seed: int) -> None:
    image = textiles.tartan()
    lut = fit_lut([image], "deutan", 1.0, settings=BRIEF, seed=seed)
    before, after = (srgb_to_lab(image_to_tensor(x)) for x in (image, lut(image)))
    redness = before[1] - before[1].mean()
    assert (redness * (after - before)[2]).mean() > 0.0


def test_the_same_seed_gives_the_same_bits_and_another_seed_an_equally_distinct_result() -> None:
    images = [textiles.tartan(shift=s) for s in (0, 5)]
    first, second, other = (fit_lut(images, "deutan", 1.0, settings=BRIEF, seed=seed) for seed in (3, 3, 4))
    assert torch.equal(first.residual, second.residual)
    assert not torch.equal(first.residual, other.residual)
    for lut in (first, other):
        assert seen_contrast(images[0], lut(images[0]), "deutan") > 0.9


def test_the_number_of_threads_is_left_as_it_was() -> None:
    threads = torch.get_num_threads()
    fit_lut([textiles.tartan(size=32)], "deutan", 1.0, settings=BRIEF)
    assert torch.get_num_threads() == threads


@pytest.mark.parametrize(("severity", "strength"), [(0.0, 1.0), (1.0, 0.0)])
def test_severity_zero_and_strength_zero_are_the_identity(severity: float, strength: float) -> None:
    image = textiles.tartan(size=32)
    enhancer = make_enhancer("lut", "deutan", severity, strength=strength)
    enhancer.fit([image])
    np.testing.assert_array_equal(enhancer(image), image.astype(np.float32) / np.float32(255))


def test_the_control_changes_nothing() -> None:
    image = textiles.tartan(size=32)
    enhancer = make_enhancer("none", "deutan", 1.0)
    enhancer.fit([image], Reporter())
    np.testing.assert_array_equal(enhancer(image), image.astype(np.float32) / np.float32(255))


def test_half_the_strength_is_half_the_way() -> None:
    image = textiles.tartan(size=48)
    full, half = (LutEnhancer("deutan", 1.0, strength=s, settings=BRIEF) for s in (1.0, 0.5))
    for enhancer in (full, half):
        enhancer.fit([image])
    np.testing.assert_allclose(half(image), (image / 255 + full(image)) / 2, atol=1e-6)


def test_an_enhancer_must_be_fitted_first() -> None:
    with pytest.raises(RuntimeError, match="fit"):
        make_enhancer("lut", "deutan", 1.0)(textiles.tartan(size=16))


def test_a_fitted_enhancer_saves_its_table_and_exports_it_at_its_strength(tmp_path: Path) -> None:
    image = textiles.tartan(size=48)
    enhancer = LutEnhancer("deutan", 1.0, strength=0.5, settings=BRIEF)
    with pytest.raises(RuntimeError, match="fit"):
        enhancer.save(tmp_path / "early.safetensors")
    enhancer.fit([image])
    enhancer.save(tmp_path / "scene.safetensors")
    enhancer.export_cube(tmp_path / "scene.cube", "scene")
    saved = ColorLut.load(tmp_path / "scene.safetensors")
    np.testing.assert_array_equal(saved(image, 0.5), enhancer(image))
    corner = np.array([[[1.0, 0.0, 0.0]]], np.float32)
    exported = (tmp_path / "scene.cube").read_text(encoding="utf-8").splitlines()[5 + CUBE_SIZE - 1]
    np.testing.assert_allclose([float(word) for word in exported.split()], enhancer(corner)[0, 0], atol=1e-6)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("weights/best.safetensors", "deutan", 1.0), "best.safetensors.*cannot be read"),
        (("magic", "deutan", 1.0), "magic.*scene, lut, cgan, none or a .safetensors file"),
        (("lut", "deutan", 1.5), "severity"),
        (("none", "nobody", 1.0), "nobody"),
        (("lut", "tritan", 1.0, "vienot"), "tritan"),
        (("lut", "deutan", 1.0, "machado", 1.2), "strength"),
        (("lut", "deutan", 1.0, "machado", float("nan")), "strength"),
    ],
)
def test_unusable_arguments_are_refused(arguments: tuple, said: str) -> None:
    with pytest.raises(InputError, match=said):
        make_enhancer(*arguments)


def test_progress_rises_to_one() -> None:
    class Recorder(Reporter):
        def __init__(self) -> None:
            self.fractions: list[float] = []

        def progress(self, stage: str, fraction: float, message: str = "") -> None:
            assert stage == "enhance"
            self.fractions.append(fraction)

    recorder = Recorder()
    fit_lut([textiles.tartan(size=32)], "deutan", 1.0, settings=BRIEF, reporter=recorder)
    assert recorder.fractions == sorted(recorder.fractions)
    assert len(recorder.fractions) >= 20
    assert recorder.fractions[-1] == 1.0


def coordinates_image(height: int, width: int, view: int) -> np.ndarray:
    """Every pixel's colour tells its row, column and view."""
    rows, columns = np.mgrid[:height, :width]
    return np.stack([rows, columns, np.full_like(rows, view)], -1).astype(np.uint8)


@given(st.lists(st.tuples(st.integers(1, 200), st.integers(1, 200)), min_size=1, max_size=4), st.integers(0, 99))
@settings(max_examples=25, deadline=None)
def test_pairs_are_local_within_a_view_and_across_views_as_documented(shapes: list[tuple[int, int]], seed: int) -> None:
    images = [coordinates_image(height, width, view) for view, (height, width) in enumerate(shapes)]
    sampling = PairSampling(local_radius=10.0, reference_size=100)
    pairs = sample_pairs(images, 4000, np.random.default_rng(seed), sampling).astype(int)
    assert pairs.shape == (4000, 2, 3)
    radius = np.array([max(round(10.0 * min(shape) / 100), 1) for shape in shapes])[pairs[:, 0, 2]]
    same_view = pairs[:, 0, 2] == pairs[:, 1, 2]
    near = same_view & (np.abs(pairs[:, 0, :2] - pairs[:, 1, :2]).max(1) <= radius)
    assert near.sum() >= 2000
    assert same_view.sum() >= 3000


@given(st.integers(1, 60), st.integers(1, 60), st.integers(0, 99))
@settings(max_examples=25, deadline=None)
def test_neighbours_are_at_most_a_pixel_apart(height: int, width: int, seed: int) -> None:
    pairs = sample_neighbours([coordinates_image(height, width, 0)], 2000, np.random.default_rng(seed)).astype(int)
    assert np.abs(pairs[:, 0, :2] - pairs[:, 1, :2]).max() <= 1


def test_uncovered_pixels_are_never_drawn() -> None:
    images = [np.zeros((40, 40, 3), np.uint8), np.full((30, 50, 3), 99, np.uint8)]
    alpha = np.zeros((40, 40), np.uint8)
    alpha[5:30, 8:12] = 200
    images[0][alpha > 0] = 77
    pairs = sample_pairs(images, 5000, np.random.default_rng(0), alphas=[alpha, None])
    assert set(np.unique(pairs)) == {77, 99}


def test_views_without_a_visible_pixel_are_refused() -> None:
    with pytest.raises(InputError, match="visible"):
        sample_pairs([np.zeros((4, 4, 3), np.uint8)], 10, np.random.default_rng(0), alphas=[np.zeros((4, 4), np.uint8)])


@pytest.mark.parametrize("size", [1, 2])
def test_tiny_images_are_enhanced_without_an_error(size: int) -> None:
    image = np.full((size, size, 3), 128, np.uint8)
    result = fit_lut([image], "deutan", 1.0, settings=BRIEF)(image)
    assert np.isfinite(result).all()
    np.testing.assert_allclose(result, 128 / 255, atol=0.02)
