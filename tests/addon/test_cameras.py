"""Cameras: from a capture's intrinsics and pose to Blender's, and back."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cvdgs.core.capture.model import PinholeCamera
from cvdgs.core.errors import InputError
from cvdgs.cvdgs_addon.scene import cameras

from .ewa import rotation_matrices
from .scenes import CLIP, opencv, ring_view

TOLERANCE = 1e-4  # pixels


@st.composite
def intrinsics(draw) -> PinholeCamera:
    width, height = draw(st.integers(16, 1600)), draw(st.integers(16, 1600))
    fx = draw(st.floats(0.4, 3.0)) * max(width, height)
    return PinholeCamera(
        width,
        height,
        fx,
        fx * draw(st.floats(0.5, 2.0)),
        width * draw(st.floats(0.3, 0.7)),
        height * draw(st.floats(0.3, 0.7)),
    )


@st.composite
def poses(draw) -> np.ndarray:
    quaternion = draw(st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 0.1))
    pose = np.eye(4)
    pose[:3, :3] = rotation_matrices(np.array([quaternion]))[0]
    pose[:3, 3] = [draw(st.floats(-5.0, 5.0)) for _ in range(3)]
    return pose


def add(camera: PinholeCamera, pose: np.ndarray) -> bpy.types.Object:
    return cameras.add_camera("camera", camera, pose, CLIP, bpy.context.scene.collection)


def project(camera: PinholeCamera, world_to_camera: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(P, 2) pixels of (P, 3) world points."""
    x, y, z = (points @ world_to_camera[:3, :3].T + world_to_camera[:3, 3]).T
    return np.stack([camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy], axis=1)


def points_in_view(camera: PinholeCamera, pose: np.ndarray) -> np.ndarray:
    """(P, 3) world points on the pixels of a grid, at two depths."""
    columns, rows = np.meshgrid(np.linspace(0, camera.width, 5), np.linspace(0, camera.height, 5))
    rays = np.stack([(columns - camera.cx) / camera.fx, -(rows - camera.cy) / camera.fy, -np.ones_like(rows)], -1)
    local = np.concatenate([rays.reshape(-1, 3) * depth for depth in (1.0, 4.0)])
    return local @ pose[:3, :3].T + pose[:3, 3]


@settings(deadline=None, max_examples=60)
@given(intrinsics(), poses())
def test_a_camera_comes_back_as_it_went_in(camera, pose):
    added = add(camera, pose)
    points = points_in_view(camera, pose)
    intrinsics_only = project(cameras.camera_intrinsics(added), opencv(pose), points)
    assert np.abs(intrinsics_only - project(camera, opencv(pose), points)).max() < TOLERANCE
    np.testing.assert_allclose(cameras.camera_to_world(added), pose, atol=1e-6)
    bpy.data.cameras.remove(added.data)


@settings(deadline=None, max_examples=60)
@given(intrinsics())
def test_blender_projects_as_the_pinhole_camera_does(camera):
    """Blender's own projection matrix is the oracle."""
    scene = bpy.context.scene
    added = add(camera, np.eye(4))
    cameras.use_camera(scene, added)
    bpy.context.view_layer.update()
    projection = np.array(
        added.calc_matrix_camera(
            bpy.context.evaluated_depsgraph_get(),
            x=scene.render.resolution_x,
            y=scene.render.resolution_y,
            scale_x=scene.render.pixel_aspect_x,
            scale_y=scene.render.pixel_aspect_y,
        )
    )
    points = points_in_view(camera, np.eye(4))
    clip = np.c_[points, np.ones(len(points))] @ projection.T
    ndc = clip[:, :2] / clip[:, 3:]
    pixels = np.stack([(ndc[:, 0] + 1) / 2 * camera.width, (1 - ndc[:, 1]) / 2 * camera.height], axis=1)
    # The matrix is float32, so its entries are known to 6e-8 of the focal length in pixels.
    tolerance = max(TOLERANCE, 4e-7 * max(camera.fx, camera.fy, camera.width, camera.height))
    assert np.abs(pixels - project(camera, opencv(np.eye(4)), points)).max() < tolerance
    bpy.data.cameras.remove(added.data)


def test_using_a_camera_puts_its_image_size_in_force():
    scene = bpy.context.scene
    portrait = add(PinholeCamera(360, 640, 500.0, 500.0, 180.0, 320.0), np.eye(4))
    landscape = add(PinholeCamera(640, 360, 500.0, 400.0, 320.0, 180.0), np.eye(4))
    cameras.use_camera(scene, portrait)
    assert (scene.render.resolution_x, scene.render.resolution_y) == (360, 640)
    assert scene.render.pixel_aspect_x == scene.render.pixel_aspect_y == 1.0
    cameras.use_camera(scene, landscape)
    assert (scene.render.resolution_x, scene.render.resolution_y) == (640, 360)
    assert scene.render.pixel_aspect_y == 1.25
    assert scene.camera is landscape


def test_moving_the_lens_moves_the_intrinsics():
    added = add(PinholeCamera(640, 480, 500.0, 500.0, 320.0, 240.0), ring_view(0.3))
    added.data.lens *= 2.0
    assert cameras.camera_intrinsics(added).fx == pytest.approx(1000.0, rel=1e-6)
    assert cameras.is_capture_camera(added)


def test_focal_lengths_that_blender_cannot_express_are_refused():
    with pytest.raises(InputError, match="differ too much"):
        add(PinholeCamera(640, 480, 1.0, 500.0, 320.0, 240.0), np.eye(4))
