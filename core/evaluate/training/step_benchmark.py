"""Times the training step of the rasteriser stage by stage on a synthetic scene."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import warp as wp

from ...splats.gaussians import Gaussians
from ...splats.raster import Adam, LearningRates, ParameterSet, RasterCamera, Rasterizer, load

STAGES = ("render", "loss", "backward", "adam")
_NO_MOVE = LearningRates()  # every repetition sees the same scene


@dataclass(frozen=True)
class StageTimes:
    """Medians over the repetitions, in milliseconds.

    Attributes:
        wall: time that passed.
        process: processor time of this process, all threads together: what to compare on a shared machine.
        fastest: the shortest time that passed.
    """

    wall: float
    process: float
    fastest: float


@dataclass(frozen=True)
class StepTimes:
    """What a step costs.

    Attributes:
        stages: by the names of `STAGES`, and "step" for all of them together.
        gaussians: N.
        intersections: of Gaussians with tiles.
        width, height: of the image, pixels.
        device: where it ran.
        threads: on the CPU.
    """

    stages: dict[str, StageTimes]
    gaussians: int
    intersections: int
    width: int
    height: int
    device: str
    threads: int | None


def random_gaussians(count: int, width: int, height: int, *, sh_degree: int = 0, seed: int = 0) -> Gaussians:
    """Gaussians over the field of view of `benchmark_camera`, about as large on the screen as they are apart.

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
    target: np.ndarray,
    *,
    device: str = "cpu",
    threads: int | None = None,
    repetitions: int = 50,
    warm_up: int = 3,
) -> StepTimes:
    """Times render, loss, backward and Adam; parameters stay as they are.

    Args:
        target: (H, W, 3) uint8 or float32 photograph.
    """
    load(device)
    rasterizer = Rasterizer(device, threads)
    params = ParameterSet.from_gaussians(gaussians, device)
    optimizer = Adam(params)
    photograph = wp.array(target, dtype=wp.uint8 if target.dtype == np.uint8 else wp.float32, device=device)
    wait: Callable[[], None] = wp.synchronize if rasterizer.device.is_cuda else (lambda: None)
    walls, processes = [], []
    frame = rasterizer.render(params, camera)
    for _ in range(warm_up + repetitions):
        wall, process = [time.perf_counter()], [time.process_time()]

        def mark(wall: list[float] = wall, process: list[float] = process) -> None:
            wait()
            wall.append(time.perf_counter())
            process.append(time.process_time())

        frame = rasterizer.render(params, camera)
        mark()
        rasterizer.photometric_loss(frame, photograph)
        mark()
        gradients = rasterizer.backward(frame)
        mark()
        optimizer.step(rasterizer, params, gradients, _NO_MOVE)
        mark()
        walls.append([*np.diff(wall), wall[-1] - wall[0]])
        processes.append([*np.diff(process), process[-1] - process[0]])
    wall_ms, process_ms = (1e3 * np.array(times[warm_up:]) for times in (walls, processes))
    stages = {
        name: StageTimes(
            wall=float(np.median(wall_ms[:, i])),
            process=float(np.median(process_ms[:, i])),
            fastest=float(wall_ms[:, i].min()),
        )
        for i, name in enumerate((*STAGES, "step"))
    }
    return StepTimes(
        stages=stages,
        gaussians=len(gaussians),
        intersections=frame.intersections,
        width=camera.width,
        height=camera.height,
        device=str(rasterizer.device),
        threads=getattr(rasterizer.runner, "threads", None),
    )


def benchmark_random_step(
    count: int,
    width: int,
    height: int,
    *,
    sh_degree: int = 0,
    device: str = "cpu",
    threads: int | None = None,
    repetitions: int = 50,
) -> StepTimes:
    """`benchmark_step` on `random_gaussians` and a photograph of noise."""
    target = np.random.default_rng(1).integers(0, 256, (height, width, 3), np.uint8)
    return benchmark_step(
        random_gaussians(count, width, height, sh_degree=sh_degree),
        benchmark_camera(width, height),
        target,
        device=device,
        threads=threads,
        repetitions=repetitions,
    )
