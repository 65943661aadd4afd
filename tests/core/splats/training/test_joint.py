"""Geometry and colours are fitted together to enhanced views that contradict each other."""

from dataclasses import replace

import numpy as np
import pytest

from cvdgs.core.consistency import SceneAgreement, SceneCorrespondences
from cvdgs.core.runtime.protocol import Reporter
from cvdgs.core.splats.raster import Rasterizer
from cvdgs.core.splats.renderer import SceneRenderer
from cvdgs.core.splats.training.joint import JointPlan, JointTraining
from cvdgs.core.splats.training.losses import SeenContrast, ViewGuide
from cvdgs.core.splats.training.plan import TrainingPlan

from .test_masked_training import BLACK as DARK
from .test_masked_training import photographs as photographs_of_wall
from .test_masked_training import scene as wall_of_many
from .test_moving import PLAN as MOVING
from .test_moving import visited
from .test_trainer import BLACK, photographs, wall


@pytest.fixture(scope="module")
def scene():
    return wall(300)


@pytest.fixture(scope="module")
def views(scene):
    return photographs(scene, 8)


def training(views, held_out=(), steps=200, **plan) -> JointTraining:
    return JointTraining(
        Rasterizer("cpu", 1), views, held_out, TrainingPlan(steps=steps, limit=600), JointPlan(**plan), BLACK, 0
    )


def without_consensus(views):
    return [ViewGuide(np.full(view.image.shape[:2], 255, np.uint8)) for view in views]


def test_shape_and_colours_are_recovered_from_the_views_alone(scene, views):
    fitted, held_out = views[:3] + views[4:], [views[3]]
    result = training(fitted, held_out, steps=300).train(
        scene.means, np.full((300, 3), 128, np.uint8), lambda _: without_consensus(fitted), Reporter()
    )
    assert result.curve[0]["psnr"] < 18
    assert result.curve[-1]["psnr"] > 22
    assert result.curve[-1]["psnr"] >= result.curve[-2]["psnr"] - 0.1
    assert result.curve[-1]["step"] > result.curve[-2]["step"]


def test_the_last_part_moves_shapes_too_and_asks_for_guides_once(scene, views):
    asked = []

    def guides_of(first):
        asked.append(first.gaussians)
        return without_consensus(views)

    result = training(views, steps=40).train(scene.means, np.full((300, 3), 128, np.uint8), guides_of, Reporter())
    (before,) = asked
    assert len(before) == len(result.gaussians)
    assert (before.means != result.gaussians.means).any()
    assert (before.opacity_logits != result.gaussians.opacity_logits).any()
    np.testing.assert_allclose(before.means, result.gaussians.means, atol=0.5)  # of a wall 20 units wide


@pytest.mark.parametrize("steps", [1, 2, 3])
def test_a_run_may_be_of_any_length(scene, views, steps):
    result = training(views, steps=steps).train(
        scene.means, np.full((300, 3), 128, np.uint8), lambda _: without_consensus(views), Reporter()
    )
    assert len(result.gaussians) > 0


def test_the_multi_view_loss_brings_the_sides_together(scene, views):
    """Two cameras that saw the wall darker make what they see darker; with the loss less so."""
    drifted = [replace(v, image=(v.image * 0.6).astype(np.uint8)) if i in (3, 4) else v for i, v in enumerate(views)]
    renderer = SceneRenderer(Rasterizer("cpu", 1), views, BLACK)
    correspondences = SceneCorrespondences(views, lambda i: renderer.depth(scene, i))
    agreement = SceneAgreement(correspondences, {i: view.image for i, view in enumerate(views)})
    consensus = agreement.consensus({i: view.image for i, view in enumerate(drifted)})
    guides = [ViewGuide(agreement.weights[i], consensus[i]) for i in range(len(views))]
    errors = []
    for weight in (0.0, 4.0):
        result = training(drifted, steps=100, share=0.5, multi_view_weight=weight).train(
            scene.means, np.full((300, 3), 128, np.uint8), lambda _: guides, Reporter()
        )
        shown = renderer.color(result.gaussians, 3).astype(float)
        errors.append((shown - views[3].image).mean())
    assert errors[0] < errors[1] < 3.0


@pytest.mark.slow
def test_what_moves_has_no_part_in_the_last_part_either():
    """Whatever it shows then: it is painted over between the two parts."""
    found, fitted = [], []
    for color in ((255, 0, 255), (0, 255, 0)):
        views, places = visited(photographs_of_wall(wall_of_many(), 30))

        def painted(first, views=views, color=color):
            found.append(first.moving)
            for view in views:
                if view.key in first.moving:
                    view.image[first.moving[view.key]] = color

        plan = TrainingPlan(steps=500, limit=600, moving=MOVING)
        contrast = SeenContrast(plan.contrast, views)
        joint = JointTraining(Rasterizer("cpu"), views, (), plan, JointPlan(share=0.2), DARK, 0, contrast)
        points = wall_of_many().means
        fitted.append(joint.train(points, np.full((len(points), 3), 128, np.uint8), painted, Reporter()).gaussians)
        assert found[-1].keys() >= places.keys()
    assert len(found[0]) >= 3
    for name, values in vars(fitted[0]).items():
        assert np.array_equal(values, getattr(fitted[1], name)), name
