"""What is masked has no part in a reconstruction, whatever it shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cvdgs.core.capture.model import PinholeCamera, View
from cvdgs.core.runtime.protocol import Reporter
from cvdgs.core.splats.calibration.exposure import estimate_log_gains
from cvdgs.core.splats.gaussians import SH_C0, Gaussians
from cvdgs.core.splats.raster import ContrastPlan, ParameterSet, RasterCamera, Rasterizer
from cvdgs.core.splats.renderer import SceneRenderer
from cvdgs.core.splats.scene_frame import SceneFrame
from cvdgs.core.splats.targets import Background, prepare_targets
from cvdgs.core.splats.training.evidence import gather_view_evidence
from cvdgs.core.splats.training.layers import LayerPlan, fit_layer
from cvdgs.core.splats.training.losses import SeenContrast
from cvdgs.core.splats.training.plan import TrainingPlan
from cvdgs.core.splats.training.trainer import Trainer

BLACK = Background((0.0, 0.0, 0.0))
WIDTH, HEIGHT = 96, 72
PATCH = 24  # pixels a side


def scene(count: int = 500) -> Gaussians:
    """A wall of coloured Gaussians, 3 units in front of the cameras."""
    rng = np.random.default_rng(0)
    means = np.column_stack([rng.uniform(-2.5, 2.5, count), rng.uniform(-2, 2, count), rng.normal(3, 0.1, count)])
    return Gaussians(
        means=means.astype(np.float32),
        log_scales=np.log(rng.uniform(0.12, 0.3, (count, 3))).astype(np.float32),
        quaternions=rng.standard_normal((count, 4)).astype(np.float32),
        opacity_logits=np.full(count, 3.0, np.float32),
        sh=((rng.uniform(0, 1, (count, 1, 3)) - 0.5) / SH_C0).astype(np.float32),
    )


def photographs(gaussians: Gaussians, count: int = 12) -> list[View]:
    camera = PinholeCamera(WIDTH, HEIGHT, 90.0, 90.0, WIDTH / 2, HEIGHT / 2)
    views = []
    for i, x in enumerate(np.linspace(-1, 1, count)):
        pose = np.eye(4)
        pose[:3, 3] = (-x, 0.3 * np.sin(3.0 * i), 0.0)
        views.append(View(f"{i:02d}", Path(f"{i}.png"), camera, pose, np.zeros((HEIGHT, WIDTH, 3), np.uint8)))
    renderer = SceneRenderer(Rasterizer("cpu"), views, BLACK)
    return [replace(view, image=renderer.color(gaussians, i)) for i, view in enumerate(views)]


def walked_through(views: Sequence[View]) -> list[View]:
    """The photographs, in every other one something of one colour that has walked on a little, and masks of it."""
    result = []
    for i, view in enumerate(views):
        x, y, z = view.world_to_camera[:3, :3] @ (0.2 - 0.03 * i, 0.1, 2.6) + view.world_to_camera[:3, 3]
        left, top = (round(value) - PATCH // 2 for value in (90.0 * x / z + WIDTH / 2, 90.0 * y / z + HEIGHT / 2))
        place = np.s_[max(top, 0) : top + PATCH, max(left, 0) : left + PATCH]
        image, mask = view.image.copy(), np.ones((HEIGHT, WIDTH), bool)
        if i % 2 == 0:
            image[place], mask[place] = (255, 0, 255), False
        result.append(replace(view, image=image, mask=mask))
    return result


@pytest.fixture(scope="module")
def gaussians() -> Gaussians:
    return scene()


@pytest.fixture(scope="module")
def clean(gaussians: Gaussians) -> list[View]:
    return photographs(gaussians)


def held_out_psnr(training: Sequence[View], held_out: Sequence[View], gaussians: Gaussians) -> float:
    """dB on clean photographs of a scene that was trained on `training`."""
    points = gaussians.means + np.random.default_rng(1).normal(0, 0.03, gaussians.means.shape).astype(np.float32)
    colors = np.full((len(points), 3), 128, np.uint8)
    plan = TrainingPlan(steps=300, limit=600, sh_degree=0, contrast=ContrastPlan(), moving=None)
    result = Trainer(Rasterizer("cpu"), training, held_out, points, colors, plan, BLACK, 0).train(Reporter())
    renderer = SceneRenderer(Rasterizer("cpu"), held_out, BLACK)
    return float(
        np.mean([renderer.fidelity(i, renderer.color(result.gaussians, i))["psnr"] for i in range(len(held_out))])
    )


def test_with_masks_a_scene_is_as_good_as_without_what_moves(gaussians: Gaussians, clean: list[View]) -> None:
    held_out, kept = clean[::4], [view for i, view in enumerate(clean) if i % 4]
    moving = walked_through(kept)
    without_it = held_out_psnr(kept, held_out, gaussians)
    masked = held_out_psnr(moving, held_out, gaussians)
    unmasked = held_out_psnr([replace(view, mask=None) for view in moving], held_out, gaussians)
    assert masked > without_it - 0.3
    assert unmasked < without_it - 0.6


def test_no_pixel_that_is_masked_has_a_part_in_training(gaussians: Gaussians, clean: list[View]) -> None:
    """The same run, bit by bit, whatever colour is behind the masks."""
    trained = []
    for color in (0, 255):
        views = walked_through(clean)
        for view in views:
            view.image[~view.mask] = color
        colors = np.full((len(gaussians), 3), 128, np.uint8)
        plan = TrainingPlan(steps=120, limit=800, contrast=ContrastPlan())
        result = Trainer(Rasterizer("cpu"), views, views[:2], gaussians.means, colors, plan, BLACK, 0)
        trained.append(result.train(Reporter()).gaussians)
    for name, values in vars(trained[0]).items():
        assert np.array_equal(values, getattr(trained[1], name)), name


def test_no_pixel_that_is_masked_has_a_part_in_a_layer(gaussians: Gaussians, clean: list[View]) -> None:
    fitted = []
    for color in (0, 255):
        views = walked_through(clean)
        for view in views:
            view.image[~view.mask] = color
        plan = LayerPlan(epochs=1, minimum_steps=24)
        contrast = SeenContrast(plan.contrast, views)
        fitted.append(fit_layer(Rasterizer("cpu"), gaussians, views, plan, BLACK, 0, contrast=contrast))
    assert np.array_equal(fitted[0].sh, fitted[1].sh)


def test_what_only_masked_pixels_show_counts_as_unseen(gaussians: Gaussians, clean: list[View]) -> None:
    blind = [replace(view, mask=np.zeros((HEIGHT, WIDTH), bool)) for view in clean]
    rasterizer, frame = Rasterizer("cpu"), SceneFrame.around(clean, np.zeros((0, 3), np.float32))
    parameters = ParameterSet.from_gaussians(frame.from_world(gaussians), rasterizer.device)
    for views, unseen in ((clean, False), (blind, True)):
        targets = prepare_targets(rasterizer, views, frame, BLACK)
        evidence = gather_view_evidence(rasterizer, parameters, targets, BLACK, complete=True)
        assert evidence.unseen.all() == unseen


def test_a_reduced_mask_leaves_out_every_block_with_something_masked(clean: list[View]) -> None:
    (view,) = walked_through(clean[:1])
    (target,) = prepare_targets(Rasterizer("cpu"), [view], SceneFrame.around(clean, gaussian_free()), BLACK, {4})
    for reduction in (1, 4):
        mask, (image, camera) = target.mask_at(reduction), target.at(reduction)
        assert mask is not None
        assert mask.pixels.shape == image.shape[:2] == (camera.height, camera.width)
        assert not (mask.pixels.numpy()[(image.numpy() == (255, 0, 255)).all(axis=2)]).any()
        assert isinstance(camera, RasterCamera)


def gaussian_free() -> np.ndarray:
    return np.zeros((0, 3), np.float32)


def test_the_exposure_is_that_of_what_is_looked_at(clean: list[View]) -> None:
    image = clean[0].image / np.float32(255.0)
    photograph, shown = (1.2 * image).astype(np.float32), np.ones(image.shape[:2], bool)
    photograph[: HEIGHT * 3 // 4], shown[: HEIGHT * 3 // 4] = 0.5, False
    assert estimate_log_gains(image, photograph, shown) == pytest.approx([0.0] * 3, abs=0.2)


def test_figures_are_of_what_is_looked_at(gaussians: Gaussians, clean: list[View]) -> None:
    renderer = SceneRenderer(Rasterizer("cpu"), walked_through(clean), BLACK)
    rendered = renderer.color(gaussians, 0)
    assert renderer.fidelity(0, rendered)["psnr"] > 50.0
    mask = renderer.mask(0)
    assert mask is not None
    assert np.array_equal(mask, renderer.views[0].mask)
    assert not renderer.depth(gaussians, 0)[1][~mask].any()
