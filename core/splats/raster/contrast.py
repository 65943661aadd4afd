"""The contrast hinge: pulls differences of neighbouring pixels, as an observer sees them, towards those of a target.

A photometric loss settles for less contrast than its target has, and weak differences are lost first: those of a few
ΔE, in which a textile's pattern consists for somebody with a colour vision deficiency.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import warp as wp

from ...color.matrices import RGB_TO_XYZ, LinearSimulation
from ...color.noise import neighbour_difference
from .frame import Frame
from .rasterizer import Rasterizer

_DIRECTIONS = 4  # pairs of a pixel: right, below, below right, below left
_LAB_SCALE = 100.0  # L* of white, so that the loss is comparable to differences of sRGB values
_LANES = 8  # as in numeric.h
_TIMES_NOISE = 2.0  # what noise makes neighbours differ by; pairs are listed from there on


@dataclass(frozen=True)
class ContrastPlan:
    """The contrast hinge, averaged over all pairs of neighbours; differences are ΔE76.

    Attributes:
        weight: of the hinge beside the photometric loss; 0 leaves it out. From about 20 on colours ring.
        listed: a pair is listed if the photograph's difference is at least this, for normal vision.
        threshold: a listed pair counts if the target's difference is at least this, for the observer.
        cap: a rendering need not have more of the target's difference than this.
        invented: weight of differences that the target does not have, relative to `weight`; on pairs that do not count.
        floor: differences up to this are not invented.
    """

    weight: float = 6.0
    listed: float = 6.0
    threshold: float = 6.0
    cap: float = 10.0
    invented: float = 0.0
    floor: float = 2.0

    def beyond(self, noise: float) -> ContrastPlan:
        """The same for noise of this standard deviation, in [0, 1], which by itself then lists hardly a pair."""
        return replace(self, listed=max(self.listed, _TIMES_NOISE * neighbour_difference(noise)))


class ContrastHinge:
    """The contrast hinge for one observer.

    With p and q the Lab differences of a pair of neighbours in the rendering and in the target, and n = |q|, a pair
    that counts adds max(0, min(n, cap) - p·q / n) / 100.

    Args:
        rasterizer: renders the frames.
        plan: the settings.
        observer: S for which Lab is computed; None for normal vision.
    """

    def __init__(self, rasterizer: Rasterizer, plan: ContrastPlan, observer: LinearSimulation | None = None) -> None:
        self._rasterizer, self._plan = rasterizer, plan
        above = np.eye(3) if observer is None else observer.matrix
        below, plane = above, np.zeros(3)
        if observer is not None and observer.matrix_below is not None and observer.separator is not None:
            below, plane = observer.matrix_below, observer.separator
        self._observer = self._packed(above, below, plane)
        self._normal = self._packed(np.eye(3), np.eye(3), np.zeros(3))
        self._lab: dict[tuple[int, int], wp.array] = {}

    def pairs(self, photograph: wp.array) -> wp.array:
        """(H, W) uint8, which pairs of neighbours the photograph lists, as in contrast.h.

        Args:
            photograph: (H, W, 3) uint8, or float32 in [0, 1].
        """
        runner, state = self._rasterizer.runner, self._rasterizer.runner.state
        height, width = photograph.shape[:2]
        found = wp.zeros((height, width), dtype=wp.uint8, device=self._rasterizer.device)
        state.width, state.height = width, height
        self._bind(photograph, found, self._normal)
        state.contrast_targets_only = 1
        state.contrast_listed = self._plan.listed
        runner.observe()
        runner.list_pairs()
        return found

    def add_gradient(self, frame: Frame, target: wp.array, pairs: wp.array) -> None:
        """Add the gradient to `frame.grad_color`, which the photometric loss has filled.

        Args:
            frame: the rasteriser's latest.
            target: (H, W, 3) uint8, or float32 in [0, 1].
            pairs: of the photograph, from `pairs`.
        """
        runner, state, plan = self._rasterizer.runner, self._rasterizer.runner.state, self._plan
        state.width, state.height = frame.camera.width, frame.camera.height
        self._bind(target, pairs, self._observer)
        runner.bind("color", frame.color)
        runner.bind("grad_color", frame.grad_color)
        state.contrast_targets_only = 0
        state.contrast_threshold, state.contrast_cap = plan.threshold, plan.cap
        state.contrast_invented, state.contrast_floor = plan.invented, plan.floor
        state.contrast_scale = plan.weight / (_LAB_SCALE * _DIRECTIONS * frame.camera.width * frame.camera.height)
        runner.observe()
        runner.contrast()

    def _bind(self, target: wp.array, pairs: wp.array, observer: wp.array) -> None:
        runner, state = self._rasterizer.runner, self._rasterizer.runner.state
        height, width = target.shape[:2]
        if pairs.shape != (height, width) or (state.height, state.width) != (height, width):
            raise ValueError(
                f"target {target.shape}, pairs {pairs.shape} and frame {(state.height, state.width)} differ"
            )
        state.target_is_bytes = int(target.dtype == wp.uint8)
        runner.bind("target_bytes" if state.target_is_bytes else "target_floats", target)
        runner.bind("contrast_pairs", pairs)
        runner.bind("contrast_observer", observer)
        if (height, width) not in self._lab:
            size = 6 * (height * width + 2 * (width + 1 + _LANES))  # as in contrast.h
            self._lab[height, width] = wp.zeros(size, dtype=wp.float32, device=self._rasterizer.device)
        runner.bind("contrast_lab", self._lab[height, width])

    def _packed(self, above: np.ndarray, below: np.ndarray, plane: np.ndarray) -> wp.array:
        """As `contrast_observer` in contrast.h."""
        relative = RGB_TO_XYZ / RGB_TO_XYZ.sum(axis=1, keepdims=True)
        floats = np.concatenate([part.ravel() for part in (above, below, plane, relative)])
        return wp.array(floats.astype(np.float32), dtype=wp.float32, device=self._rasterizer.device)
