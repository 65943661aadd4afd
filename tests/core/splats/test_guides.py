"""A layer's fit listens to what the other views say: less to gloss, and towards what they agree on."""

from dataclasses import replace

import numpy as np
import pytest

from cvdgs.core.consistency import Consensus
from cvdgs.core.splats.guides import ViewGuide
from cvdgs.core.splats.layers import LayerPlan, fit_layer
from cvdgs.core.splats.raster import Rasterizer
from cvdgs.core.splats.renderer import SceneRenderer

from .test_trainer import BLACK, photographs, wall

PLAN = LayerPlan(epochs=20, minimum_steps=120)
BAND = slice(20, 50)  # rows


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
    weights = [np.ones(view.image.shape[:2], np.float32) for view in views]
    for i in range(4):
        weights[i][BAND] = 0.02
    rasterizer, glare = Rasterizer("cpu", 1), highlighted(views)
    believed = fit_layer(rasterizer, scene, glare, PLAN, BLACK, seed=0)
    doubted = fit_layer(rasterizer, scene, glare, PLAN, BLACK, 0, guides=[ViewGuide(w) for w in weights])
    assert psnr_in_band(scene, doubted, views, 4) > psnr_in_band(scene, believed, views, 4) + 6


def test_the_consensus_pulls_the_colours_as_far_as_its_weight_says(scene, views):
    grey = [Consensus(np.full_like(view.image, 128), np.ones(view.image.shape[:2], np.float32)) for view in views]
    guides = [
        ViewGuide(np.ones(view.image.shape[:2], np.float32), said) for view, said in zip(views, grey, strict=True)
    ]
    rasterizer = Rasterizer("cpu", 1)
    renderer = SceneRenderer(rasterizer, views, BLACK)
    apart = []
    for weight in (0.0, 0.5, 50.0):
        layer = fit_layer(rasterizer, scene, views, replace(PLAN, multi_view_weight=weight), BLACK, 0, guides=guides)
        apart.append(np.abs(renderer.color(layer, 2)[BAND].astype(float) - 128).mean())
    assert apart[0] > apart[1] > apart[2]
    assert apart[2] < 0.3 * apart[0]
