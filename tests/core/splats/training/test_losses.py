"""Guided losses: pixels with gloss count less, and colours are pulled towards what the views agree on."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from cvdgs.core.color.matrices import linear_simulation
from cvdgs.core.color.simulation import Observer
from cvdgs.core.consistency import Consensus
from cvdgs.core.evaluate.scores import Scorer
from cvdgs.core.splats.gaussians import SH_C0, Gaussians
from cvdgs.core.splats.raster import ContrastPlan, ParameterSet, RasterCamera, Rasterizer
from cvdgs.core.splats.renderer import SceneRenderer
from cvdgs.core.splats.training import layers, losses
from cvdgs.core.splats.training.layers import LayerPlan, fit_layer
from cvdgs.core.splats.training.losses import MultiViewLoss, SeenContrast, ViewGuide

from .test_trainer import BLACK, photographs, wall

PLAN = LayerPlan(epochs=20, minimum_steps=120)
BAND = slice(20, 50)  # rows
HEIGHT, WIDTH = 24, 32
SOFTNESS = 2.0 / 255.0


@pytest.fixture(scope="module")
def scene():
    return wall(300)


@pytest.fixture(scope="module")
def views(scene):
    return photographs(scene, 6)


def highlighted(views):
    """Most views have a band of glare; whoever believes them all paints it onto the wall."""
    glare = []
    for i, view in enumerate(views):
        image = view.image.copy()
        if i < 4:
            image[BAND] = 255
        glare.append(replace(view, image=image))
    return glare


def psnr_in_band(scene, layer, views, index: int) -> float:
    shown = SceneRenderer(Rasterizer("cpu", 1), views, BLACK).color(layer, index)[BAND].astype(float)
    return -10 * np.log10(((shown - views[index].image[BAND]) ** 2).mean() / 255**2)


def test_pixels_of_little_weight_hardly_count(scene, views):
    weights = [np.full(view.image.shape[:2], 255, np.uint8) for view in views]
    for i in range(4):
        weights[i][BAND] = 5
    rasterizer, glare = Rasterizer("cpu", 1), highlighted(views)
    believed = fit_layer(rasterizer, scene, glare, PLAN, BLACK, seed=0)
    doubted = fit_layer(rasterizer, scene, glare, PLAN, BLACK, 0, guides=[ViewGuide(w) for w in weights])
    assert psnr_in_band(scene, doubted, views, 4) > psnr_in_band(scene, believed, views, 4) + 6


def test_the_consensus_pulls_the_colours_as_far_as_its_weight_says(scene, views):
    everywhere = [np.full(view.image.shape[:2], 255, np.uint8) for view in views]
    grey = [Consensus.of(128.0 - view.image, everywhere[0] > 0) for view in views]
    guides = [ViewGuide(weights, said) for weights, said in zip(everywhere, grey, strict=True)]
    rasterizer = Rasterizer("cpu", 1)
    renderer = SceneRenderer(rasterizer, views, BLACK)
    apart = []
    for weight in (0.0, 0.5, 50.0):
        layer = fit_layer(rasterizer, scene, views, replace(PLAN, multi_view_weight=weight), BLACK, 0, guides=guides)
        apart.append(np.abs(renderer.color(layer, 2)[BAND].astype(float) - 128).mean())
    assert apart[0] > apart[1] > apart[2]
    assert apart[2] < 0.3 * apart[0]


@pytest.fixture
def frame():
    rng = np.random.default_rng(0)
    scene = Gaussians(
        rng.uniform([-1, -1, 3], [1, 1, 4], (60, 3)).astype(np.float32),
        np.full((60, 3), np.log(0.3), np.float32),
        rng.standard_normal((60, 4)).astype(np.float32),
        np.full(60, 2.0, np.float32),
        ((rng.uniform(0, 1, (60, 1, 3)) - 0.5) / SH_C0).astype(np.float32),
    )
    rasterizer = Rasterizer("cpu", 1)
    camera = RasterCamera(WIDTH, HEIGHT, 30.0, 30.0, WIDTH / 2, HEIGHT / 2, np.eye(4))
    return rasterizer.render(ParameterSet.from_gaussians(scene), camera)


@pytest.fixture
def said():
    """What the others say of a view, the view's own picture, and the weights of its pixels."""
    rng = np.random.default_rng(1)
    image, weights = rng.integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8), rng.integers(0, 256, (HEIGHT, WIDTH), np.uint8)
    known = np.arange(HEIGHT)[:, None] * np.ones(WIDTH) >= 8
    return Consensus.of(rng.uniform(-90, 90, image.shape), known), image, weights


def loss(color: np.ndarray, said: Consensus, image: np.ndarray, weights: np.ndarray) -> float:
    """L_mv by its formula."""
    apart = color.astype(np.float64) - said.colors(image) / 255.0
    counted = np.where(said.known(HEIGHT, WIDTH), weights, 0)
    penalty = np.sqrt(apart**2 + SOFTNESS**2).sum(axis=2)
    return float((counted * penalty).sum() / (3.0 * counted.sum(dtype=np.float64)))


def pulled(frame, said: Consensus, image: np.ndarray, weights: np.ndarray, strength: float) -> np.ndarray:
    """The gradient that the multi-view loss adds."""
    frame.grad_color.fill_(0.25)
    pull = MultiViewLoss(said, weights, strength, wp.get_device("cpu"))
    pull.add_gradient(frame, wp.array(image, dtype=wp.uint8, device="cpu"))
    return frame.grad_color.numpy() - 0.25


def test_the_gradient_is_that_of_the_formula_and_is_added(frame, said):
    strength, step = 0.7, 1e-6
    color = frame.color.numpy().astype(np.float64)
    gradient = pulled(frame, *said, strength)
    for row, column, channel in ((3, 3, 0), (10, 20, 1), (20, 5, 2), (23, 31, 0)):
        moved = [color.copy(), color.copy()]
        moved[0][row, column, channel] += step
        moved[1][row, column, channel] -= step
        expected = strength * (loss(moved[0], *said) - loss(moved[1], *said)) / (2 * step)
        assert gradient[row, column, channel] == pytest.approx(expected, rel=1e-3, abs=1e-8)


def test_where_nobody_has_a_say_nothing_is_added(frame, said):
    consensus, image, weights = said
    assert (pulled(frame, *said, 1.0)[:8] == 0.0).all()
    assert (pulled(frame, consensus, image, np.zeros_like(weights), 1.0) == 0.0).all()


def contrast_left(layer: Gaussians, views, observer: Observer) -> float:
    renderer = SceneRenderer(Rasterizer("cpu", 1), views, BLACK)
    return float(np.mean([Scorer(view.image, observer).ccpr(renderer.color(layer, i)) for i, view in enumerate(views)]))


@pytest.mark.parametrize("observer", [Observer("deutan", 1.0), Observer("tritan", 0.7, "brettel")], ids=str)
def test_the_contrast_hinge_keeps_contrast_that_a_coarse_scene_would_lose(scene, observer):
    fine = photographs(wall(3000), 6)
    simulation = linear_simulation(observer.cvd, observer.severity, observer.simulation)
    rasterizer, kept = Rasterizer("cpu", 1), []
    for weight in (0.0, 4.0, 10.0):
        plan = replace(PLAN, contrast=ContrastPlan(weight=weight))
        contrast = SeenContrast(plan.contrast, fine, simulation)
        layer = fit_layer(rasterizer, scene, fine, plan, BLACK, 0, contrast=contrast)
        kept.append(contrast_left(layer, fine, observer))
    assert kept[0] + 0.01 < kept[1] < kept[2]


def test_views_without_any_contrast_are_fitted_as_ever(scene, views):
    plain = [replace(view, image=np.full_like(view.image, 90)) for view in views]
    with_hinge = fit_layer(
        Rasterizer("cpu", 1), scene, plain, PLAN, BLACK, 0, contrast=SeenContrast(PLAN.contrast, plain)
    )
    without = fit_layer(Rasterizer("cpu", 1), scene, plain, PLAN, BLACK, 0)
    np.testing.assert_array_equal(with_hinge.sh, without.sh)


def test_noise_of_the_photographs_is_not_fitted_as_detail(scene, views, monkeypatch):
    random = np.random.default_rng(0)
    noisy = [
        replace(view, image=np.clip(view.image + random.normal(0, 20, view.image.shape), 0, 255).astype(np.uint8))
        for view in views[:3]
    ]
    rasterizer, error = Rasterizer("cpu", 1), []
    for known in (True, False):
        if not known:
            monkeypatch.setattr(layers, "typical_noise", lambda _: 0.0)
            monkeypatch.setattr(losses, "typical_noise", lambda _: 0.0)
        layer = fit_layer(rasterizer, scene, noisy, PLAN, BLACK, 0, contrast=SeenContrast(PLAN.contrast, noisy))
        shown = SceneRenderer(rasterizer, views, BLACK)
        clean = [shown.color(layer, index) - view.image.astype(float) for index, view in enumerate(views)]
        error.append(np.square(clean).mean())
    assert error[0] < 0.9 * error[1]
