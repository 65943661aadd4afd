"""Selecting Gaussians and cleaning up: nothing is lost, renders and exports agree, and it can be taken back."""

from __future__ import annotations

import bmesh
import bpy
import mathutils
import numpy as np
import pytest

from cvdgs.core.errors import InputError
from cvdgs.core.splats.floaters import kept_after
from cvdgs.core.splats.io.ply import read_floaters, read_ply, write_ply
from cvdgs.cvdgs_addon.export import read_gaussians
from cvdgs.cvdgs_addon.results import show_run
from cvdgs.cvdgs_addon.scene import crop, masks, splats
from cvdgs.cvdgs_addon.scene.finished_run import read_run
from cvdgs.cvdgs_addon.scene.masks import Treatment
from cvdgs.cvdgs_addon.scene.splat_attributes import Attribute, Frame
from cvdgs.ui.display import CVDGS_PT_display

from . import ewa
from .layouts import drawn
from .scenes import CAMERA, add_with_inverse, cloud, opencv, render_png, ring_view, synthetic_run, take
from .test_splats import apply_transform

POSE = ring_view(0.4)
LAYER = "tritan-0.5"


@pytest.fixture
def gaussians():
    return cloud(200)


@pytest.fixture
def added(scene, gaussians):
    return add_with_inverse(scene, gaussians, LAYER, POSE)


@pytest.fixture
def shown(addon, run_folder):
    return show_run(str(run_folder), bpy.context.scene)


def choose(target: bpy.types.Object, indices: np.ndarray) -> None:
    """Select these Gaussians alone."""
    chosen = np.zeros(len(target.data.vertices), np.bool_)
    chosen[indices] = True
    masks.select(target, chosen, extend=False)


def picture(gaussians, colors) -> np.ndarray:
    return ewa.render(gaussians, colors, CAMERA, opencv(POSE))


def test_what_was_removed_is_neither_drawn_nor_exported_and_comes_back(scene, added, gaussians, tmp_path):
    left = np.arange(60, 200)
    choose(added, np.arange(60))
    assert masks.treat_selected(added, Treatment.REMOVE) == 60
    kept = take(gaussians, left)
    expected = picture(kept, 1.0 - kept.base_colors)
    assert ewa.psnr(render_png(scene, tmp_path / "removed.png"), expected) > 50.0
    exported = read_gaussians(added, LAYER, 1.0).gaussians
    np.testing.assert_allclose(exported.means, kept.means)
    masks.take_all_back(added)
    expected = picture(gaussians, 1.0 - gaussians.base_colors)
    assert ewa.psnr(render_png(scene, tmp_path / "back.png"), expected) > 50.0
    assert not masks.has_masks(added)


def test_what_keeps_its_original_colours_shows_them_in_renders_and_exports(scene, added, gaussians, tmp_path):
    choose(added, np.arange(80))
    masks.treat_selected(added, Treatment.KEEP_ORIGINAL)
    choose(added, np.arange(20))
    masks.treat_selected(added, Treatment.RESTORE)
    colors = 1.0 - gaussians.base_colors
    colors[20:80] = gaussians.base_colors[20:80]
    assert ewa.psnr(render_png(scene, tmp_path / "image.png"), picture(gaussians, colors)) > 50.0
    exported = read_gaussians(added, LAYER, 1.0).gaussians
    np.testing.assert_allclose(exported.base_colors, colors, atol=1e-5)
    half = read_gaussians(added, LAYER, 0.5).gaussians.base_colors
    np.testing.assert_allclose(half, 0.5 * (gaussians.base_colors + colors), atol=1e-5)


def test_layers_can_be_added_where_gaussians_were_removed(shown, run_folder):
    choose(shown, np.arange(100))
    masks.treat_selected(shown, Treatment.REMOVE)
    (run_folder / "splats.tritan-0.5.ply").rename(run_folder / "splats.protan-1.0.ply")
    assert show_run(str(run_folder), bpy.context.scene) == shown
    assert "protan-1.0" in splats.layer_names(shown)


def test_a_colour_selects_those_that_differ_by_no_more_than_the_tolerance(added, gaussians):
    color = gaussians.base_colors[7]
    masks.select(added, masks.by_color(added, color, 0.2), extend=False)
    expected = np.abs(gaussians.base_colors - color).max(1) <= 0.2
    np.testing.assert_array_equal(masks.selected(added)[:200], expected)
    assert 1 < expected.sum() < 200


def test_a_selection_is_extended_but_not_by_what_was_removed(added):
    choose(added, np.arange(5))
    masks.treat_selected(added, Treatment.REMOVE)
    choose(added, np.arange(10, 15))
    everything = np.ones(len(added.data.vertices), np.bool_)
    assert masks.select(added, everything, extend=True) == 195, "neither the removed nor the frame's points"


def test_the_box_selects_whether_or_not_it_crops(added, gaussians):
    with pytest.raises(InputError, match="there is no crop box"):
        masks.by_box(added)
    box = crop.add_crop_box(added)
    box.matrix_basis = box.matrix_basis @ mathutils.Matrix.Scale(0.4, 4)
    bpy.context.view_layer.update()
    local = np.linalg.inv(np.array(box.matrix_world)) @ np.c_[gaussians.means, np.ones(200)].T
    inside = np.abs(local[:3]).max(axis=0) <= 1.0
    splats.set_input(added, "Crop", False)
    np.testing.assert_array_equal(masks.by_box(added)[:200], inside)
    assert 5 < inside.sum() < 195


def with_scores(folder, scores: np.ndarray) -> None:
    """Write a run's Gaussians anew, with scores."""
    path = folder / "splats.ply"
    write_ply(path, read_ply(path), scores)


def test_floaters_are_selected_by_the_scores_of_a_run_that_has_them(addon, run_folder):
    scores = np.linspace(0.0, 1.0, 400).astype(np.float32)
    assert read_run(run_folder).floaters is None
    with_scores(run_folder, scores)
    np.testing.assert_array_equal(read_floaters(run_folder / "splats.ply"), scores)
    shown = show_run(str(run_folder), bpy.context.scene)
    bpy.ops.cvdgs.select_floaters(least=0.75)
    assert shown.mode == "EDIT"
    bpy.ops.object.mode_set(mode="OBJECT")
    np.testing.assert_array_equal(masks.selected(shown)[:400], scores >= 0.75)


def test_floaters_are_removed_as_the_command_line_does_and_a_script_says_how_many(addon, run_folder):
    scores = np.linspace(0.0, 1.0, 400).astype(np.float32)
    with_scores(run_folder, scores)
    shown = show_run(str(run_folder), bpy.context.scene)
    before = read_gaussians(shown, "original", 1.0).gaussians
    bpy.ops.cvdgs.remove_floaters(amount=0.3)
    kept = kept_after(scores, 0.3)
    assert 0 < kept.sum() < 400
    np.testing.assert_array_equal(read_gaussians(shown, "original", 1.0).gaussians.means, before.means[kept])
    bpy.ops.cvdgs.remove_floaters(amount=0.0)
    assert len(read_gaussians(shown, "original", 1.0).gaussians) == kept.sum(), "none is removed; none comes back"
    bpy.ops.cvdgs.take_all_back()
    assert len(read_gaussians(shown, "original", 1.0).gaussians) == 400


def test_a_scene_of_floaters_alone_is_left_as_it_is(addon, run_folder):
    with_scores(run_folder, np.ones(400, np.float32))
    shown = show_run(str(run_folder), bpy.context.scene)
    with pytest.raises(RuntimeError, match="all its Gaussians would be removed - choose a smaller amount"):
        bpy.ops.cvdgs.remove_floaters(amount=0.5)
    assert not masks.has_masks(shown)


def test_without_scores_the_operator_says_so(shown):
    with pytest.raises(RuntimeError, match="has no floater scores - select by hand, colour or box"):
        bpy.ops.cvdgs.remove_floaters()
    with pytest.raises(RuntimeError, match="has no floater scores - select by hand, colour or box"):
        bpy.ops.cvdgs.select_floaters()


def test_nothing_is_selected_in_what_was_just_added_and_edit_mode_has_colours_to_show(added):
    assert not masks.selected(added).any(), "else Remove Selected would remove all of it"
    mesh = added.data
    assert mesh.attributes.active_color_name == Attribute.PREVIEW_COLOR
    assert Attribute.PREVIEW_COLOR in mesh.attributes, "black otherwise"


def test_points_are_chosen_in_edit_mode_with_blenders_tools_and_removed_there(shown):
    bpy.ops.cvdgs.edit_points()
    assert (bpy.context.mode, bpy.context.view_layer.objects.active) == ("EDIT_MESH", shown)
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.cvdgs.treat_selected(treatment="REMOVE")
    assert bpy.context.mode == "EDIT_MESH"
    bpy.ops.object.mode_set(mode="OBJECT")
    with pytest.raises(InputError, match="no Gaussians are left"):
        read_gaussians(shown, "original", 1.0)
    bpy.ops.cvdgs.take_all_back()
    assert len(read_gaussians(shown, "original", 1.0).gaussians) == 400


def edit(target: bpy.types.Object, half_side: float) -> None:
    """Select, in Edit Mode, all that can be selected in a cube around the middle."""
    bpy.ops.cvdgs.edit_points()
    points = bmesh.from_edit_mesh(target.data)
    for point in points.verts:
        point.select = max(map(abs, point.co)) < half_side and not point.hide
    bmesh.update_edit_mesh(target.data)


def of_an_earlier_release(target: bpy.types.Object) -> None:
    """Let the frame be in sight in Edit Mode, as it was once."""
    target.data.vertices.foreach_set("hide", np.zeros(len(target.data.vertices), np.bool_))


@pytest.mark.parametrize("prepare", [lambda target: None, of_an_earlier_release, masks.take_all_back])
def test_gaussians_that_nobody_touched_stay_as_they_are_when_others_are_moved(shown, prepare):
    prepare(shown)
    before = read_gaussians(shown, "original", 1.0).gaussians
    inside = np.abs(before.means).max(axis=1) < 0.5
    edit(shown, 0.5)
    bpy.ops.transform.translate(value=(0.0, 0.0, 1.0))
    bpy.ops.object.mode_set(mode="OBJECT")
    after = read_gaussians(shown, "original", 1.0).gaussians
    assert 5 < inside.sum() < 395
    np.testing.assert_allclose(after.means, before.means + np.where(inside[:, None], (0.0, 0.0, 1.0), 0.0), atol=1e-6)
    np.testing.assert_allclose(after.log_scales, before.log_scales, atol=1e-5)


def test_gaussians_that_are_left_keep_the_scale_that_was_applied_to_them(shown):
    shown.scale = (3.0, 3.0, 3.0)
    apply_transform(shown)
    before = read_gaussians(shown, "original", 1.0).gaussians
    left = np.abs(before.means).max(axis=1) >= 1.5
    edit(shown, 1.5)
    bpy.ops.mesh.delete(type="VERT")
    bpy.ops.object.mode_set(mode="OBJECT")
    after = read_gaussians(shown, "original", 1.0).gaussians
    np.testing.assert_allclose(after.log_scales, before.log_scales[left], atol=1e-5)


def test_revealing_in_edit_mode_brings_neither_the_frame_nor_what_was_removed_into_sight(shown):
    choose(shown, np.arange(5))
    bpy.ops.cvdgs.treat_selected(treatment="REMOVE")
    before = read_gaussians(shown, "original", 1.0).gaussians
    choose(shown, np.arange(5, 15))
    bpy.ops.cvdgs.edit_points()
    bpy.ops.mesh.hide()
    bpy.ops.mesh.reveal()
    assert np.flatnonzero([point.select for point in bmesh.from_edit_mesh(shown.data).verts]).tolist() == [
        *range(5, 15)
    ]
    assert sum(point.hide for point in bmesh.from_edit_mesh(shown.data).verts) == 5 + len(Frame)
    bpy.ops.transform.translate(value=(0.0, 0.0, 1.0))
    bpy.ops.object.mode_set(mode="OBJECT")
    after = read_gaussians(shown, "original", 1.0).gaussians
    np.testing.assert_allclose(after.log_scales, before.log_scales, atol=1e-5)
    np.testing.assert_allclose((after.means - before.means)[:10, 2], 1.0, atol=1e-6)
    np.testing.assert_array_equal(after.means[10:], before.means[10:])


def test_duplicates_do_not_keep_revealing_from_leaving_the_frame_out_of_sight(shown):
    """They come behind the frame, whose points were the last ones."""
    choose(shown, np.arange(5))
    bpy.ops.cvdgs.edit_points()
    bpy.ops.mesh.duplicate()
    bpy.ops.mesh.hide()
    bpy.ops.mesh.reveal()
    points = bmesh.from_edit_mesh(shown.data).verts
    numbers = points.layers.int[Attribute.FRAME]
    assert [point.hide for point in points if point[numbers]] == [True] * len(Frame)
    assert sum(point.hide for point in points) == len(Frame)


@pytest.mark.parametrize(
    ("treatment", "told"),
    [
        ("REMOVE", "Removed 5 Gaussians"),
        ("KEEP_ORIGINAL", "Kept original colours of 5 Gaussians"),
        ("RESTORE", "Restored layer colours of 5 Gaussians"),
    ],
)
def test_what_was_done_to_how_many_is_told(shown, treatment, told, capfd):
    choose(shown, np.arange(5))
    bpy.ops.cvdgs.treat_selected(treatment=treatment)
    assert told in capfd.readouterr().out


def test_nothing_selected_is_told(shown):
    choose(shown, np.arange(0))
    with pytest.raises(RuntimeError, match="no Gaussians are selected"):
        bpy.ops.cvdgs.treat_selected(treatment="REMOVE")
    bpy.ops.cvdgs.edit_points()
    with pytest.raises(RuntimeError, match="no Gaussians are selected"):
        bpy.ops.cvdgs.treat_selected(treatment="REMOVE")
    assert bpy.context.mode == "EDIT_MESH", "who edits goes on"
    assert not bpy.ops.cvdgs.take_all_back.poll()


@pytest.mark.parametrize("mode", ["OBJECT", "EDIT"])
def test_a_removal_can_be_undone(shown, mode):
    name = shown.name
    bpy.ops.cvdgs.edit_points()
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.object.mode_set(mode=mode)
    bpy.ops.ed.undo_push(message="chosen")
    bpy.ops.cvdgs.treat_selected(treatment="REMOVE")
    bpy.ops.ed.undo_push(message="removed")
    bpy.ops.ed.undo()
    if bpy.context.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    assert len(read_gaussians(bpy.data.objects[name], "original", 1.0).gaussians) == 400


# What looks for the middle of the Gaussians, and the light on them.
NEEDS_POINTS = ("add_turntable", "add_crop_box", "add_ruler", "place_capture", "add_marks", "add_catcher", "add_light")


@pytest.fixture
def beside_another(shown, tmp_path):
    """Gaussians for which all of `NEEDS_POINTS` is offered."""
    display = bpy.context.scene.cvdgs.display
    show_run(str(synthetic_run(tmp_path / "other")), bpy.context.scene)
    display.target, display.colors = shown, "SCENE_LINEAR"
    bpy.ops.cvdgs.set_up_render()
    return shown


def test_what_needs_the_points_asks_to_leave_edit_mode(beside_another):
    bpy.ops.cvdgs.edit_points()
    for name in NEEDS_POINTS:
        with pytest.raises(RuntimeError, match=r"^Error: run Gaussians: it is being edited - leave Edit Mode first$"):
            getattr(bpy.ops.cvdgs, name)()
    bpy.ops.object.mode_set(mode="OBJECT")
    assert {getattr(bpy.ops.cvdgs, name)() == {"FINISHED"} for name in NEEDS_POINTS} == {True}


def test_what_needs_the_points_says_that_all_were_deleted(beside_another):
    bpy.ops.cvdgs.edit_points()
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.mesh.delete(type="VERT")
    bpy.ops.object.mode_set(mode="OBJECT")
    for name in NEEDS_POINTS[:-1]:
        with pytest.raises(RuntimeError, match=r"^Error: run Gaussians: it has no points any more - load"):
            getattr(bpy.ops.cvdgs, name)()
    with pytest.raises(RuntimeError, match="too few flat Gaussians"):
        bpy.ops.cvdgs.add_light()


def test_the_panel_offers_it(shown):
    panel = drawn(CVDGS_PT_display)
    assert {"cvdgs.edit_points", "cvdgs.select_color", "cvdgs.select_floaters", "cvdgs.remove_floaters"} <= set(
        panel.operators
    )
    assert {"Remove Selected", "Keep Original Colours", "Use Layer's Colours"} <= set(panel.texts)
