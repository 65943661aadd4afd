"""Times the training step of the rasteriser, stage by stage."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import warp as wp

from ..gaussians import Gaussians
from . import Adam, LearningRates, ParameterSet, RasterCamera, Rasterizer, load

STAGES = ("render", "loss", "backward", "adam")
_FROZEN = LearningRates()  # every repetition sees the same scene


@dataclass(frozen=True)
class StageTimes:
    """Wall time of a stage over the repetitions, in milliseconds.

    Attributes:
        wall: median.
        fastest: minimum.
    """

    wall: float
    fastest: float


@dataclass(frozen=True)
class StepTimes:
    """Cost of a training step.

    Attributes:
        stages: by the names of `STAGES`, and "step" for all of them together.
        gaussians: N.
        intersections: of Gaussians with tiles.
    """

    stages: dict[str, StageTimes]
    gaussians: int
    intersections: int


def random_gaussians(count: int, width: int, height: int, *, sh_degree: int = 0, seed: int = 0) -> Gaussians:
    """Gaussians over the field of view of `benchmark_camera`, about as large on screen as their spacing.

    Depths lie between 2 and 8, opacities around one half, shapes are anisotropic by factors of about two.
    """
    rng = np.random.default_rng(seed)
    camera = benchmark_camera(width, height)
    depth = rng.uniform(2.0, 8.0, count)
    u, v = rng.uniform(-0.05, 1.05, (2, count))
    x = (u * width - camera.cx) / camera.fx * depth
    y = (v * height - camera.cy) / camera.fy * depth
    deviation = np.sqrt(width * height / max(count, 1)) * 4.0 / camera.fx
    return Gaussians(
        means=np.stack([x, y, depth], 1).astype(np.float32),
        log_scales=(np.log(deviation) + 0.6 * rng.normal(size=(count, 3))).astype(np.float32),
        quaternions=rng.normal(size=(count, 4)).astype(np.float32),
        opacity_logits=(1.5 * rng.normal(size=count)).astype(np.float32),
        sh=rng.normal(size=(count, (sh_degree + 1) ** 2, 3)).astype(np.float32),
    )


def benchmark_camera(width: int, height: int) -> RasterCamera:
    """At the origin, looking along z, about 58 degrees wide."""
    return RasterCamera(width, height, 0.9 * width, 0.9 * width, width / 2, height / 2, np.eye(4))


def benchmark_step(
    gaussians: Gaussians,
    camera: RasterCamera,
    target: np.ndarray | None = None,
    *,
    device: str = "cpu",
    threads: int | None = None,
    repetitions: int = 50,
    warm_up: int = 3,
) -> StepTimes:
    """Time render, loss, backward and Adam; the parameters do not change.

    Args:
        target: (H, W, 3) uint8 or float32 photograph; noise if None.
    """
    load(device)
    if target is None:
        target = np.random.default_rng(1).integers(0, 256, (camera.height, camera.width, 3), np.uint8)
    rasterizer = Rasterizer(device, threads)
    params = ParameterSet.from_gaussians(gaussians, device)
    optimizer = Adam(params)
    photograph = wp.array(target, dtype=wp.uint8 if target.dtype == np.uint8 else wp.float32, device=device)
    wait: Callable[[], None] = wp.synchronize if rasterizer.device.is_cuda else (lambda: None)

    def step() -> Iterator[None]:
        frame = rasterizer.render(params, camera)
        yield
        rasterizer.photometric_loss(frame, photograph)
        yield
        gradients = rasterizer.backward(frame)
        yield
        optimizer.step(rasterizer, params, gradients, _FROZEN)
        yield

    walls = []
    for _ in range(warm_up + repetitions):
        times = [time.perf_counter()]
        for _ in step():
            wait()
            times.append(time.perf_counter())
        walls.append([*np.diff(times), times[-1] - times[0]])
    measured = 1e3 * np.array(walls[warm_up:])
    stages = {
        name: StageTimes(float(np.median(column)), float(column.min()))
        for name, column in zip((*STAGES, "step"), measured.T, strict=True)
    }
    return StepTimes(stages, len(gaussians), rasterizer.render(params, camera).intersections)
