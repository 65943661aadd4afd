"""What views say about Gaussians, against images that are linear in the colours."""

from dataclasses import replace

import numpy as np
import pytest

from cvdgs.core.splats.gaussians import SH_C0
from cvdgs.core.splats.raster import ParameterSet, Rasterizer
from cvdgs.core.splats.scene_frame import SceneFrame
from cvdgs.core.splats.targets import prepare_targets
from cvdgs.core.splats.training.evidence import ERROR_FLOOR, gather_view_evidence

from .test_trainer import BLACK, photographs, wall


@pytest.fixture(scope="module")
def setting():
    """Some Gaussians, one of them black, in a frame, and views of them with one corner painted over."""
    scene = wall(60)
    scene.sh[7] = -0.7 / SH_C0
    views = [replace(view, image=view.image.copy()) for view in photographs(scene, count=4)]
    for view in views:
        view.image[:30, :30] = 255 - view.image[:30, :30]
    frame = SceneFrame.around(views, scene.means)
    rasterizer = Rasterizer("cpu", 1)
    return rasterizer, frame.from_world(scene), prepare_targets(rasterizer, views, frame, BLACK, {2})


def render(rasterizer, gaussians, view):
    parameters = ParameterSet.from_gaussians(gaussians)
    return rasterizer.render(parameters, view.at(1)[1], BLACK.color).color.numpy().astype(np.float64)


@pytest.mark.parametrize("number", [0, 7, 23])
def test_weight_and_blame_are_what_a_change_of_the_colour_does_to_the_image(setting, number):
    rasterizer, scene, views = setting
    view = views[1]
    grey = replace(scene, sh=np.zeros_like(scene.sh))
    brighter = replace(grey, sh=grey.sh.copy())
    brighter.sh[number] += 0.25 / SH_C0
    weight = (render(rasterizer, brighter, view) - render(rasterizer, grey, view)).mean(axis=2) / 0.25
    error = np.abs(render(rasterizer, scene, view) - view.at(1)[0].numpy() / 255.0).mean(axis=2)
    said = gather_view_evidence(rasterizer, ParameterSet.from_gaussians(scene), [view], BLACK, complete=False)
    assert said.weight[number] == pytest.approx(weight.sum(), rel=2e-3, abs=1e-3)
    threshold = max(np.percentile(error, 70.0), ERROR_FLOOR)
    blame = (weight * error).sum()
    complains = blame > threshold * weight.sum() and weight.sum() > 0.05
    assert said.votes[number] == complains
    assert said.blame[number] == pytest.approx(blame if complains else 0.0, rel=5e-3, abs=1e-3)


def test_views_complain_about_the_corner_that_does_not_fit_and_not_about_the_rest(setting):
    rasterizer, scene, views = setting
    said = gather_view_evidence(rasterizer, ParameterSet.from_gaussians(scene), views, BLACK, complete=True)
    assert said.complete
    assert said.views == 4
    assert 0 < (said.votes >= 2).sum() < 25
    assert said.seen.max() == 4


def test_perfect_views_do_not_complain():
    scene = wall(60)
    views = photographs(scene, count=3)
    frame, rasterizer = SceneFrame.around(views, scene.means), Rasterizer("cpu", 1)
    targets = prepare_targets(rasterizer, views, frame, BLACK)
    parameters = ParameterSet.from_gaussians(frame.from_world(scene))
    said = gather_view_evidence(rasterizer, parameters, targets, BLACK, complete=True)
    assert said.votes.max() == 0
    assert said.blame.max() == 0.0


def test_weights_at_a_lower_resolution_are_in_pixels_of_the_full_one(setting):
    rasterizer, scene, views = setting
    parameters = ParameterSet.from_gaussians(scene)
    full, half = (
        gather_view_evidence(rasterizer, parameters, views, BLACK, complete=True, reduction=reduction).weight.sum()
        for reduction in (1, 2)
    )
    assert half == pytest.approx(full, rel=0.05)
