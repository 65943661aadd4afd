"""Undistorted views show what a pinhole at the stated intrinsics would see, for every camera model."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cvdgs.core.capture.model import View
from cvdgs.core.capture.reader import read_capture
from cvdgs.core.capture.undistort import choose_pinhole, is_pinhole
from cvdgs.core.errors import InputError

from .make_captures import Shot, pinhole, save, shots, with_model, write_colmap

MODELS = {
    "SIMPLE_PINHOLE": [],
    "PINHOLE": [],
    "SIMPLE_RADIAL": [-0.12],
    "RADIAL": [0.06, -0.08],
    "OPENCV": [0.06, -0.08, -0.004, 0.003],
    "FULL_OPENCV": [0.06, -0.05, 0.002, -0.001, 0.01, 0.02, 0.01, 0.0],
    "FOV": [0.6],
    "SIMPLE_DIVISION": [-0.1],
    "DIVISION": [-0.1],
    "SIMPLE_FISHEYE": [],
    "FISHEYE": [],
    "SIMPLE_RADIAL_FISHEYE": [0.05],
    "RADIAL_FISHEYE": [0.05, -0.02],
    "OPENCV_FISHEYE": [0.05, -0.02, 0.01, 0.0],
    "THIN_PRISM_FISHEYE": [0.02, -0.01, 0.001, -0.001, 0.0, 0.0, 0.002, 0.001],
    "RAD_TAN_THIN_PRISM_FISHEYE": [0.02, -0.01, 0.0, 0.0, 0.0, 0.0, 0.001, 0.001, 0.001, 0.0, 0.0, 0.0],
    "EUCM": [0.5, 1.1],
}


def ideal(view: View, shot: Shot) -> np.ndarray:
    """What the view should show: the scene's colours along the rays of its pinhole."""
    camera = view.camera
    u, v = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    return shot.colors((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("max_size", [None, 64])
def test_view_shows_what_its_pinhole_sees(tmp_path: Path, model: str, max_size: int | None) -> None:
    photographs = shots(2, with_model(model, MODELS[model]))
    capture = read_capture(write_colmap(tmp_path, photographs), max_size=max_size)
    for view, shot in zip(capture.views, photographs, strict=True):
        assert view.image.shape == (view.camera.height, view.camera.width, 3)
        assert max(view.image.shape) == (max_size or 96)
        assert view.alpha is None
        error = np.abs(view.image - ideal(view, shot))
        # 110 levels of amplitude and up to 2.5 rad a unit: a shift by a whole pixel would be 10 levels in the mean.
        assert np.median(error) < 1.2
        assert np.percentile(error, 99) < 6.0


@pytest.mark.parametrize("model", MODELS)
def test_field_of_view_stays_about_the_same(model: str) -> None:
    camera = with_model(model, MODELS[model])
    chosen = choose_pinhole(camera, where="camera")
    edges = np.array([[0.0, 36.0], [96.0, 36.0], [48.0, 0.0], [48.0, 72.0]])
    left, right, top, bottom = camera.cam_ray_from_img(edges)
    width = np.arctan2(right[0], right[2]) - np.arctan2(left[0], left[2])
    height = np.arctan2(bottom[1], bottom[2]) - np.arctan2(top[1], top[2])
    chosen_width = np.arctan(chosen.cx / chosen.fx) + np.arctan((chosen.width - chosen.cx) / chosen.fx)
    chosen_height = np.arctan(chosen.cy / chosen.fy) + np.arctan((chosen.height - chosen.cy) / chosen.fy)
    assert chosen_width == pytest.approx(width, rel=0.12)
    assert chosen_height == pytest.approx(height, rel=0.12)


@pytest.mark.parametrize("model", MODELS)
def test_points_project_alike_through_the_distorted_camera_and_the_view(model: str) -> None:
    """A pixel of the view looks where pycolmap says that its place in the photograph looks."""
    from cvdgs.core.capture.undistort import source_pixels

    camera = with_model(model, MODELS[model])
    chosen = choose_pinhole(camera, where="camera")
    places = source_pixels(camera, chosen).astype(float)[::7, ::7] * (camera.width, camera.height)
    rays = camera.cam_ray_from_img(places.reshape(-1, 2))
    u, v = np.meshgrid(np.arange(chosen.width)[::7] + 0.5, np.arange(chosen.height)[::7] + 0.5)
    projected = rays[:, :2] / rays[:, 2:] * (chosen.fx, chosen.fy) + (chosen.cx, chosen.cy)
    np.testing.assert_allclose(projected, np.column_stack([u.ravel(), v.ravel()]), atol=0.01)


def test_pinhole_is_left_as_it_is() -> None:
    camera = pinhole()
    chosen = choose_pinhole(camera, where="camera")
    assert (chosen.fx, chosen.fy, chosen.cx, chosen.cy) == tuple(camera.params)


def test_fisheye_without_further_distortion_is_not_a_pinhole() -> None:
    assert not is_pinhole(with_model("FISHEYE", []))
    assert is_pinhole(with_model("OPENCV", [0.0, 0.0, 0.0, 0.0]))


def test_fisheye_of_half_a_sphere_is_cut_at_sixty_degrees_off_the_axis(tmp_path: Path) -> None:
    camera = with_model("SIMPLE_FISHEYE", [])
    camera.params = [96 / np.radians(190.0), 48.0, 36.0]
    photographs = shots(2, camera)
    capture = read_capture(write_colmap(tmp_path, photographs), max_size=None)
    chosen = capture.views[0].camera
    widest = max(chosen.cx, chosen.width - chosen.cx) / chosen.fx
    assert 55.0 < np.degrees(np.arctan(widest)) < 60.1
    center = (slice(26, 46), slice(38, 58))
    error = np.abs(capture.views[0].image - ideal(capture.views[0], photographs[0]))[center]
    assert np.median(error) < 4.0


def test_principal_point_off_the_centre_is_kept_where_the_window_allows(tmp_path: Path) -> None:
    camera = with_model("OPENCV", [-0.05, 0.0, 0.0, 0.0])
    camera.params = [80.0, 90.0, 40.0, 41.0, -0.05, 0.0, 0.0, 0.0]
    photographs = shots(2, camera)
    view = read_capture(write_colmap(tmp_path, photographs), max_size=None).views[0]
    assert view.camera.fy / view.camera.fx == pytest.approx(90.0 / 80.0)
    assert view.camera.cx == pytest.approx(40.0, abs=2.0)
    assert view.camera.cy == pytest.approx(41.0, abs=2.0)
    assert np.median(np.abs(view.image - ideal(view, photographs[0]))) < 1.2


def test_transparency_is_undistorted_with_the_image(tmp_path: Path) -> None:
    camera = with_model("SIMPLE_RADIAL", [-0.12])
    photographs = shots(2, camera)
    root = write_colmap(tmp_path, photographs)
    alpha = np.zeros((72, 96, 1), np.uint8)
    alpha[:, 48:] = 255
    save(root / "images" / "0001.png", np.dstack([photographs[0].render(), alpha]))
    capture = read_capture(root, max_size=None)
    assert capture.views[0].alpha is not None
    assert (capture.views[0].alpha[:, :46] == 0).all()
    assert (capture.views[0].alpha[:, 50:] == 255).all()
    assert capture.views[1].alpha is None
    assert "alpha" in [warning.name for warning in capture.warnings]


def test_distortion_that_folds_over_everywhere_is_refused(tmp_path: Path) -> None:
    camera = with_model("SIMPLE_RADIAL", [-60.0])
    root = write_colmap(tmp_path, shots(2, pinhole()), text=True)
    cameras = root / "sparse" / "0" / "cameras.txt"
    cameras.write_text(f"1 SIMPLE_RADIAL 96 72 {' '.join(map(str, camera.params))}\n")
    with pytest.raises(InputError, match="distortion cannot be inverted"):
        read_capture(root, max_size=None)
