"""The fit does what it is for within its budget, the same way every time, and copes with scenes that offer nothing."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors import safe_open
from safetensors.torch import save_file

from cvdgs.core.color.metrics import ccpr, naturalness
from cvdgs.core.color.simulation import Observer
from cvdgs.core.color.spaces import image_to_tensor, srgb_to_lab
from cvdgs.core.enhance import CganEnhancer, ColorLut, SceneNetworkEnhancer, make_enhancer
from cvdgs.core.enhance.gan.weights import save_generator
from cvdgs.core.enhance.scene.fit import FitSettings, FittedNetwork, fit_network
from cvdgs.core.enhance.scene.network import SceneNetwork
from cvdgs.core.enhance.scene.objective import ObjectiveWeights
from cvdgs.core.enhance.scene.views import reduced
from cvdgs.core.errors import InputError
from cvdgs.core.runtime.protocol import Reporter

from .. import textiles
from ..gan.networks import SMALL, random_generator

BRIEF = FitSettings(size=64, start_steps=4, table_steps=4, steps=16, rate=8e-3)  # enough to see the direction of a fit
LEAN = FitSettings(size=64, start_steps=8, table_steps=8, steps=40, rate=1e-2)
DEUTAN = Observer("deutan", 1.0)


def apply(fitted: FittedNetwork, image: np.ndarray, strength: float = 1.0) -> np.ndarray:
    observer = fitted.network.observer
    return SceneNetworkEnhancer(observer.cvd, observer.severity, observer.simulation, strength, fitted=fitted)(image)


def change(image: np.ndarray, result: np.ndarray) -> float:
    return naturalness(image_to_tensor(image), image_to_tensor(result)).delta_e_2000


def seen_contrast(image: np.ndarray, result: np.ndarray, observer: Observer) -> float:
    return ccpr(image_to_tensor(image), observer.simulate(image_to_tensor(result)))[0]


def views(cvd: str = "deutan") -> list[np.ndarray]:
    return [textiles.tartan(cvd, shift=shift, size=96) for shift in (0, 5)]


@lru_cache
def fitted(cvd: str, severity: float = 1.0, simulation: str = "machado") -> FittedNetwork:
    return fit_network(views(cvd), Observer(cvd, severity, simulation), settings=LEAN)


@pytest.mark.parametrize(
    "observer",
    [
        Observer("deutan", 1.0),
        Observer("deutan", 0.6),
        Observer("tritan", 1.0, "brettel"),
        Observer("protan", 1.0, "vienot"),
        Observer("achromat", 1.0),
    ],
    ids=str,
)
def test_confused_threads_become_distinct_in_a_view_that_the_fit_never_saw(observer: Observer) -> None:
    unseen = textiles.tartan(observer.cvd, shift=11, seed=9, size=96)
    before = seen_contrast(unseen, unseen, observer)
    result = apply(fitted(observer.cvd, observer.severity, observer.simulation), unseen)
    assert seen_contrast(unseen, result, observer) >= min(before + 0.4, 0.9)


def test_an_unreadable_plate_becomes_readable() -> None:
    image, labels = textiles.plate("deutan", size=128)

    def difference(picture: np.ndarray) -> float:
        lab = srgb_to_lab(DEUTAN.simulate(image_to_tensor(picture))).numpy()
        return float(np.linalg.norm(lab[:, labels == 2].mean(1) - lab[:, labels == 1].mean(1)))

    assert difference(image) < 2.0
    assert difference(apply(fit_network([image], DEUTAN, settings=LEAN), image)) >= 10.0


@pytest.mark.parametrize("budget", [0.8, 2.5])
def test_the_budget_is_met(budget: float) -> None:
    image = textiles.tartan(size=64)  # which the fit sees as it is
    found = fit_network([image], DEUTAN, budget=budget, settings=LEAN)
    assert found.budget == budget
    assert 0.7 * budget <= found.change <= 1.02 * budget
    assert change(image, apply(found, image)) == pytest.approx(found.change, rel=0.05)


def test_without_a_budget_a_scene_that_loses_nothing_is_nearly_left_alone() -> None:
    generator = np.random.default_rng(0)
    blues_and_yellows = np.array([[40, 60, 150], [220, 200, 90]])[generator.integers(0, 2, (64, 64))]
    easy = np.kron(blues_and_yellows[::8, ::8], np.ones((8, 8, 1))).astype(np.uint8)
    assert fit_network([easy], DEUTAN, settings=BRIEF).budget < 0.5
    assert fitted("deutan").budget > 3.0


def test_greys_and_colours_near_them_hardly_change() -> None:
    ramp = np.repeat(np.linspace(0, 1, 64, dtype=np.float32)[None, :, None], 3, axis=2).repeat(8, 0)
    np.testing.assert_array_equal(apply(fitted("deutan"), ramp), ramp)
    tinted = np.clip(ramp + np.array([0.004, 0.0, -0.004], np.float32), 0.0, 1.0)
    assert change(tinted, apply(fitted("deutan"), tinted)) < 0.1 * fitted("deutan").change


def test_the_same_seed_gives_the_same_bits_on_any_number_of_threads_and_another_seed_others() -> None:
    threads = torch.get_num_threads()
    found = []
    for seed, used in ((3, 1), (3, 2), (4, 1)):
        torch.set_num_threads(used)
        found.append(fit_network(views(), DEUTAN, settings=BRIEF, seed=seed).network.state_dict())
        assert torch.get_num_threads() == used
    torch.set_num_threads(threads)
    assert all(torch.equal(found[0][name], found[1][name]) for name in found[0])
    assert not torch.equal(found[0]["table"], found[2]["table"])


@pytest.mark.parametrize(
    "image",
    [
        np.full((40, 30, 3), 128, np.uint8),
        np.zeros((20, 20, 3), np.uint8),
        np.full((1, 1, 3), (200, 30, 40), np.uint8),
        np.full((24, 24, 3), (200, 30, 40), np.uint8),
        np.repeat(np.random.default_rng(0).integers(0, 256, (32, 32, 1), np.uint8), 3, axis=2),
    ],
    ids=["grey", "black", "one pixel", "one colour", "grey noise"],
)
def test_a_scene_that_offers_nothing_is_left_nearly_as_it_is(image: np.ndarray) -> None:
    result = apply(fit_network([image], DEUTAN, settings=BRIEF), image)
    assert np.isfinite(result).all()
    assert change(image, result) < 0.5


def test_of_a_thousand_views_a_few_are_looked_at() -> None:
    looked_at: list[int] = []

    class Views(list):
        def __getitem__(self, index):
            looked_at.append(int(index))
            return super().__getitem__(index)

    fit_network(Views([textiles.tartan(size=32)] * 1000), DEUTAN, settings=BRIEF)
    assert len(looked_at) == BRIEF.views
    assert (looked_at[0], looked_at[-1]) == (0, 999)


def test_observers_who_need_opposite_directions_each_get_theirs() -> None:
    scene = textiles.tartan("protan", size=64)
    redness, leanings = srgb_to_lab(image_to_tensor(scene))[1], []
    for cvd in ("deutan", "protan"):
        observer = Observer(cvd, 1.0)
        result = apply(fit_network([scene], observer, settings=LEAN), scene)
        lighter = srgb_to_lab(image_to_tensor(result))[0] - srgb_to_lab(image_to_tensor(scene))[0]
        leanings.append(float(torch.corrcoef(torch.stack([redness.flatten(), lighter.flatten()]))[0, 1]))
        assert seen_contrast(scene, result, observer) > 0.9
    assert leanings[0] > 0.5  # what was red is lighter for one of them, and darker for the other
    assert leanings[1] < -0.5


def test_uncovered_pixels_do_not_steer() -> None:
    image, alpha = textiles.tartan(size=64), np.zeros((64, 64), np.uint8)
    alpha[:, :40] = 255
    other = image.copy()
    other[:, 40:] = (255, 0, 0)
    results = [
        fit_network([one], DEUTAN, alphas=[alpha], settings=BRIEF).network.state_dict() for one in (image, other)
    ]
    assert all(torch.equal(results[0][name], results[1][name]) for name in results[0])
    with pytest.raises(InputError, match="visible"):
        fit_network([image], DEUTAN, alphas=[0 * alpha], settings=BRIEF)


def test_without_a_fit_a_start_keeps_as_much_of_its_change_as_its_own_objective_wants() -> None:
    nothing = ObjectiveWeights(**dict.fromkeys(vars(ObjectiveWeights()), 0.0))
    kept = []
    for wanted in (nothing, replace(nothing, neighbours=80.0)):
        found = fit_network(
            views(),
            DEUTAN,
            starts=[fitted("deutan").network],
            budget=fitted("deutan").budget,
            start_weights=wanted,
            settings=replace(LEAN, table_steps=0, steps=0),
        )
        kept.append(found.change)
    assert kept[1] > 1.5 * kept[0] > 0.0


def test_a_fit_goes_on_from_the_best_of_some_starts_and_leaves_them_as_they_were() -> None:
    start, reversed_ = fitted("deutan").network, SceneNetwork(DEUTAN)
    reversed_.load_state_dict(start.state_dict())
    reversed_.scale(-1.0)
    before = {name: value.clone() for name, value in start.state_dict().items()}
    short = replace(LEAN, shifts=(0.0,), start_steps=1, table_steps=1, steps=4, rate=1e-3)
    found = fit_network(views(), DEUTAN, starts=[reversed_, start], budget=fitted("deutan").budget, settings=short)
    from_nothing = fit_network(views(), DEUTAN, budget=fitted("deutan").budget, settings=short)
    assert all(torch.equal(before[name], value) for name, value in start.state_dict().items())
    gained, nothing = (seen_contrast(views()[0], apply(one, views()[0]), DEUTAN) for one in (found, from_nothing))
    assert gained > 0.8 > nothing + 0.3


def test_a_view_whose_few_covered_pixels_are_thinned_out_has_finite_colours_and_does_not_steer() -> None:
    whole, thinned = (textiles.tartan(shift=shift, size=128) for shift in (0, 5))
    alpha = np.zeros(whole.shape[:2], np.uint8)
    alpha[1, 1] = 255
    settings = replace(BRIEF, size=8)  # every second pixel of 128
    pixels, coverage = reduced(thinned, alpha, settings.size)
    assert coverage is not None
    assert torch.isfinite(pixels).all()
    assert not coverage.any()
    found = fit_network([whole, thinned], DEUTAN, alphas=[None, alpha], budget=2.0, settings=settings)
    assert all(torch.isfinite(value).all() for value in found.network.state_dict().values())
    assert change(whole, apply(found, whole)) > 0.1


@pytest.mark.parametrize("starts", [0, 1])
def test_progress_rises_evenly_to_one(starts: int) -> None:
    class Recorder(Reporter):
        def __init__(self) -> None:
            self.fractions: list[float] = []

        def progress(self, stage: str, fraction: float, message: str = "") -> None:
            assert stage == "enhance"
            self.fractions.append(fraction)

    recorder = Recorder()
    given = [fitted("deutan").network] * starts
    fit_network([textiles.tartan(size=32)], DEUTAN, starts=given, settings=BRIEF, reporter=recorder)
    assert all(0.0 <= step <= 0.06 for step in np.diff(recorder.fractions))
    assert len(recorder.fractions) >= 20
    assert recorder.fractions[-1] == 1.0


@pytest.mark.parametrize(("severity", "strength"), [(0.0, 1.0), (1.0, 0.0)])
def test_severity_zero_and_strength_zero_are_the_identity(severity: float, strength: float) -> None:
    image = textiles.tartan(size=32)
    enhancer = make_enhancer("scene", "deutan", severity, strength=strength)
    enhancer.fit([image])
    np.testing.assert_array_equal(enhancer(image), image.astype(np.float32) / np.float32(255))
    np.testing.assert_array_equal(enhancer.enhance_bytes(image), image)


def test_bytes_are_the_floating_point_result_rounded() -> None:
    image, enhancer = views()[0], SceneNetworkEnhancer("deutan", 1.0, fitted=fitted("deutan"))
    np.testing.assert_array_equal(enhancer.enhance_bytes(image), (enhancer(image) * 255.0).round().astype(np.uint8))


def test_an_enhancer_must_be_fitted_first(tmp_path: Path) -> None:
    enhancer = SceneNetworkEnhancer("deutan", 1.0)
    for use in (lambda: enhancer(views()[0]), lambda: enhancer.save(tmp_path / "early.safetensors")):
        with pytest.raises(RuntimeError, match="fit"):
            use()
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("budget", [0.0, -1.0, float("nan"), float("inf")])
def test_a_budget_that_is_none_is_refused(budget: float) -> None:
    with pytest.raises(InputError, match="budget"):
        SceneNetworkEnhancer("deutan", 1.0, budget=budget)


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    SceneNetworkEnhancer("deutan", 1.0, fitted=fitted("deutan")).save(tmp_path / "layer.deutan-1.0.safetensors")
    return tmp_path / "layer.deutan-1.0.safetensors"


def test_a_saved_network_is_an_enhancer_that_needs_no_fit_and_has_its_lut(saved: Path, tmp_path: Path) -> None:
    enhancer, image = make_enhancer(str(saved), "deutan", 1.0), views()[0]
    np.testing.assert_array_equal(enhancer(image), apply(fitted("deutan"), image))
    enhancer.fit([textiles.tartan(size=32)])
    np.testing.assert_array_equal(enhancer(image), apply(fitted("deutan"), image))
    enhancer.export_cube(tmp_path / "scene.cube", "scene")
    assert isinstance(enhancer.lut, ColorLut)
    assert "LUT_3D_SIZE 33" in (tmp_path / "scene.cube").read_text(encoding="utf-8")


def test_half_the_strength_of_a_saved_network_is_half_the_way(saved: Path) -> None:
    image = views()[0]
    half, full = (make_enhancer(str(saved), "deutan", 1.0, strength=strength)(image) for strength in (0.5, 1.0))
    np.testing.assert_allclose(half, (image / 255.0 + full) / 2.0, atol=1e-6)


def test_a_file_of_the_gan_s_weights_is_still_the_gan(tmp_path: Path) -> None:
    save_generator(random_generator(SMALL), tmp_path / "weights.safetensors")
    assert isinstance(make_enhancer(str(tmp_path / "weights.safetensors"), "deutan", 1.0), CganEnhancer)


def test_a_network_for_another_observer_is_refused_with_the_options_that_it_was_made_with(saved: Path) -> None:
    with pytest.raises(InputError, match=r"not for tritan.*--cvd deutan --severity 1"):
        make_enhancer(str(saved), "tritan", 1.0)
    assert make_enhancer(str(saved), "tritan", 0.0).is_identity


def rewritten(path: Path, metadata: dict[str, str], **tensors: torch.Tensor) -> None:
    """Write the file again with other metadata and tensors."""
    with safe_open(path, framework="pt") as file:
        kept = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - it is no dictionary
        metadata = {**file.metadata(), **metadata}
    save_file({**kept, **tensors}, path, metadata=metadata)


@pytest.mark.parametrize(
    ("metadata", "tensors", "said"),
    [
        ({"version": "0"}, {}, "version 0"),
        ({"cvd": "nobody"}, {}, "description"),
        ({"severity": "much"}, {}, "description"),
        ({"budget": "nan"}, {}, "description"),
        ({}, {"table": torch.zeros(9, 9, 9, 3)}, "checksum"),
        ({"sha256": "0"}, {}, "checksum"),
    ],
)
def test_files_that_were_tampered_with_are_refused_in_one_line(saved: Path, metadata, tensors, said: str) -> None:
    rewritten(saved, metadata, **tensors)
    with pytest.raises(InputError, match=said) as refused:
        make_enhancer(str(saved), "deutan", 1.0)
    assert "\n" not in str(refused.value)


def test_every_truncated_file_is_refused(saved: Path) -> None:
    content = saved.read_bytes()
    for end in np.linspace(0, len(content) - 1, 12).astype(int):
        saved.write_bytes(content[:end])
        with pytest.raises(InputError, match=r"cannot be read|checksum"):
            make_enhancer(str(saved), "deutan", 1.0)


def test_a_network_of_other_shapes_does_not_load(saved: Path) -> None:
    other = SceneNetwork(DEUTAN, hidden=8)
    path = saved.with_name("other.safetensors")
    SceneNetworkEnhancer("deutan", 1.0, fitted=replace(fitted("deutan"), network=other)).save(path)
    with pytest.raises(InputError, match="description"):
        make_enhancer(str(path), "deutan", 1.0)
