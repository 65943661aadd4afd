"""gsplat as a peer on CUDA, if it is installed: its training step, and trainings by its own strategies."""

from __future__ import annotations

import importlib
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ....core.capture.model import Capture, PinholeCamera
from ....core.errors import InputError
from ....core.evaluate.evaluation import Split
from ....core.splats.gaussians import SH_C0, Gaussians
from ....core.splats.raster import RasterCamera, Rasterizer
from ....core.splats.renderer import SceneRenderer
from ....core.splats.targets import Background, ViewOrder
from .runs import TrainedRun, held_out_psnr

DEFAULT, MCMC = "default", "mcmc"
AT_MOST = ", at most "
_SH_DEGREE = 3
_STEPS_A_DEGREE = 1000
_SSIM_WEIGHT = 0.2
_SCENE_SCALE = 1.1  # of the cameras' largest distance from their mean
_REGULARISED = 0.01  # MCMC's weights of the opacities and of the scales in the loss
# Learning rates of its example trainer; that of the means is times the scene's scale and ends at a hundredth.
_RATES = {"means": 1.6e-4, "scales": 5e-3, "opacities": 5e-2, "quats": 1e-3, "sh0": 2.5e-3, "shN": 2.5e-3 / 20}


@dataclass(frozen=True)
class GsplatRun:
    """A training by gsplat with the settings of its example trainer, its schedule shortened to its steps.

    Attributes:
        strategy: `DEFAULT`, which clones, splits and prunes until half of the steps, or `MCMC`, which relocates until
            five sixths of them.
        steps: of the training.
        most: Gaussians of `MCMC`.
    """

    strategy: str
    steps: int
    most: int = 0

    @property
    def label(self) -> str:
        return f"gsplat, {self.strategy}" + (f"{AT_MOST}{self.most:,}" if self.most else "")


class Gsplat:
    """The installed gsplat, and the fused SSIM that its example trainer uses.

    Raises:
        InputError: one of them is missing.
    """

    def __init__(self) -> None:
        try:
            self._library: Any = importlib.import_module("gsplat")
            self._ssim: Any = importlib.import_module("fused_ssim").fused_ssim
        except ImportError as error:
            reason = f"cannot be imported ({error})"
            raise InputError(reason, where=error.name or "gsplat", remedy="install gsplat and fused-ssim") from None

    @property
    def version(self) -> str:
        return str(self._library.__version__)

    def training_step(
        self, gaussians: Gaussians, camera: RasterCamera, photograph: NDArray[np.uint8]
    ) -> Callable[[], Iterator[None]]:
        """A training step in the stages of `raster.benchmark.STAGES`, to be run as often as one likes."""
        params = _parameters(gaussians)
        optimizers = _optimizers(params, dict.fromkeys(_RATES, 0.0))
        target = torch.from_numpy(photograph).cuda()
        shot = _Shot.of(camera, camera.world_to_camera, Background((0.0, 0.0, 0.0)))

        def step() -> Iterator[None]:
            image, _ = self._render(params, shot, gaussians.sh_degree)
            yield
            loss = self._loss(image, target)
            yield
            loss.backward()
            yield
            _update(optimizers)
            yield

        return step

    def train(self, capture: Capture, run: GsplatRun, *, seed: int = 0, measured: int = 8) -> TrainedRun:
        """Train on all views except every eighth, as `train_once`; its scenes are rendered by our rasteriser.

        Args:
            measured: how many times the held-out views are measured; the clock stands still meanwhile.
        """
        torch.manual_seed(seed)
        views, split = capture.views, Split.every(len(capture.views))
        background = Background.of(views)
        shots = [_Shot.of(views[i].camera, views[i].world_to_camera, background) for i in split.train]
        targets = [torch.from_numpy(background.behind(views[i])).cuda() for i in split.train]
        centers = np.stack([views[i].center for i in split.train])
        scale = _SCENE_SCALE * float(np.linalg.norm(centers - centers.mean(axis=0), axis=1).max())
        params = _parameters(_start(capture, run.strategy))
        optimizers = _optimizers(params, _RATES | {"means": _RATES["means"] * scale})
        schedule = torch.optim.lr_scheduler.ExponentialLR(optimizers["means"], 0.01 ** (1.0 / run.steps))
        strategy = self._strategy(run)
        strategy.check_sanity(params, optimizers)
        is_default = run.strategy == DEFAULT
        state = strategy.initialize_state(scene_scale=scale) if is_default else strategy.initialize_state()
        order, curve = ViewOrder(len(shots), np.random.default_rng(seed)), []
        drawn = SceneRenderer(Rasterizer("cuda"), views, background)
        clock = _Clock()
        for step in range(run.steps):
            view, degree = order.next(), min(step // _STEPS_A_DEGREE, _SH_DEGREE)
            image, info = self._render(params, shots[view], degree)
            strategy.step_pre_backward(params, optimizers, state, step, info)
            loss = self._loss(image, targets[view])
            if not is_default:
                loss = loss + _REGULARISED * torch.sigmoid(params["opacities"]).mean()
                loss = loss + _REGULARISED * torch.exp(params["scales"]).mean()
            loss.backward()
            _update(optimizers)
            schedule.step()
            if is_default:
                strategy.step_post_backward(params, optimizers, state, step, info, packed=False)
            else:
                rate = schedule.get_last_lr()[0]
                strategy.step_post_backward(params, optimizers, state, step, info, lr=rate)
            if (step + 1) % max(run.steps // measured, 1) == 0 or step + 1 == run.steps:
                clock.stop()
                curve.append((clock.seconds, held_out_psnr(drawn, _gaussians(params), split.test)))
                clock.go_on()
        clock.stop()
        return TrainedRun(
            capture=capture.source.name,
            label=run.label,
            seed=seed,
            steps=run.steps,
            gaussians=len(params["means"]),
            sh_degree=_SH_DEGREE,
            psnr=curve[-1][1],
            seconds=clock.seconds,
            processor_seconds=math.nan,
            decision="",
            curve=tuple(curve),
        )

    def _strategy(self, run: GsplatRun) -> Any:
        if run.strategy == DEFAULT:
            return self._library.DefaultStrategy(refine_stop_iter=run.steps // 2, verbose=False)
        return self._library.MCMCStrategy(cap_max=run.most, refine_stop_iter=run.steps * 5 // 6, verbose=False)

    def _render(self, params: Any, shot: _Shot, sh_degree: int) -> tuple[torch.Tensor, dict[str, Any]]:
        images, _, info = self._library.rasterization(
            means=params["means"],
            quats=params["quats"],
            scales=torch.exp(params["scales"]),
            opacities=torch.sigmoid(params["opacities"]),
            colors=torch.cat([params["sh0"], params["shN"]], 1),
            viewmats=shot.pose,
            Ks=shot.intrinsics,
            width=shot.width,
            height=shot.height,
            backgrounds=shot.background,
            sh_degree=sh_degree,
            packed=False,
        )
        return images[0], info

    def _loss(self, image: torch.Tensor, photograph: torch.Tensor) -> torch.Tensor:
        target = photograph.float() / 255.0
        difference = (image - target).abs().mean()
        planes = (picture.permute(2, 0, 1)[None] for picture in (image, target))
        return torch.lerp(difference, 1.0 - self._ssim(*planes, padding="valid"), _SSIM_WEIGHT)


@dataclass(frozen=True)
class _Shot:
    """A camera as gsplat takes it, on the card."""

    pose: torch.Tensor
    intrinsics: torch.Tensor
    background: torch.Tensor
    width: int
    height: int

    @classmethod
    def of(cls, camera: RasterCamera | PinholeCamera, pose: NDArray[np.float64], background: Background) -> _Shot:
        """A camera in a (4, 4) world-to-camera pose."""
        intrinsics = [[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]]
        arrays = (np.array(x, np.float32)[None] for x in (pose, intrinsics, background.color))
        pose_there, intrinsics_there, background_there = (torch.from_numpy(x).cuda() for x in arrays)
        return cls(pose_there, intrinsics_there, background_there, camera.width, camera.height)


class _Clock:
    """Seconds of the card's and the processor's work, without those in which it stands still."""

    def __init__(self) -> None:
        self.seconds = 0.0
        self.go_on()

    def go_on(self) -> None:
        torch.cuda.synchronize()
        self._since = time.perf_counter()

    def stop(self) -> None:
        torch.cuda.synchronize()
        self.seconds += time.perf_counter() - self._since
        self._since = time.perf_counter()


def _start(capture: Capture, strategy: str) -> Gaussians:
    """A Gaussian for each sparse point, as large as its three nearest are far."""
    points, count = capture.points, len(capture.points)
    apart = KDTree(points).query(points, 4)[0][:, 1:]
    deviation = np.sqrt(np.maximum((apart**2).mean(axis=1), 1e-14))
    opacity, size = (0.1, 1.0) if strategy == DEFAULT else (0.5, 0.1)
    sh = np.zeros((count, (_SH_DEGREE + 1) ** 2, 3), np.float32)
    sh[:, 0] = (capture.point_colors / 255.0 - 0.5) / SH_C0
    return Gaussians(
        means=points.astype(np.float32),
        log_scales=np.repeat(np.log(size * deviation)[:, None], 3, axis=1).astype(np.float32),
        quaternions=np.random.default_rng(0).uniform(size=(count, 4)).astype(np.float32),
        opacity_logits=np.full(count, math.log(opacity / (1.0 - opacity)), np.float32),
        sh=sh,
    )


def _parameters(gaussians: Gaussians) -> Any:
    arrays = {
        "means": gaussians.means,
        "scales": gaussians.log_scales,
        "quats": gaussians.quaternions,
        "opacities": gaussians.opacity_logits,
        "sh0": gaussians.sh[:, :1],
        "shN": gaussians.sh[:, 1:],
    }
    tensors = {name: torch.from_numpy(np.ascontiguousarray(value)).cuda() for name, value in arrays.items()}
    return torch.nn.ParameterDict({name: torch.nn.Parameter(value) for name, value in tensors.items()})


def _optimizers(params: Any, rates: dict[str, float]) -> dict[str, torch.optim.Optimizer]:
    return {name: torch.optim.Adam([params[name]], lr=rate, eps=1e-15, fused=True) for name, rate in rates.items()}


def _update(optimizers: dict[str, torch.optim.Optimizer]) -> None:
    for optimizer in optimizers.values():
        optimizer.step()
        optimizer.zero_grad(set_to_none=True)


def _gaussians(params: Any) -> Gaussians:
    arrays = {name: value.detach().cpu().numpy().copy() for name, value in params.items()}
    return Gaussians(
        means=arrays["means"],
        log_scales=arrays["scales"],
        quaternions=arrays["quats"],
        opacity_logits=arrays["opacities"],
        sh=np.concatenate([arrays["sh0"], arrays["shN"]], axis=1),
    )
