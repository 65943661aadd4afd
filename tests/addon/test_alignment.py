"""Two runs of the same place: one is brought onto the other by marks or by photographs, in metres where one knows."""

from __future__ import annotations

import json

import bpy
import mathutils
import numpy as np
import pytest

from cvdgs.cvdgs_addon.results import show_run
from cvdgs.cvdgs_addon.scene.alignment import add_marks, align_by_marks, align_by_photographs
from cvdgs.cvdgs_addon.scene.cameras import is_capture_camera
from cvdgs.cvdgs_addon.scene.placement import found_of, set_metres
from cvdgs.ui.display import CVDGS_PT_display

from .layouts import drawn
from .scenes import synthetic_run
from .test_neighbours import in_scene, two  # noqa: F401 - a fixture

PLACES = [(1.0, 0.2, 0.1), (-0.7, 0.9, 0.3), (0.1, -0.8, 0.9)]


@pytest.fixture
def apart(two):  # noqa: F811
    """Two runs of the same Gaussians, the second turned, moved and half as large."""
    first, second = two
    turn = mathutils.Euler((0.3, -0.2, 1.1)).to_matrix().to_4x4()
    second.parent.matrix_world = (
        mathutils.Matrix.Translation((3.0, 1.0, 0.5)) @ turn @ mathutils.Matrix.Scale(0.5, 4)
    ) @ second.parent.matrix_world
    bpy.context.view_layer.update()
    return first, second


def cameras_of(splats: bpy.types.Object) -> list[bpy.types.Object]:
    return list(filter(is_capture_camera, splats.parent.children))


def put_marks(first, second, shift: float = 0.0) -> None:
    """Marks at the same Gaussian's place of both; the last one of the second run off by `shift` in the scene."""
    add_marks(first, second)
    bpy.context.view_layer.update()
    for owner in (first, second):
        marks = [child for child in owner.parent.children if "cvdgs_mark" in child]
        assert len(marks) == 3
        for mark, index in zip(marks, (3, 50, 170), strict=True):
            place = mathutils.Vector(in_scene(owner)[index].tolist())
            mark.matrix_world = mathutils.Matrix.Translation(place)
    mark.matrix_world = mathutils.Matrix.Translation(place + mathutils.Vector((shift, 0.0, 0.0)))


def test_marks_bring_a_run_onto_another(apart):
    first, second = apart
    put_marks(first, second)
    assert not np.allclose(in_scene(first), in_scene(second), atol=0.1)
    before = in_scene(first)
    assert bpy.ops.cvdgs.align_marks() == {"FINISHED"}
    np.testing.assert_allclose(in_scene(second), before, atol=1e-4)
    np.testing.assert_array_equal(in_scene(first), before)


def test_cameras_of_a_run_that_was_resized_see_as_much_of_it_as_before(apart):
    first, second = apart
    put_marks(first, second)
    ranges = {child: (child.data.clip_start, child.data.clip_end) for child in cameras_of(second)}
    found = align_by_marks(second, first)
    assert found.scale == pytest.approx(2.0, rel=1e-3)
    for camera, (start, end) in ranges.items():
        assert camera.data.clip_start == pytest.approx(start * found.scale, rel=1e-4)
        assert camera.data.clip_end == pytest.approx(end * found.scale, rel=1e-4)


def test_marks_are_in_the_artists_scene_where_lit_objects_are_rendered_apart(apart):
    scene = bpy.context.scene
    scene.cvdgs.display.colors = "SCENE_LINEAR"
    assert bpy.ops.cvdgs.set_up_render() == {"FINISHED"}
    bpy.context.view_layer.update()
    assert bpy.ops.cvdgs.add_marks() == {"FINISHED"}
    bpy.context.view_layer.update()
    for owner in apart:
        assert (
            len([child for child in owner.parent.children if "cvdgs_mark" in child and scene in child.users_scene]) == 3
        )


def test_what_does_not_fit_is_told(apart):
    first, second = apart
    put_marks(first, second, shift=0.3)
    found = align_by_marks(second, first)
    assert found.pairs == 3
    assert 0.01 < found.error < 0.6
    assert found.scale == pytest.approx(2.0, rel=0.3)
    assert "3 pairs" in found.in_words
    assert " m " not in found.in_words


def test_the_run_that_knows_metres_stays_and_passes_them_on(apart):
    first, second = apart
    set_metres(second.parent, 0.5)
    put_marks(first, second)
    before = in_scene(second)
    bpy.ops.cvdgs.align_marks()  # the panel is about the second
    np.testing.assert_array_equal(in_scene(second), before)
    np.testing.assert_allclose(in_scene(first), before, atol=1e-4)
    metres = found_of(first.parent).metres_per_unit
    assert metres == pytest.approx(max(first.parent.matrix_world.to_scale()), rel=1e-5)


def test_two_runs_that_know_metres_keep_their_sizes(apart):
    first, second = apart
    for found in apart:
        set_metres(found.parent, max(found.parent.matrix_world.to_scale()))
    put_marks(first, second)
    size = second.parent.matrix_world.to_scale()
    found = align_by_marks(second, first)
    assert (found.scale, found.is_metric) == (1.0, True)
    assert list(second.parent.matrix_world.to_scale()) == pytest.approx(list(size), rel=1e-5)
    assert " m apart" in found.in_words


def test_a_run_that_was_resized_since_it_was_measured_gets_its_size_back(apart):
    first, second = apart
    for found in apart:
        set_metres(found.parent, 1.0)  # as the second, half as large, no longer has
    assert bpy.ops.cvdgs.align_photographs() == {"FINISHED"}
    np.testing.assert_allclose(in_scene(second), in_scene(first), atol=1e-3)
    assert found_of(second.parent).metres_per_unit == pytest.approx(1.0, rel=1e-4)


def test_in_a_scene_of_centimetres_metres_are_passed_on_and_told_as_such(apart):
    bpy.context.scene.unit_settings.system, bpy.context.scene.unit_settings.scale_length = "METRIC", 0.01
    first, second = apart
    set_metres(first.parent, 0.01)
    put_marks(first, second, shift=0.3)
    found = align_by_marks(second, first)
    assert found.is_metric
    assert 0.0001 < found.error < 0.006
    in_metres = 0.01 * max(second.parent.matrix_world.to_scale())
    assert found_of(second.parent).metres_per_unit == pytest.approx(in_metres, rel=1e-4)


def test_photographs_of_both_do_without_marks(apart):
    first, second = apart
    assert bpy.ops.cvdgs.align_photographs() == {"FINISHED"}
    np.testing.assert_allclose(in_scene(second), in_scene(first), atol=1e-3)


def test_photographs_are_recognised_in_files_of_versions_that_kept_their_objects_names_alone(apart):
    for splats in apart:
        for camera in cameras_of(splats):
            del camera.data["cvdgs_view"]
    first, second = apart
    assert bpy.ops.cvdgs.align_photographs() == {"FINISHED"}
    np.testing.assert_allclose(in_scene(second), in_scene(first), atol=1e-3)


@pytest.mark.parametrize("name", ["frame.{:04d}", "a room with a name too long for Blender, from " * 4 + "{}"])
def test_photographs_may_have_names_that_blender_changes(addon, tmp_path, name):
    loaded = []
    for folder in ("shop", "window"):
        file = synthetic_run(tmp_path / folder) / "capture" / "transforms.json"
        document = json.loads(file.read_text())
        for number, frame in enumerate(document["frames"], start=1):
            frame["file_path"] = f"images/{name.format(number)}.png"
        file.write_text(json.dumps(document))
        loaded.append(show_run(str(tmp_path / folder), bpy.context.scene))
    first, second = loaded
    second.parent.location.x = 3.0
    assert align_by_photographs(second, first).pairs == 5
    np.testing.assert_allclose(in_scene(second), in_scene(first), atol=1e-3)


def test_photographs_that_only_share_names_move_nothing(apart):
    _, second = apart
    for number, child in enumerate(second.parent.children):
        if child.type == "CAMERA":
            child.location = PLACES[number % 3]
    bpy.context.view_layer.update()
    before = in_scene(second)
    with pytest.raises(RuntimeError, match="same names, but not the same places - mark points"):
        bpy.ops.cvdgs.align_photographs()
    np.testing.assert_array_equal(in_scene(second), before)


def test_too_few_marks_are_refused(apart):
    with pytest.raises(RuntimeError, match="0 pairs of points - give at least 3"):
        bpy.ops.cvdgs.align_marks()
    bpy.ops.cvdgs.add_marks()
    bpy.ops.cvdgs.add_marks()
    assert sum("cvdgs_mark" in found for found in bpy.context.scene.objects) == 8, "one pair more"


def test_one_run_alone_is_aligned_with_nothing(apart):
    first, _ = apart
    assert "cvdgs.align_marks" in drawn(CVDGS_PT_display).operators
    first.hide_render = True
    assert not bpy.ops.cvdgs.add_marks.poll()
    assert "cvdgs.align_marks" not in drawn(CVDGS_PT_display).operators
