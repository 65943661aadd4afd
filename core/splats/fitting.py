"""Gaussians under optimisation: the parameters, their optimiser, and one step of both."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np
import warp as wp
from numpy.typing import NDArray

from .exposure import estimate_log_gains
from .gaussians import Gaussians
from .raster import Adam, Frame, Gradients, LearningRates, Loss, ParameterSet, RasterCamera, Rasterizer
from .strategy import Refinement
from .targets import Background, TrainingView

# A parameter beyond this, in frame units, comes from a step that went wrong: scenes are about one unit large.
_LARGEST_PARAMETER = 1e4
# Looking for numbers that are not finite makes a GPU wait, so there it is done every so many steps. In between the
# optimiser leaves alone what has no finite gradient.
_CHECK_EVERY_CUDA = 50


class Correction(Protocol):
    """What is corrected of a view while it is fitted; the methods are called in this order."""

    def camera(self, camera: RasterCamera) -> RasterCamera:
        """The camera to render from."""
        ...

    def before_loss(self, frame: Frame) -> None:
        """Make the rendered image what the photograph is to be compared with."""
        ...

    def after_loss(self, frame: Frame) -> None:
        """Undo that, in the image and in its gradient."""
        ...

    def after_backward(self, parameters: ParameterSet, gradients: Gradients, camera: RasterCamera) -> None:
        """Move the corrections, before the optimiser moves the Gaussians."""
        ...


class Fit:
    """The state of a fit.

    Args:
        rasterizer: does the arithmetic.
        gaussians: to start from, in frame units.
        background: what is behind them.
        ssim_weight: λ of (1 - λ) L1 + λ (1 - SSIM).

    Attributes:
        parameters: as they are now.
        work: intersections of Gaussians with tiles in all steps so far; what time goes with.
        skipped: steps that were left out, in whole or for some Gaussians, because a number was not finite.
    """

    def __init__(
        self, rasterizer: Rasterizer, gaussians: Gaussians, background: Background, ssim_weight: float
    ) -> None:
        self._rasterizer = rasterizer
        self._background = background
        self._ssim_weight = ssim_weight
        self._steps = 0
        self.work = 0
        self.skipped = 0
        self.restart(gaussians)

    def __len__(self) -> int:
        return len(self.parameters)

    @property
    def state(self) -> tuple[ParameterSet, Adam]:
        """The parameters and their optimiser, to come back to after a `restart`, which makes others."""
        return self.parameters, self._adam

    @state.setter
    def state(self, state: tuple[ParameterSet, Adam]) -> None:
        self.parameters, self._adam = state
        self._clear_gradients()

    def restart(self, gaussians: Gaussians) -> None:
        """Go on from these Gaussians, with an optimiser that knows nothing."""
        self.parameters = ParameterSet.from_gaussians(gaussians, self._rasterizer.device)
        self._adam = Adam(self.parameters)
        self._clear_gradients()

    def step(
        self,
        view: TrainingView,
        reduction: int,
        rates: LearningRates,
        *,
        gather_gradient: bool = False,
        colors_only: bool = False,
        correction: Correction | None = None,
        loss: Callable[[Frame, wp.array], Loss] | None = None,
    ) -> None:
        """Render a view, measure the loss, go backward, move the parameters.

        A loss that is not finite ends the step there, and what is broken is removed; a Gaussian whose gradient is not
        finite is left alone by the optimiser. Either counts as skipped.

        Args:
            reduction: level of the view.
            gather_gradient: add the screen-space gradients to those for `mean_gradient`.
            colors_only: move the colours of degree 0 alone.
            correction: of the view, which moves along.
            loss: of the frame against the photograph, which fills `frame.grad_color`; None takes the photometric loss.
        """
        self._steps += 1
        image, camera = view.at(reduction)
        if correction is not None:
            camera = correction.camera(camera)
        frame = self._rasterizer.render(self.parameters, camera, self._background.color)
        self.work += frame.intersections
        if correction is not None:
            correction.before_loss(frame)
        measured = (loss or self._photometric_loss)(frame, image)
        check = not self._rasterizer.device.is_cuda or self._steps % _CHECK_EVERY_CUDA == 0
        if check and not math.isfinite(measured.total):
            self.skipped += 1
            if not colors_only:  # then the Gaussians are given
                self._remove_broken()
            return
        if correction is not None:
            correction.after_loss(frame)
        gradients = self._rasterizer.backward(frame, colors_only=colors_only, absolute=gather_gradient)
        if correction is not None:
            correction.after_backward(self.parameters, gradients, camera)
        self._adam.step(self._rasterizer, self.parameters, gradients, rates)
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
        """(N,) mean of the gathered screen-space gradient norms, over the steps that drew the Gaussian."""
        return self._gradient / np.maximum(self._observed, 1).astype(np.float32)

    def apply(self, refined: Refinement) -> None:
        """Go on with the Gaussians of a refinement; what is not fresh keeps its place in the optimiser."""
        self.parameters = ParameterSet.from_gaussians(refined.gaussians, self._rasterizer.device)
        self._adam.select(refined.source, refined.fresh)
        self._clear_gradients()

    def put(self, gaussians: Gaussians) -> None:
        """Other values for the same Gaussians."""
        for name, value in vars(gaussians).items():
            getattr(self.parameters, name).assign(value)

    def keep(self, kept: NDArray[np.bool_]) -> None:
        """Remove all Gaussians but `kept` (N,)."""
        if kept.all() or not kept.any():
            return
        index = np.flatnonzero(kept)
        chosen = self.parameters.to_gaussians().take(index)
        self.apply(Refinement(chosen, index, np.zeros(len(index), bool)))

    def psnr(self, views: Sequence[TrainingView], *, any_exposure: bool = False) -> float:
        """Mean PSNR over the views at full resolution, dB.

        Args:
            any_exposure: give each rendering the three gains first that take it to its photograph's exposure.
        """
        return float(np.mean([self._psnr(view, any_exposure) for view in views]))

    def _psnr(self, view: TrainingView, any_exposure: bool) -> float:
        image, camera = view.at(1)
        color = np.nan_to_num(self._rasterizer.render(self.parameters, camera, self._background.color).color.numpy())
        photograph = image.numpy().astype(np.float32) / 255.0
        if any_exposure:
            color = color * np.exp(estimate_log_gains(color, photograph)).astype(np.float32)
        error = (np.clip(color, 0.0, 1.0) - photograph) ** 2
        return float(-10.0 * np.log10(max(error.mean(), 1e-12)))

    def _photometric_loss(self, frame: Frame, image: wp.array) -> Loss:
        return self._rasterizer.photometric_loss(frame, image, self._ssim_weight)

    def _clear_gradients(self) -> None:
        self._gradient = np.zeros(len(self), np.float32)
        self._observed = np.zeros(len(self), np.int32)

    def _remove_broken(self) -> None:
        arrays = self.parameters.numpy().values()
        # NaN compares false.
        sound = [(np.abs(array) < _LARGEST_PARAMETER).reshape(len(self), -1).all(axis=1) for array in arrays]
        self.keep(np.logical_and.reduce(sound))
