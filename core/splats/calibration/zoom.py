"""The effect of the focal length on the images of a scene, and the motion of the scene that best compensates it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
import warp as wp
from numpy.typing import NDArray
from torch.nn import functional

from ..raster import Gradients, ParameterSet, RasterCamera
from .poses import product_sums


@dataclass(frozen=True)
class AffineMotion:
    """A small motion of a scene, per unit of log focal length: x moves by ``linear @ x + offset``.

    Attributes:
        linear: (3, 3).
        offset: (3,).
        residual: share of the change of the images that the motion cannot compensate (ratio of RMS motions in the
            images): 0 if views cannot tell focal lengths apart, 1 if nothing can be compensated.
    """

    linear: NDArray[np.float64]
    offset: NDArray[np.float64]
    residual: float

    @property
    def growth(self) -> float:
        """Relative growth of a length, averaged over the directions."""
        return float(np.trace(self.linear)) / 3.0

    def apply(self, parameters: ParameterSet, amount: float) -> None:
        """Move the Gaussians by `amount`; each is scaled isotropically."""
        means = wp.to_torch(parameters.means, requires_grad=False)
        linear, offset = (means.new_tensor(amount * value) for value in (self.linear, self.offset))
        means += means @ linear.T + offset
        wp.to_torch(parameters.log_scales, requires_grad=False).add_(amount * self.growth)

    def slope(self, parameters: ParameterSet, gradients: Gradients) -> float:
        """Derivative of the loss along the motion."""
        size = float(product_sums(None, gradients.log_scales).sum())
        return _slope_of_means(self.linear, self.offset, parameters, gradients) + self.growth * size


def compensating_motion(means: NDArray[np.float64], cameras: Sequence[RasterCamera]) -> AffineMotion:
    """The motion of a scene that best compensates, in the least squares sense, growing focal lengths of all cameras.

    Args:
        means: (N, 3) points that represent the scene.
        cameras: whose images are compared; a point counts in those that show it.
    """
    # Unknowns: the nine of the linear part, row by row, and the offset; in units of the image at depth one.
    normal, right, whole = np.zeros((12, 12)), np.zeros(12), 0.0
    for camera in cameras:
        rotation, translation = camera.world_to_camera[:3, :3], camera.world_to_camera[:3, 3]
        local = means @ rotation.T + translation
        local, places = _shown(local, means, camera)
        depth = local[:, 2:]
        image = local[:, :2] / depth  # its motion as the focal length grows
        toward = (rotation[None, :2] - image[..., None] * rotation[2]) / depth[..., None]  # (M, 2, 3), per motion
        rows = np.concatenate([toward[..., None] * places[:, None, None, :], toward[..., None]], axis=-1)
        rows = np.concatenate([rows[..., :3].reshape(-1, 9), rows[..., 3].reshape(-1, 3)], axis=1)
        normal += rows.T @ rows
        right -= rows.T @ image.ravel()
        whole += float((image**2).sum())
    if not whole:
        return AffineMotion(np.zeros((3, 3)), np.zeros(3), 1.0)
    solved = np.linalg.lstsq(normal, right, rcond=1e-6)[0]
    left = float(whole - 2.0 * solved @ right + solved @ normal @ solved)
    return AffineMotion(solved[:9].reshape(3, 3), solved[9:], math.sqrt(max(left, 0.0) / whole))


def zoom_slope(parameters: ParameterSet, gradients: Gradients, camera: RasterCamera) -> float:
    """Derivative of the loss with respect to the logarithm of the camera's focal length, given a backward pass.

    A longer lens is equivalent to a scene stretched across the viewing direction, away from the camera. The Gaussians'
    axes are stretched by their components across it; their rotation, a small term, is neglected.
    """
    forward = camera.world_to_camera[2, :3]
    across = np.eye(3) - np.outer(forward, forward)
    moved = _slope_of_means(across, -across @ camera.center, parameters, gradients)
    along = _in_axes(wp.to_torch(parameters.quaternions, requires_grad=False), forward)
    grown = wp.to_torch(gradients.log_scales, requires_grad=False) * (1.0 - along**2)
    return moved + float(grown.sum())


def _slope_of_means(
    linear: NDArray[np.float64], offset: NDArray[np.float64], parameters: ParameterSet, gradients: Gradients
) -> float:
    """Derivative of the loss as means x move by ``linear @ x + offset``, with `linear` (3, 3) and `offset` (3,)."""
    products = product_sums(parameters.means, gradients.means)
    force = product_sums(None, gradients.means)[0]
    return float((products * linear.T).sum() + force @ offset)


def _in_axes(quaternions: torch.Tensor, direction: NDArray[np.float64]) -> torch.Tensor:
    """(N, 3) components of a (3,) unit vector along the axes of Gaussians with (N, 4) wxyz quaternions."""
    real, imaginary = functional.normalize(quaternions).split((1, 3), dim=1)
    vector = quaternions.new_tensor(direction).expand_as(imaginary)
    turned = torch.linalg.cross(imaginary, vector)
    return vector - 2.0 * (real * turned - torch.linalg.cross(imaginary, turned))


def _shown(
    local: NDArray[np.float64], places: NDArray[np.float64], camera: RasterCamera
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The rows of `local` (N, 3), points in camera axes, that lie in the image, and those of `places` (N, 3)."""
    depth = np.where(local[:, 2] > camera.near, local[:, 2], np.inf)
    x, y = camera.fx * local[:, 0] / depth + camera.cx, camera.fy * local[:, 1] / depth + camera.cy
    inside = np.isfinite(depth) & (x > 0.0) & (x < camera.width) & (y > 0.0) & (y < camera.height)
    return local[inside], places[inside]
