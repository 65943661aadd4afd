"""Gaussians being fitted: the parameters, their optimiser and a training step, and a whole fit with a guided loss."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import torch
import warp as wp
from numpy.typing import NDArray

from ...capture.model import View
from ...color.metrics import ccpr
from ...files.states import SavedState, State
from ..calibration.corrections import Correction, KnownBlur
from ..calibration.exposure import estimate_log_gains
from ..calibration.motion_blur import best_line, smeared_array
from ..gaussians import Gaussians
from ..raster import Adam, Frame, LearningRates, Loss, Mask, ParameterSet, Rasterizer
from ..scene_frame import SceneFrame
from ..strategy import Refinement
from ..targets import Background, TrainingView, ViewOrder, prepare_targets
from .dropout import with_dropout
from .losses import GuidedLoss

# A larger parameter, in frame units, is the result of a bad step: scenes are about one unit large.
_LARGEST_PARAMETER = 1e4
# Steps between checks for non-finite numbers on a GPU, which has to wait for them. In between the optimiser skips
# Gaussians without a finite gradient.
_CHECK_EVERY_CUDA = 50
# What a saved state is believed at most: Gaussians, spherical harmonics of degree 3, and counts.
_MOST_GAUSSIANS, _MOST_SH, _MOST_COUNTED = 2**31 - 1, 16, 2**62
_NO_CORRECTION = Correction()


class Fit:
    """The Gaussians being fitted and the state of their optimiser.

    Args:
        rasterizer: renders the views.
        gaussians: initial ones, in frame units.
        background: behind the Gaussians.
        ssim_weight: λ of the photometric loss (1 - λ) L1 + λ (1 - SSIM).
        noise: standard deviation of the photographs' noise, in [0, 1].
        dropout: share of the Gaussians that is left out of each step.

    Attributes:
        parameters: the current Gaussians.
        noise, dropout: as given.
        work: tile intersections so far, a hardware-independent cost proxy.
        skipped: steps skipped, entirely or for some Gaussians, because of non-finite numbers.
    """

    def __init__(
        self,
        rasterizer: Rasterizer,
        gaussians: Gaussians,
        background: Background,
        ssim_weight: float,
        noise: float = 0.0,
        dropout: float = 0.0,
    ) -> None:
        self._rasterizer = rasterizer
        self._background = background
        self._ssim_weight, self.noise, self.dropout = ssim_weight, noise, dropout
        self._steps = 0
        self.work = 0
        self.skipped = 0
        self.restart(gaussians)

    def __len__(self) -> int:
        return len(self.parameters)

    @property
    def state(self) -> tuple[ParameterSet, Adam]:
        """The parameters and their optimiser; `restart` makes new ones, so assigning the old ones undoes it."""
        return self.parameters, self._adam

    @state.setter
    def state(self, state: tuple[ParameterSet, Adam]) -> None:
        self.parameters, self._adam = state
        self._clear_gradients()

    def snapshot(self) -> State:
        """What `restore` continues from, between two steps."""
        return {
            "gaussians": len(self),
            "sh_count": self.parameters.sh_count,
            "parameters": self.parameters.numpy(),
            "adam": self._adam.snapshot(),
            "gradient": self._gradient,
            "observed": self._observed,
            "steps": self._steps,
            "work": self.work,
            "skipped": self.skipped,
        }

    def restore(self, saved: SavedState) -> None:
        """Continue from a `snapshot`; raises `InputError` where it is damaged."""
        count, sh_count = saved.number("gaussians", 0, _MOST_GAUSSIANS), saved.number("sh_count", 1, _MOST_SH)
        if math.isqrt(sh_count) ** 2 != sh_count:
            saved.refuse(f"sh_count is {sh_count}")
        device = self._rasterizer.device
        self.parameters = ParameterSet.restored(saved.part("parameters"), count, sh_count, device)
        self._adam = Adam(self.parameters)
        self._adam.restore(saved.part("adam"))
        self._gradient: NDArray[np.float32] = saved.array("gradient", np.float32, count)
        self._observed = saved.array("observed", np.int32, count)
        self._steps, self.work, self.skipped = (
            saved.number(name, 0, _MOST_COUNTED) for name in ("steps", "work", "skipped")
        )

    def restart(self, gaussians: Gaussians) -> None:
        """Continue from these Gaussians, with a new optimiser."""
        self.parameters = ParameterSet.from_gaussians(gaussians, self._rasterizer.device)
        self._adam = Adam(self.parameters)
        self._clear_gradients()

    def step(
        self,
        view: TrainingView,
        reduction: int,
        learning_rates: LearningRates,
        *,
        gather_gradient: bool = False,
        colors_only: bool = False,
        correction: Correction = _NO_CORRECTION,
        loss: Callable[[Frame, wp.array, Mask | None], Loss] | None = None,
    ) -> None:
        """A training step on one view: render, loss, backward pass, optimiser.

        A non-finite loss ends the step, and broken Gaussians are removed; the optimiser skips Gaussians whose gradient
        is not finite. Either counts as skipped.

        Args:
            reduction: factor by which the view is reduced.
            gather_gradient: add the screen-space gradients to those for `mean_gradient`.
            colors_only: fit the degree-0 colours only.
            correction: of the view, updated along with the Gaussians.
            loss: of a frame against the photograph and its mask, which fills `frame.grad_color`; None for the
                photometric one.
        """
        self._steps += 1
        image, camera = view.at(reduction)
        camera = correction.camera(camera)
        drawn = with_dropout(self.parameters, self.dropout, self._steps)
        frame = self._rasterizer.render(drawn, camera, self._background.color)
        self.work += frame.intersections
        correction.before_loss(frame)
        measured = (loss or self._photometric_loss)(frame, image, view.mask_at(reduction))
        check = not self._rasterizer.device.is_cuda or self._steps % _CHECK_EVERY_CUDA == 0
        if check and not math.isfinite(measured.total):
            self.skipped += 1
            if not colors_only:  # which leaves the number of Gaussians alone
                self._remove_broken()
            return
        correction.after_loss(frame)
        gradients = self._rasterizer.backward(frame, colors_only=colors_only, absolute=gather_gradient)
        correction.after_backward(self.parameters, gradients, camera)
        self._adam.step(self._rasterizer, self.parameters, gradients, learning_rates)
        visible = None
        if check:
            visible = frame.visible.numpy()
            moved = np.count_nonzero(gradients.touched.numpy())
            self.skipped += int(moved < np.count_nonzero(visible))
        if gather_gradient:
            self._gradient += gradients.screen_abs.numpy()
            self._observed += frame.visible.numpy() if visible is None else visible

    @property
    def mean_gradient(self) -> NDArray[np.float32]:
        """(N,) mean of the gathered screen-space gradient norms, over the steps in which the Gaussian was drawn."""
        return self._gradient / np.maximum(self._observed, 1).astype(np.float32)

    def apply(self, refined: Refinement) -> None:
        """Continue with the Gaussians of a refinement; those that are not fresh keep their optimiser state."""
        self.parameters = ParameterSet.from_gaussians(refined.gaussians, self._rasterizer.device)
        self._adam.select(refined.source, refined.fresh)
        self._clear_gradients()

    def assign(self, gaussians: Gaussians) -> None:
        """Assign new values to the same Gaussians."""
        for name, value in vars(gaussians).items():
            getattr(self.parameters, name).assign(value)

    def keep(self, kept: NDArray[np.bool_]) -> None:
        """Remove all Gaussians but `kept` (N,), unless none were left."""
        if kept.all() or not kept.any():
            return
        index = np.flatnonzero(kept)
        chosen = self.parameters.to_gaussians().take(index)
        self.apply(Refinement(chosen, index, np.zeros(len(index), bool)))

    def psnr(self, views: Sequence[TrainingView], *, any_exposure: bool = False) -> float:
        """Mean PSNR over the views at full resolution, dB; 0 if nothing of them is looked at.

        Args:
            any_exposure: compensate the exposure of each photograph first, by the three gains that fit best.
        """
        found = [psnr for view in views if not math.isnan(psnr := self._psnr(view, any_exposure))]
        return float(np.mean(found)) if found else 0.0

    def best_line(self, view: TrainingView) -> NDArray[np.float64]:
        """(2,) the line along which a rendering is most like the photograph (`best_line`), sought near a known one."""
        image, camera = view.at(1)
        known = view.smear if view.smear is not None and view.smear.any() else None
        frame = self._rasterizer.render(self.parameters, camera, self._background.color)
        photograph = image.numpy().astype(np.float32) / 255.0
        rendered = np.nan_to_num(frame.color.numpy())
        return best_line(rendered, photograph, view.looked_at(), known, self._rasterizer.device)

    def smeared(self, views: Sequence[TrainingView]) -> list[TrainingView]:
        """The views, their photographs smeared along the lines that suit the current scene best."""
        return [replace(view, smear=self.best_line(view)) for view in views]

    def contrast(self, views: Sequence[TrainingView]) -> float:
        """Mean CCPR of views at full resolution, for normal vision; 0 if no photograph has distinct neighbours."""
        found = [ratio for ratio in map(self._contrast, views) if math.isfinite(ratio)]
        return float(np.mean(found)) if found else 0.0

    def _contrast(self, view: TrainingView) -> float:
        color, photograph = (torch.from_numpy(x).permute(2, 0, 1) for x in self._pictures(view))
        shown = view.looked_at()
        return ccpr(photograph, color.clamp(0.0, 1.0), mask=None if shown is None else torch.from_numpy(shown))[0]

    def _pictures(self, view: TrainingView) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """A view as rendered, smeared like its photograph, and as photographed, (H, W, 3) each."""
        image, camera = view.at(1)
        frame = self._rasterizer.render(self.parameters, camera, self._background.color)
        color = smeared_array(np.nan_to_num(frame.color.numpy()), view.smear)
        return color, image.numpy().astype(np.float32) / 255.0

    def _psnr(self, view: TrainingView, any_exposure: bool) -> float:
        """NaN where nothing of the view is looked at."""
        color, photograph = self._pictures(view)
        shown = view.looked_at()
        if shown is not None and not shown.any():
            return math.nan
        if any_exposure:
            color = color * np.exp(estimate_log_gains(color, photograph, shown)).astype(np.float32)
        error = (np.clip(color, 0.0, 1.0) - photograph) ** 2
        error = error if shown is None else error[shown]
        return float(-10.0 * np.log10(max(error.mean(), 1e-12)))

    def _photometric_loss(self, frame: Frame, image: wp.array, mask: Mask | None) -> Loss:
        return self._rasterizer.photometric_loss(frame, image, self._ssim_weight, mask, noise=self.noise)

    def _clear_gradients(self) -> None:
        self._gradient = np.zeros(len(self), np.float32)
        self._observed = np.zeros(len(self), np.int32)

    def _remove_broken(self) -> None:
        arrays = self.parameters.numpy().values()
        # NaN compares false.
        sound = [(np.abs(array) < _LARGEST_PARAMETER).reshape(len(self), -1).all(axis=1) for array in arrays]
        self.keep(np.logical_and.reduce(sound))


def fit_guided(
    rasterizer: Rasterizer,
    gaussians: Gaussians,
    views: Sequence[View],
    background: Background,
    loss: GuidedLoss,
    learning_rates: Callable[[float], LearningRates],
    steps: int,
    seed: int,
    progress: Callable[[float], None],
    *,
    colors_only: bool = False,
    watch: Callable[[Callable[[], Gaussians]], None] | None = None,
) -> tuple[Gaussians, int]:
    """Fit `gaussians`, in world units, to `views` by a loss that is guided by the other views.

    Args:
        learning_rates: by the fraction of the steps.
        progress: receives the fraction done.
        colors_only: fit the degree-0 colours only.
        watch: receives what gives the Gaussians, in world units, as they are when it is called.

    Returns:
        The fitted Gaussians, and the number of steps skipped because of non-finite numbers.
    """
    frame = SceneFrame.around(views, gaussians.means)
    fit = Fit(rasterizer, frame.from_world(gaussians), background, loss.ssim_weight)
    targets = prepare_targets(rasterizer, views, frame, background)
    blur = KnownBlur(rasterizer.device, [view.smear for view in views])
    order = ViewOrder(len(targets), np.random.default_rng(seed))

    def current() -> Gaussians:
        return frame.to_world(fit.parameters.to_gaussians())

    if watch is not None:
        watch(current)
    for step in range(1, steps + 1):
        view = order.next()
        fit.step(
            targets[view],
            1,
            learning_rates(step / steps),
            colors_only=colors_only,
            correction=blur.of(view),
            loss=loss.of(view),
        )
        progress(step / steps)
    return current(), fit.skipped
