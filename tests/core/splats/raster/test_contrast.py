"""The contrast hinge's kernels, against the same loss written on float64 tensors."""

from __future__ import annotations

import numpy as np
import pytest
import torch
import warp as wp
from numpy.typing import NDArray

from cvdgs.core.color.matrices import linear_simulation
from cvdgs.core.color.simulation import simulate
from cvdgs.core.color.spaces import srgb_to_lab
from cvdgs.core.splats.gaussians import Gaussians
from cvdgs.core.splats.raster import ContrastHinge, ContrastPlan, ParameterSet, RasterCamera, Rasterizer

HEIGHT, WIDTH = 21, 27  # neither a multiple of the vectors' eight lanes
OBSERVERS = [
    ("deutan", 1.0, "machado"),
    ("protan", 0.4, "machado"),
    ("tritan", 1.0, "brettel"),
    ("deutan", 0.7, "vienot"),
    ("achromat", 1.0, "machado"),
    ("deutan", 0.0, "machado"),
]


def differences(lab: torch.Tensor) -> list[torch.Tensor]:
    """Lab differences of the neighbours to the right, below, below right and below left; (3, ...) each."""
    return [
        lab[:, :, 1:] - lab[:, :, :-1],
        lab[:, 1:] - lab[:, :-1],
        lab[:, 1:, 1:] - lab[:, :-1, :-1],
        lab[:, 1:, :-1] - lab[:, :-1, 1:],
    ]


def reference(
    rendered: torch.Tensor, target: torch.Tensor, photograph: torch.Tensor, observer: tuple, plan: ContrastPlan
) -> torch.Tensor:
    seen = [srgb_to_lab(simulate(image, *observer)) for image in (rendered.clamp(0, 1), target)]
    total = torch.zeros((), dtype=torch.float64)
    for p, q, o in zip(*(differences(lab) for lab in (*seen, srgb_to_lab(photograph))), strict=True):
        n = q.norm(dim=0)
        counts = (o.norm(dim=0) >= plan.listed) & (n >= plan.threshold)
        lacks = (n.clamp(max=plan.cap) - (p * q).sum(0) / n.clamp(min=1e-9)).clamp(min=0)
        length = (p.square().sum(0) + 1e-30).sqrt()
        invents = plan.invented * (length - n.clamp(min=plan.floor)).clamp(min=0)
        total = total + torch.where(counts, lacks, invents).sum()
    return plan.weight * total / (100.0 * 4 * HEIGHT * WIDTH)


class Scene:
    """A frame with any colours one likes."""

    def __init__(self, threads: int | None = None) -> None:
        self.rasterizer = Rasterizer("cpu", threads)
        nothing = np.zeros((1, 3), np.float32)
        gaussians = Gaussians(
            means=nothing - [0, 0, 5],
            log_scales=nothing,
            quaternions=np.array([[1, 0, 0, 0]], np.float32),
            opacity_logits=np.zeros(1, np.float32),
            sh=np.zeros((1, 1, 3), np.float32),
        )
        camera = RasterCamera(WIDTH, HEIGHT, 20.0, 20.0, WIDTH / 2, HEIGHT / 2, np.eye(4))
        self.frame = self.rasterizer.render(ParameterSet.from_gaussians(gaussians), camera)

    def gradient(
        self, rendered: NDArray, target: NDArray, photograph: NDArray, observer: tuple, plan: ContrastPlan
    ) -> NDArray[np.float32]:
        hinge = ContrastHinge(self.rasterizer, plan, linear_simulation(*observer))
        self.frame.color.assign(rendered.astype(np.float32))
        self.frame.grad_color.zero_()
        pairs = hinge.pairs(wp.array(photograph, dtype=wp.uint8))
        hinge.add_gradient(self.frame, wp.array(target, dtype=wp.uint8), pairs)
        return self.frame.grad_color.numpy().copy()


def pictures(seed: int = 0) -> tuple[NDArray, NDArray, NDArray]:
    """A rendering, with values outside [0, 1], and two photographs with weak and strong differences."""
    rng = np.random.default_rng(seed)
    photograph = rng.integers(60, 200, (HEIGHT, WIDTH, 3)) // 9 * 9
    photograph[:, : WIDTH // 3] = 128 + rng.integers(-4, 5, (HEIGHT, WIDTH // 3, 3))
    target = np.clip(photograph + rng.integers(-20, 21, photograph.shape), 0, 255)
    rendered = target / 255.0 * 0.8 + 0.1 + rng.normal(0, 0.05, photograph.shape)
    rendered[:2, :3], rendered[-2:, -3:] = -0.1, 1.1
    return rendered.astype(np.float32), target.astype(np.uint8), photograph.astype(np.uint8)


def as_tensor(image: NDArray) -> torch.Tensor:
    scale = 255.0 if image.dtype == np.uint8 else 1.0
    return torch.from_numpy(image.astype(np.float64) / scale).permute(2, 0, 1)


@pytest.mark.parametrize("observer", OBSERVERS, ids=str)
@pytest.mark.parametrize(
    "plan", [ContrastPlan(), ContrastPlan(2.0, 5.0, 5.0, 1e3, invented=0.5)], ids=["layer", "scene"]
)
def test_the_gradient_is_that_of_the_loss_in_float64(observer: tuple, plan: ContrastPlan) -> None:
    rendered, target, photograph = pictures()
    image = as_tensor(rendered).requires_grad_()
    reference(image, as_tensor(target), as_tensor(photograph), observer, plan).backward()
    expected = image.grad.permute(1, 2, 0).numpy()
    found = Scene().gradient(rendered, target, photograph, observer, plan)
    assert np.abs(expected).max() > 1e-5
    assert np.abs(found - expected).max() < 1e-5 * np.abs(expected).max()


def test_the_number_of_threads_changes_no_bit() -> None:
    arguments = (*pictures(), OBSERVERS[0], ContrastPlan())
    np.testing.assert_array_equal(Scene(1).gradient(*arguments), Scene(2).gradient(*arguments))


def test_a_rendering_with_its_targets_contrast_is_left_alone() -> None:
    _, target, photograph = pictures()
    plan = ContrastPlan(cap=5.0)
    gradient = Scene().gradient(target / 255.0, target, photograph, OBSERVERS[0], plan)
    assert not gradient.any()


def test_pictures_without_contrast_ask_for_nothing() -> None:
    rendered = pictures()[0]
    grey = np.full((HEIGHT, WIDTH, 3), 120, np.uint8)
    assert not Scene().gradient(rendered, grey, grey, OBSERVERS[0], ContrastPlan()).any()


def test_noise_that_is_known_is_no_contrast() -> None:
    noise = 5.0 / 255.0
    flat = np.random.default_rng(0).normal(120.0, 5.0, (HEIGHT, WIDTH, 3))
    edge = np.where(np.arange(WIDTH)[:, None] < WIDTH // 2, flat, flat + 100.0)
    usual, beyond = (ContrastHinge(Scene().rasterizer, plan) for plan in (ContrastPlan(), ContrastPlan().beyond(noise)))

    def to_the_right(hinge: ContrastHinge, image: NDArray) -> NDArray[np.bool_]:
        return hinge.pairs(wp.array(np.clip(image, 0, 255).astype(np.uint8), dtype=wp.uint8)).numpy() & 1 > 0

    assert to_the_right(beyond, flat).sum() < 0.05 * to_the_right(usual, flat).sum()
    assert to_the_right(beyond, edge)[:, WIDTH // 2 - 1].all()


def test_photographs_without_noise_leave_the_plan_as_it_is() -> None:
    assert ContrastPlan().beyond(0.0) == ContrastPlan()


def test_images_of_another_size_are_refused() -> None:
    scene = Scene()
    hinge = ContrastHinge(scene.rasterizer, ContrastPlan())
    small = wp.zeros((4, 4, 3), dtype=wp.uint8)
    pairs = hinge.pairs(small)
    scene = Scene()
    with pytest.raises(ValueError, match="differ"):
        ContrastHinge(scene.rasterizer, ContrastPlan()).add_gradient(scene.frame, small, pairs)
