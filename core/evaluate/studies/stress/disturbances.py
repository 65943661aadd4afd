"""What can be wrong with photographs, cameras and points, in known amounts, for captures that are right.

Each function takes a capture and an amount and returns another capture; amount 0 (or 1 where it is a factor) changes
nothing. The generator decides directions, the amount how far: with the same generator a larger amount is the same
mistake made larger.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import shift
from scipy.spatial.transform import Rotation

from ....capture import Capture, View
from ....color.spaces import image_to_tensor, lab_to_linear, linear_to_srgb, srgb_to_lab, tensor_to_image
from ....color.srgb import decode, encode
from ....images import read_png, to_bytes, write_jpeg

Image = NDArray[np.uint8]

WHITE_ELECTRONS = 10_000.0
"""Electrons that a pixel of a small sensor holds at white and base sensitivity, about."""
READ_NOISE = 3.0
"""Standard deviation of what reading a pixel adds, in electrons; today's sensors have one to five."""
_TINT = 0.5  # standard deviation of the white balance, as a share of the exposure's
_SAMPLES_A_PIXEL = 2  # along the path of a motion blur


def fewer_views(capture: Capture, among: list[int], count: int, rng: np.random.Generator) -> Capture:
    """`count` of the views `among`, at random: an even choice may keep one of two rings of cameras."""
    chosen = sorted(rng.permutation(among)[:count].tolist())
    return replace(capture, views=tuple(capture.views[i] for i in chosen))


def turned_cameras(capture: Capture, degrees: float, rng: np.random.Generator) -> Capture:
    """Every camera turned about its centre by the angle, about an axis of its own."""
    axes = rng.standard_normal((len(capture.views), 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    views = []
    for view, axis in zip(capture.views, axes, strict=True):
        turn = np.eye(4)
        turn[:3, :3] = Rotation.from_rotvec(np.deg2rad(degrees) * axis).as_matrix()
        views.append(view.at(turn @ view.world_to_camera))
    return replace(capture, views=tuple(views))


def wrong_focal_length(capture: Capture, share: float) -> Capture:
    """All focal lengths too long by the share; one camera took all photographs."""
    return capture.zoomed(1.0 + share)


def fewer_points(capture: Capture, share: float, rng: np.random.Generator) -> Capture:
    """The share of the sparse points."""
    order = rng.permutation(len(capture.points))
    kept = np.sort(order[: round(share * len(order))])
    return replace(capture, points=capture.points[kept], point_colors=capture.point_colors[kept])


def jittered_exposure(capture: Capture, stops: float, rng: np.random.Generator) -> Capture:
    """Each photograph with an exposure and a white balance of its own.

    Args:
        stops: standard deviation of the exposure; red and blue get half of that for themselves. The means over the
            views stay as they were. What gets brighter than white is clipped, as a camera does it.
    """
    exposure = rng.standard_normal((len(capture.views), 1))
    tint = _TINT * rng.standard_normal((len(capture.views), 3)) * (1.0, 0.0, 1.0)
    gains = exposure + tint
    gains -= gains.mean(axis=0)
    changed = (
        replace(view, image=_encoded(decode(view.image / 255.0) * 2.0 ** (stops * gain)))
        for view, gain in zip(capture.views, gains, strict=True)
    )
    return replace(capture, views=tuple(changed))


def motion_blurred(capture: Capture, share: float, rng: np.random.Generator) -> Capture:
    """Each photograph blurred along a line, in linear light.

    Args:
        share: length of the line as a share of the photograph's width; its direction differs from view to view.
    """
    angles = rng.uniform(0.0, np.pi, len(capture.views))
    changed = (
        replace(view, image=_blurred(view.image, share * view.camera.width, angle))
        for view, angle in zip(capture.views, angles, strict=True)
    )
    return replace(capture, views=tuple(changed))


def compressed(capture: Capture, quality: int) -> Capture:
    """Every photograph as a JPEG file of the quality (0 to 100) shows it."""
    with tempfile.TemporaryDirectory(prefix="cvdgs-jpeg-") as folder:
        file = Path(folder) / "view.jpg"
        return _with_views(capture, lambda view: replace(view, image=_through_jpeg(view.image, quality, file)))


def dimly_lit(capture: Capture, stops: float, rng: np.random.Generator) -> Capture:
    """Photographs taken with less light and brought back to their brightness, which brings up the noise.

    Args:
        stops: halvings of the light. Photons come at random, and reading the sensor adds `READ_NOISE`.
    """
    white = WHITE_ELECTRONS / 2.0**stops

    def noisy(view: View) -> View:
        electrons = rng.poisson(decode(view.image / 255.0) * white) + rng.normal(0.0, READ_NOISE, view.image.shape)
        return replace(view, image=_encoded(electrons / white))

    return _with_views(capture, noisy)


def saturated(capture: Capture, factor: float) -> Capture:
    """The scene in more vivid colours: CIELAB's chroma times the factor, clipped to what a display can show."""
    colors = _more_vivid(capture.point_colors[None], factor)[0] if len(capture.points) else capture.point_colors
    changed = _with_views(capture, lambda view: replace(view, image=_more_vivid(view.image, factor)))
    return replace(changed, point_colors=colors)


def _with_views(capture: Capture, change: Callable[[View], View]) -> Capture:
    return replace(capture, views=tuple(map(change, capture.views)))


def _blurred(image: Image, pixels: float, angle: float) -> Image:
    light = decode(image / 255.0)
    offsets = np.linspace(-0.5, 0.5, int(np.ceil(_SAMPLES_A_PIXEL * pixels)) + 1) * pixels
    down, right = np.sin(angle), np.cos(angle)
    moved = (shift(light, (down * offset, right * offset, 0.0), order=1, mode="nearest") for offset in offsets)
    return _encoded(sum(moved) / len(offsets))


def _through_jpeg(image: Image, quality: int, file: Path) -> Image:
    write_jpeg(file, image, quality, full_chroma=False)
    return read_png(file)


def _more_vivid(image: Image, factor: float) -> Image:
    lab = srgb_to_lab(image_to_tensor(image))
    lab[1:] *= factor
    return to_bytes(tensor_to_image(linear_to_srgb(lab_to_linear(lab).clamp(0.0, 1.0))))


def _encoded(light: NDArray[np.float64]) -> Image:
    """uint8 of linear light; what is beyond black and white is clipped."""
    return to_bytes(encode(np.clip(light, 0.0, 1.0)))
