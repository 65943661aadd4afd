"""An independent oracle: elliptical weighted average splatting in float64 numpy, every pixel against every Gaussian."""

from __future__ import annotations

from math import factorial

import numpy as np
from numpy.typing import NDArray

from cvdgs.core.capture.model import PinholeCamera
from cvdgs.core.splats.gaussians import Gaussians

DILATION = 0.3
ALPHA_MIN = 1.0 / 255.0
ALPHA_MAX = 0.999
FIELD_MARGIN = 0.3


def rotation_matrices(quaternions: NDArray) -> NDArray[np.float64]:
    """(N, 3, 3) of (N, 4) wxyz."""
    w, x, y, z = (quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)).astype(np.float64).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def render(
    gaussians: Gaussians,
    colors: NDArray,
    camera: PinholeCamera,
    world_to_camera: NDArray,
    background: tuple[float, float, float] = (0.0, 0.0, 0.0),
    dilation: float = DILATION,
) -> NDArray[np.float64]:
    """(H, W, 3) image in the space of `colors`, blended front to back by the depth of the centres.

    Args:
        world_to_camera: (4, 4), OpenCV axes.
    """
    rotation, translation = world_to_camera[:3, :3], world_to_camera[:3, 3]
    centers = gaussians.means.astype(np.float64) @ rotation.T + translation
    order = np.argsort(centers[:, 2])
    order = order[centers[order, 2] > 0.01]
    x, y, z = centers[order].T
    slope_x = _slopes(x / z, camera.width, camera.fx, camera.cx)
    slope_y = _slopes(y / z, camera.height, camera.fy, camera.cy)
    jacobian = np.zeros((len(order), 2, 3))
    jacobian[:, 0, 0] = camera.fx / z
    jacobian[:, 0, 2] = -camera.fx * slope_x / z
    jacobian[:, 1, 1] = camera.fy / z
    jacobian[:, 1, 2] = -camera.fy * slope_y / z
    axes = (
        rotation_matrices(gaussians.quaternions[order])
        * np.exp(gaussians.log_scales[order].astype(np.float64))[:, None]
    )
    projected = jacobian @ rotation @ axes
    covariance = projected @ projected.transpose(0, 2, 1) + dilation * np.eye(2)
    precision = np.linalg.inv(covariance)
    means = np.stack([camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy], axis=1)
    opacities = gaussians.opacities[order].astype(np.float64)

    columns, rows = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    pixels = np.stack([columns, rows], axis=-1)
    image = np.zeros((camera.height, camera.width, 3))
    transmittance = np.ones((camera.height, camera.width))
    for i in range(len(order)):
        offset = pixels - means[i]
        power = -0.5 * np.einsum("hwi,ij,hwj->hw", offset, precision[i], offset)
        alpha = np.minimum(opacities[i] * np.exp(power), ALPHA_MAX)
        alpha[alpha < ALPHA_MIN] = 0.0
        image += (transmittance * alpha)[..., None] * colors[order[i]]
        transmittance *= 1.0 - alpha
    return image + transmittance[..., None] * np.asarray(background)


def _slopes(slopes: NDArray, size: int, focal: float, principal: float) -> NDArray:
    """Slopes at which the perspective is linearised: within the image and a margin around it."""
    margin = FIELD_MARGIN * 0.5 * size
    return np.clip(slopes, (-principal - margin) / focal, (size - principal + margin) / focal)


def harmonics(directions: NDArray, degree: int) -> NDArray[np.float64]:
    """(N, (degree + 1)^2) real spherical harmonics of (N, 3) unit vectors, from Legendre polynomials by definition."""
    x, y, z = directions.T
    azimuth = np.arctan2(y, x)
    columns = []
    for band in range(degree + 1):
        legendre = np.polynomial.Legendre.basis(band)
        for order in range(-band, band + 1):
            k = abs(order)
            derivative = legendre.deriv(k)(z) if k else legendre(z)
            associated = (-1) ** k * (1.0 - z * z) ** (k / 2.0) * derivative
            norm = np.sqrt((2 * band + 1) / (4 * np.pi) * factorial(band - k) / factorial(band + k))
            turn = np.sin(k * azimuth) if order < 0 else np.cos(k * azimuth)
            columns.append(np.sqrt(2.0 if order else 1.0) * norm * associated * turn)
    return np.stack(columns, axis=1)


def seen_colors(gaussians: Gaussians, eye: NDArray) -> NDArray[np.float64]:
    """(N, 3) colours as seen from `eye`."""
    rays = gaussians.means - eye
    basis = harmonics(rays / np.linalg.norm(rays, axis=1, keepdims=True), gaussians.sh_degree)
    return np.maximum(0.5 + np.einsum("nk,nkc->nc", basis, gaussians.sh), 0.0)


def psnr(a: NDArray, b: NDArray) -> float:
    """Peak signal-to-noise ratio in dB of images in [0, 1]."""
    return float(-10.0 * np.log10(np.mean((np.asarray(a, np.float64) - b) ** 2) + 1e-20))
