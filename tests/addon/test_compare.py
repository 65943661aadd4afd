"""The comparison of original and other colours, side by side in one picture."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from cvdgs.core.color import srgb
from cvdgs.cvdgs_addon.scene import splats
from cvdgs.cvdgs_addon.scene.splat_attributes import Attribute
from cvdgs.cvdgs_addon.scene.splat_nodes import Input
from cvdgs.cvdgs_addon.scene.turntable import Turntable, add_turntable, render_turntable

from . import ewa
from .scenes import CAMERA, add_with_inverse, cloud, drawn_points, opencv, read_png, render_png, ring_view

POSE = ring_view(0.4)
LAYER = "tritan-0.5"


@pytest.fixture
def gaussians():
    return cloud(200)


@pytest.fixture
def compared(scene, gaussians):
    """Gaussians whose layer has the inverse colours, compared at a third of the picture."""
    added = add_with_inverse(scene, gaussians, LAYER, POSE)
    splats.set_input(added, Input.COMPARE, True)
    splats.set_input(added, Input.BORDER, 0.375)
    return added


def expected(gaussians, layer) -> np.ndarray:
    """The original's picture up to column 24 of 64, the layer's from there."""
    left, right = (ewa.render(gaussians, colors, CAMERA, opencv(POSE)) for colors in (gaussians.base_colors, layer))
    picture = right.copy()
    picture[:, :24] = left[:, :24]
    return picture


@pytest.mark.parametrize("mesh_limit", [0, 1000], ids=["instances", "one mesh"])
def test_a_picture_shows_the_original_left_of_the_border(scene, compared, gaussians, mesh_limit, tmp_path):
    splats.set_input(compared, Input.MESH_LIMIT, mesh_limit)
    image = render_png(scene, tmp_path / "image.png")
    assert ewa.psnr(image, expected(gaussians, 1.0 - gaussians.base_colors)) > 50.0


def test_the_slider_moves_the_right_side_only(scene, compared, gaussians, tmp_path):
    splats.set_input(compared, Input.ENHANCED, 0.25)
    blended = 0.75 * gaussians.base_colors + 0.25 * (1.0 - gaussians.base_colors)
    assert ewa.psnr(render_png(scene, tmp_path / "image.png"), expected(gaussians, blended)) > 50.0


def test_ellipsoids_meet_the_border_where_the_discs_do(scene, compared, tmp_path):
    """Seen from the camera; the hulls differ elsewhere, by where they are entered."""
    discs = render_png(scene, tmp_path / "discs.png")
    splats.set_input(compared, Input.CAMERA_FACING, False)
    ellipsoids = render_png(scene, tmp_path / "ellipsoids.png")
    splats.set_input(compared, Input.COMPARE, False)
    uniform = render_png(scene, tmp_path / "uniform.png")
    np.testing.assert_array_equal(ellipsoids[:, 24:], uniform[:, 24:])
    assert np.abs(ellipsoids[:, :24] - uniform[:, :24]).max() > 0.3
    assert np.abs(ellipsoids - discs).mean() < 0.02


@pytest.fixture
def left(gaussians):
    """(N,) which centres are seen left of the border."""
    seen = np.c_[gaussians.means, np.ones(len(gaussians))] @ opencv(POSE).T
    return CAMERA.fx * seen[:, 0] / seen[:, 2] + CAMERA.cx < 24.0


def test_points_have_the_colour_of_their_centres_side(scene, compared, gaussians, left):
    splats.set_input(compared, Input.AS_POINTS, True)
    positions, colors = drawn_points(compared)
    order = np.array([np.linalg.norm(gaussians.means - position, axis=1).argmin() for position in positions])
    wanted = np.where(left[:, None], gaussians.base_colors, 1.0 - gaussians.base_colors)
    np.testing.assert_allclose(colors, wanted[order], atol=1e-5)


def test_so_has_the_preview_in_solid_shading(scene, compared, gaussians, left):
    splats.set_input(compared, Input.PREVIEW, True)
    mesh = compared.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    colors = np.empty((len(mesh.vertices), 4), np.float32)
    mesh.attributes[Attribute.PREVIEW_COLOR].data.foreach_get("color", colors.ravel())
    original = srgb.decode(gaussians.base_colors)
    is_original = np.abs(colors[:, None, :3] - original).max(2).min(1) < 1e-5
    assert is_original.sum() == 4 * left.sum()


def test_every_picture_of_a_turntable_has_the_border(scene, compared, tmp_path):
    turn = Turntable(frames=2, radius=3.5, focal_length=40.0, width=64, height_pixels=48)
    add_turntable(scene, compared, turn)
    for name, on, enhanced in (("both", True, 1.0), ("original", False, 0.0), ("layer", False, 1.0)):
        splats.set_input(compared, Input.COMPARE, on)
        splats.set_input(compared, Input.ENHANCED, enhanced)
        render_turntable(scene, turn, tmp_path / name, wait=True)
    for frame in ("0001.png", "0002.png"):
        both, original, layer = (read_png(tmp_path / name / frame) for name in ("both", "original", "layer"))
        np.testing.assert_array_equal(both[:, :24], original[:, :24])
        np.testing.assert_array_equal(both[:, 24:], layer[:, 24:])
        assert np.abs(original - layer).max() > 0.3
