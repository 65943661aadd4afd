"""The compositor node "CVD simulation": its pixels against numpy, in every working space."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from cvdgs.core.color.matrices import linear_simulation
from cvdgs.cvdgs_addon.compositor import simulation_group as group
from cvdgs.cvdgs_addon.compositor.apply import Simulation, show_simulation
from cvdgs.cvdgs_addon.compositor.simulation_group import Socket

from .pictures import composited, feed_picture, random_picture

TOLERANCE = 1e-5
SEVERITIES = (0.0, 0.37, 1.0)

# Linear Rec.709 of the unit vectors of other working spaces. Rec.2020: from the primaries (ITU-R BT.2020, D65).
# ACEScg: AP1 primaries, with Bradford adaptation from ACES white (Academy TB-2014-004).
TO_REC709 = {
    "Linear Rec.709": np.eye(3),
    "Linear Rec.2020": np.array(
        [
            [1.6604910, -0.5876411, -0.0728499],
            [-0.1245505, 1.1328999, -0.0083494],
            [-0.0181508, -0.1005789, 1.1187297],
        ]
    ),
    "ACEScg": np.array(
        [
            [1.7050510, -0.6217921, -0.0832589],
            [-0.1302564, 1.1408047, -0.0105483],
            [-0.0240034, -0.1289690, 1.1529724],
        ]
    ),
}
HAS_WORKING_SPACES = bpy.app.version >= (5, 0)


def simulated(light: np.ndarray, cvd: str, severity: float, model: str) -> np.ndarray:
    """S between linear Rec.709 colours, without clipping."""
    simulation = linear_simulation(cvd, severity, "brettel" if (cvd, model) == ("tritan", "vienot") else model)
    result = light @ simulation.matrix.T
    if simulation.matrix_below is not None:
        below = (light @ simulation.separator < 0.0)[..., None]
        result = np.where(below, light @ simulation.matrix_below.T, result)
    return result


def decoded(srgb: np.ndarray) -> np.ndarray:
    return np.where(srgb <= 0.04045, srgb / 12.92, ((np.maximum(srgb, 0.04) + 0.055) / 1.055) ** 2.4)


def encoded(light: np.ndarray) -> np.ndarray:
    return np.where(light <= 0.0031308, light * 12.92, 1.055 * np.maximum(light, 0.003) ** (1 / 2.4) - 0.055)


@pytest.fixture
def empty_scene():
    return standard_scene()


def standard_scene() -> bpy.types.Scene:
    """The scene of a new, empty file with the view transform Standard."""
    bpy.ops.wm.read_homefile(use_empty=True)
    scene = bpy.context.scene
    scene.view_settings.view_transform = "Standard"
    return scene


@pytest.mark.parametrize("display_referred", [False, True])
def test_every_type_and_model_is_what_numpy_makes_of_it(empty_scene, tmp_path, display_referred):
    picture = random_picture()
    feed_picture(empty_scene, picture)
    colors = picture[..., :3].astype(np.float64)
    for cvd in group.TYPE_NAMES:
        for model in group.MODEL_NAMES:
            for severity in SEVERITIES:
                node = show_simulation(empty_scene, Simulation(cvd, severity, model))
                node.inputs[Socket.DISPLAY_REFERRED].default_value = display_referred
                if display_referred:
                    expected = encoded(simulated(decoded(colors), cvd, severity, model).clip(0.0, 1.0))
                else:
                    expected = simulated(colors, cvd, severity, model)
                error = np.abs(composited(empty_scene, tmp_path)[..., :3] - expected).max()
                assert error < TOLERANCE, (cvd, model, severity)


@pytest.mark.skipif(not HAS_WORKING_SPACES, reason="this Blender has one working space")
@pytest.mark.parametrize("space", TO_REC709)
def test_scene_linear_light_is_simulated_in_any_working_space(empty_scene, tmp_path, space):
    bpy.ops.wm.set_working_color_space(working_space=space, convert_colors=False)
    assert bpy.data.colorspace.working_space == space
    picture = random_picture(seed=1) * np.float32(2.0)  # some of it brighter than white
    picture[..., 3] = 1.0
    feed_picture(empty_scene, picture)
    to_rec709 = TO_REC709[space]
    for cvd, model in (("deutan", "machado"), ("protan", "vienot"), ("tritan", "brettel")):
        show_simulation(empty_scene, Simulation(cvd, 0.8, model))
        light = simulated(picture[..., :3] @ to_rec709.T, cvd, 0.8, model)
        expected = light @ np.linalg.inv(to_rec709).T
        assert np.abs(composited(empty_scene, tmp_path)[..., :3] - expected).max() < TOLERANCE


def test_severity_zero_is_the_identity_beyond_the_gamut_too(empty_scene, tmp_path):
    picture = random_picture() * np.float32(4.0) - np.float32(1.0)
    picture[..., 3] = 1.0
    feed_picture(empty_scene, picture)
    show_simulation(empty_scene, Simulation(severity=0.0))
    np.testing.assert_allclose(composited(empty_scene, tmp_path), picture, atol=TOLERANCE)


@pytest.mark.parametrize("display_referred", [False, True])
def test_transparency_stays_and_does_not_change_colours(tmp_path, display_referred):
    """Blender's compositor multiplies colours by alpha; a picture of half the coverage is the same half there."""
    opaque = random_picture()
    results = []
    for coverage in (1.0, 0.5):
        scene = standard_scene()
        feed_picture(scene, opaque * np.float32(coverage))
        node = show_simulation(scene, Simulation("deutan", 1.0))
        node.inputs[Socket.DISPLAY_REFERRED].default_value = display_referred
        results.append(composited(scene, tmp_path))
    np.testing.assert_allclose(results[1], results[0] * 0.5, atol=TOLERANCE)


@pytest.mark.parametrize("untouched", [0.0, 0.25, 0.5, 1.0])
def test_the_wipe_leaves_the_left_of_the_picture(empty_scene, tmp_path, untouched):
    picture = random_picture(width=32)
    feed_picture(empty_scene, picture)
    show_simulation(empty_scene, Simulation("protan", 1.0, untouched=untouched))
    result = composited(empty_scene, tmp_path)[..., :3]
    border = round(32 * untouched)
    np.testing.assert_array_equal(result[:, :border], picture[:, :border, :3])
    expected = simulated(picture[:, border:, :3].astype(np.float64), "protan", 1.0, "machado")
    np.testing.assert_allclose(result[:, border:], expected, atol=TOLERANCE)


def test_every_socket_is_documented_and_limited(empty_scene):
    tree = group.simulation_group()
    inputs = [item for item in tree.interface.items_tree if item.in_out == "INPUT"]
    assert [item.name for item in inputs] == list(Socket)
    assert all(item.description for item in inputs)
    severity = next(item for item in inputs if item.name == Socket.SEVERITY)
    assert (severity.min_value, severity.max_value, severity.default_value) == (0.0, 1.0, 1.0)
    assert group.simulation_group() == tree


def test_a_choice_comes_back(empty_scene):
    feed_picture(empty_scene, random_picture(4, 4))
    node = show_simulation(empty_scene, Simulation("tritan", 0.5, "brettel"))
    assert group.chosen(node, Socket.TYPE) == "tritan"
    assert group.chosen(node, Socket.MODEL) == "brettel"
