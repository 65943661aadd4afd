"""Perturbations of photographs, cameras and points of a capture by known amounts.

Each function takes a capture and an amount and returns another capture; an amount of 0 (or a factor of 1) changes
nothing. The generator, where one is needed, determines directions and the amount their size: with the same generator,
a larger amount is the same perturbation made larger.
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

from ....core.capture.model import Capture, View
from ....core.color.spaces import image_to_tensor, lab_to_linear, linear_to_srgb, srgb_to_lab, tensor_to_image
from ....core.color.srgb import decode, encode
from ....core.files.images import read_png, to_bytes, write_jpeg

Image = NDArray[np.uint8]

WHITE_ELECTRONS = 10_000.0
"""Approximate full-well capacity of a small sensor's pixel at base sensitivity."""
READ_NOISE = 3.0
"""Standard deviation of the read noise in electrons; current sensors have one to five."""
_TINT = 0.5  # standard deviation of the white balance, relative to that of the exposure
_SAMPLES_PER_PIXEL = 2  # along the path of a motion blur


def fewer_views(capture: Capture, among: list[int], count: int, rng: np.random.Generator) -> Capture:
    """`count` random views of those `among`; evenly spaced ones may all lie on one of two rings of cameras."""
    chosen = sorted(rng.permutation(among)[:count].tolist())
    return replace(capture, views=tuple(capture.views[i] for i in chosen))


def turned_cameras(capture: Capture, degrees: float, rng: np.random.Generator) -> Capture:
    """Every camera rotated about its centre by the angle, around a random axis."""
    axes = rng.standard_normal((len(capture.views), 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    views = []
    for view, axis in zip(capture.views, axes, strict=True):
        turn = np.eye(4)
        turn[:3, :3] = Rotation.from_rotvec(np.deg2rad(degrees) * axis).as_matrix()
        views.append(view.at(turn @ view.world_to_camera))
    return replace(capture, views=tuple(views))


def wrong_focal_length(capture: Capture, share: float, rng: np.random.Generator | None = None) -> Capture:
    """All focal lengths too long by the share, as if one camera had taken all photographs."""
    return capture.zoomed(1.0 + share)


def fewer_points(capture: Capture, share: float, rng: np.random.Generator) -> Capture:
    """A random share of the sparse points."""
    order = rng.permutation(len(capture.points))
    kept = np.sort(order[: round(share * len(order))])
    return replace(capture, points=capture.points[kept], point_colors=capture.point_colors[kept])


def jittered_exposure(capture: Capture, stops: float, rng: np.random.Generator) -> Capture:
    """Each photograph with a random exposure and white balance.

    Args:
        stops: standard deviation of the exposure; red and blue vary independently by half of it. The means over the
            views do not change. Values above white are clipped, as in a camera.
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
        share: length of the line relative to the photograph's width; its direction is random for each view.
    """
    angles = rng.uniform(0.0, np.pi, len(capture.views))
    changed = (
        replace(view, image=_blurred(view.image, share * view.camera.width, angle))
        for view, angle in zip(capture.views, angles, strict=True)
    )
    return replace(capture, views=tuple(changed))


def compressed(capture: Capture, quality: float, rng: np.random.Generator | None = None) -> Capture:
    """Every photograph compressed as JPEG of the quality (0 to 100)."""
    with tempfile.TemporaryDirectory(prefix="cvdgs-jpeg-") as folder:
        file = Path(folder) / "view.jpg"
        return _with_views(capture, lambda view: replace(view, image=_through_jpeg(view.image, int(quality), file)))


def dimly_lit(capture: Capture, stops: float, rng: np.random.Generator) -> Capture:
    """Photographs taken with less light and amplified to the same brightness, with shot noise and `READ_NOISE`.

    Args:
        stops: halvings of the light.
    """
    white = WHITE_ELECTRONS / 2.0**stops

    def noisy(view: View) -> View:
        electrons = rng.poisson(decode(view.image / 255.0) * white) + rng.normal(0.0, READ_NOISE, view.image.shape)
        return replace(view, image=_encoded(electrons / white))

    return _with_views(capture, noisy)


def saturated(capture: Capture, factor: float) -> Capture:
    """The scene in more vivid colours: CIELAB chroma times the factor, clipped to the gamut."""
    colors = _more_vivid(capture.point_colors[None], factor)[0] if len(capture.points) else capture.point_colors
    changed = _with_views(capture, lambda view: replace(view, image=_more_vivid(view.image, factor)))
    return replace(changed, point_colors=colors)


def _with_views(capture: Capture, change: Callable[[View], View]) -> Capture:
    return replace(capture, views=tuple(map(change, capture.views)))


def _blurred(image: Image, pixels: float, angle: float) -> Image:
    light = decode(image / 255.0)
    offsets = np.linspace(-0.5, 0.5, int(np.ceil(_SAMPLES_PER_PIXEL * pixels)) + 1) * pixels
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
    """Linear light as uint8, clipped to black and white."""
    return to_bytes(encode(np.clip(light, 0.0, 1.0)))
