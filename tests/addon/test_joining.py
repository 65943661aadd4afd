"""Two aligned runs become one object that can be worked with like any other; what it was made of stays, hidden."""

from __future__ import annotations

import json
import re

import bpy
import numpy as np
import pytest

from cvdgs.core.errors import InputError
from cvdgs.cvdgs_addon.export import read_gaussians
from cvdgs.cvdgs_addon.joining import join
from cvdgs.cvdgs_addon.results import show_run
from cvdgs.cvdgs_addon.scene.masks import Treatment, select, treat_selected
from cvdgs.cvdgs_addon.scene.placement import found_of, set_metres
from cvdgs.cvdgs_addon.scene.splat_attributes import Attribute, color_attribute, point_positions, write_attribute
from cvdgs.cvdgs_addon.scene.splats import add_gaussians, layer_names
from cvdgs.cvdgs_addon.scene.turntable import Turntable, add_turntable
from cvdgs.cvdgs_addon.shown import shown_splats
from cvdgs.ui.display import CVDGS_PT_display

from .layouts import drawn
from .scenes import cloud
from .test_alignment import apart, two  # noqa: F401 - fixtures
from .test_export import covariances, with_degree
from .test_neighbours import in_scene

ORIGINAL = "original"


@pytest.fixture
def joined(apart):  # noqa: F811
    """The two runs, aligned and joined by their buttons; and the two."""
    bpy.ops.cvdgs.align_photographs()
    assert "cvdgs.join_runs" in drawn(CVDGS_PT_display).operators
    assert bpy.ops.cvdgs.join_runs() == {"FINISHED"}
    return shown_splats(bpy.context), *apart


def standing(splats: bpy.types.Object, layer: str = ORIGINAL):
    """The Gaussians of an object in the scene's axes."""
    bpy.context.view_layer.update()
    return read_gaussians(splats, layer, 1.0, axes=splats.matrix_world).gaussians


def test_the_joined_gaussians_stand_where_those_of_both_runs_did(joined):
    made, first, second = joined
    assert made.name == "shop + window Gaussians"
    assert made.parent == first.parent
    both = [standing(first), standing(second)]
    found = standing(made)
    np.testing.assert_allclose(found.means, np.concatenate([part.means for part in both]), atol=1e-4)
    expected = np.concatenate([covariances(part) for part in both])
    np.testing.assert_allclose(covariances(found), expected, atol=1e-5)
    np.testing.assert_allclose(found.opacities, np.concatenate([part.opacities for part in both]), atol=1e-5)


def test_what_blender_joins_is_not_taken_for_one_run(apart):  # noqa: F811
    """Its *Join* moves the points of one run, but not the attributes that say how its Gaussians lie."""
    first, _ = apart
    for splats in apart:
        splats.select_set(True)
    bpy.context.view_layer.objects.active = first
    assert "Ctrl+J" not in " ".join(drawn(CVDGS_PT_display).texts)
    assert bpy.ops.object.join() == {"FINISHED"}
    bpy.context.scene.cvdgs.display.target = first
    told = " ".join(drawn(CVDGS_PT_display).texts)
    assert "Ctrl+J" in told
    assert "Join Runs" in told
    with pytest.raises(InputError, match=r"Ctrl\+J"):
        read_gaussians(first, ORIGINAL, 1.0)


@pytest.mark.parametrize("active", ["Gaussians", "mesh"])
def test_the_panel_tells_where_blender_joins_gaussians_with_a_mesh(addon, run_folder, active):
    """Of the two only the active one is drawn afterwards."""
    splats = show_run(str(run_folder), bpy.context.scene)
    bpy.ops.mesh.primitive_cube_add()
    splats.select_set(True)
    assert "Ctrl+J" not in " ".join(drawn(CVDGS_PT_display).texts)
    if active == "Gaussians":
        bpy.context.view_layer.objects.active = splats
    assert bpy.ops.object.join() == {"FINISHED"}
    assert "Ctrl+J" in " ".join(drawn(CVDGS_PT_display).texts)


def test_runs_that_are_rendered_apart_from_lit_objects_are_joined_in_the_artists_scene(apart):  # noqa: F811
    scene, first = bpy.context.scene, apart[0]
    scene.cvdgs.display.colors = "SCENE_LINEAR"
    assert bpy.ops.cvdgs.set_up_render() == {"FINISHED"}
    bpy.context.view_layer.update()
    assert first.users_collection[0].name not in scene.collection.children  # Blender sorts them by name
    bpy.ops.cvdgs.align_photographs()
    assert bpy.ops.cvdgs.join_runs() == {"FINISHED"}
    made = shown_splats(bpy.context)
    bpy.context.view_layer.update()
    assert made.name == "shop + window Gaussians"
    assert made.name in scene.objects
    assert "shop" in {found.name for found in made.users_collection}


def test_layers_of_the_same_name_are_one_and_others_keep_original_colours(two):  # noqa: F811
    first, second = two
    second.data.attributes.remove(second.data.attributes[color_attribute("tritan-0.5")])
    made = join(bpy.context.scene, first, second)
    assert layer_names(made) == [ORIGINAL, "deutan-1.0", "tritan-0.5"]
    for layer, of_second in (("deutan-1.0", "deutan-1.0"), ("tritan-0.5", ORIGINAL)):
        expected = np.concatenate([standing(first, layer).base_colors, standing(second, of_second).base_colors])
        np.testing.assert_allclose(standing(made, layer).base_colors, expected, atol=1e-5)


def test_what_it_was_made_of_is_hidden_and_a_third_run_is_not(joined):
    made, first, second = joined
    assert not made.hide_render
    for source in (first, second):
        assert source.hide_render
        assert source.hide_get()
        assert len(point_positions(source.data)) == 400
    assert "cvdgs.join_runs" not in drawn(CVDGS_PT_display).operators
    assert not bpy.ops.cvdgs.join_runs.poll()


def test_removed_gaussians_stay_away_and_floater_scores_come_along(two):  # noqa: F811
    first, second = two
    scores = np.linspace(0.0, 1.0, len(first.data.vertices)).astype(np.float32)
    write_attribute(first.data, Attribute.FLOATER, "FLOAT", scores)
    chosen = np.zeros(len(first.data.vertices), np.bool_)
    chosen[:100] = True
    select(first, chosen, extend=False)
    treat_selected(first, Treatment.REMOVE)
    made = join(bpy.context.scene, first, second)
    assert len(standing(made)) == 700
    kept = np.empty(len(made.data.vertices), np.float32)
    made.data.attributes[Attribute.FLOATER].data.foreach_get("value", kept)
    np.testing.assert_array_equal(kept[:300], scores[100:400])
    assert not kept[300:].any()


def test_view_dependent_colours_turn_with_the_run_that_was_turned(addon):
    scene = bpy.context.scene
    plain = add_gaussians(cloud(30), {}, scene.collection, "plain")
    shining = add_gaussians(with_degree(cloud(40, seed=1), 2), {}, scene.collection, "shining")
    shining.rotation_euler.x = 1.0
    made = join(scene, plain, shining)
    found, expected = standing(made), standing(shining)
    assert found.sh_degree == 2
    assert np.abs(found.sh[:30, 1:]).max() < 1e-6
    np.testing.assert_allclose(found.sh[30:], expected.sh, atol=1e-5)
    assert np.abs(expected.sh[:, 1:] - read_gaussians(shining, ORIGINAL, 1.0).gaussians.sh[:, 1:]).max() > 0.05


def test_metres_of_the_run_that_knows_them_are_those_of_the_joined_one(apart):  # noqa: F811
    _, second = apart
    set_metres(second.parent, 0.5)
    bpy.ops.cvdgs.align_photographs()
    bpy.ops.cvdgs.join_runs()
    assert found_of(shown_splats(bpy.context).parent).metres_per_unit == 0.5


def test_it_is_saved_turned_and_exported_like_any_run(joined, tmp_path):
    made, *_ = joined
    before = in_scene(made)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "file.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "file.blend"))
    made = shown_splats(bpy.context)
    assert made.name == "shop + window Gaussians"
    np.testing.assert_array_equal(in_scene(made), before)
    add_turntable(bpy.context.scene, made, Turntable(frames=4))
    assert bpy.ops.cvdgs.export_web_page(filepath=str(tmp_path / "page.html")) == {"FINISHED"}
    page = json.loads(re.search('id="scene">(.*?)</script>', (tmp_path / "page.html").read_text("utf-8"))[1])
    assert page["count"] == 800
    assert [layer["name"] for layer in page["layers"]] == [ORIGINAL, "deutan-1.0", "tritan-0.5"]
    assert bpy.ops.cvdgs.export_gaussians(filepath=str(tmp_path / "both.ply")) == {"FINISHED"}


def test_joining_can_be_undone(apart):  # noqa: F811
    bpy.ops.cvdgs.align_photographs()
    bpy.ops.ed.undo_push(message="aligned")
    bpy.ops.cvdgs.join_runs()
    bpy.ops.ed.undo_push(message="joined")
    bpy.ops.ed.undo()
    assert "shop + window Gaussians" not in bpy.data.objects
    for name in ("shop Gaussians", "window Gaussians"):
        assert not bpy.data.objects[name].hide_render
        assert not bpy.data.objects[name].hide_get()
