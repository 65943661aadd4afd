"""The sub-panel "Simulate": every property takes effect at once, and switching off leaves nothing."""

from __future__ import annotations

import bpy
import pytest

from cvdgs.cvdgs_addon.compositor.apply import simulation_node
from cvdgs.cvdgs_addon.compositor.scene_tree import scene_tree
from cvdgs.cvdgs_addon.compositor.simulation_group import Socket, chosen
from cvdgs.cvdgs_addon.results import show_run
from cvdgs.cvdgs_addon.scene.splat_nodes import Input
from cvdgs.cvdgs_addon.scene.splats import get_input
from cvdgs.ui.viewer import CVDGS_PT_simulate

from .layouts import drawn


@pytest.fixture
def simulate(addon):
    bpy.context.scene.view_settings.view_transform = "Standard"
    return bpy.context.scene.cvdgs.simulate


def node() -> bpy.types.Node | None:
    return simulation_node(bpy.context.scene)


def add_object() -> None:
    """As an artist does, of which Blender tells its handlers."""
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("thing", None))
    bpy.context.view_layer.update()


def test_switching_on_and_off_leaves_the_scene_as_it_was(simulate):
    simulate.in_renders = True
    assert node() is not None
    simulate.in_viewport = True
    simulate.in_renders = False
    assert node() is not None
    assert not bpy.context.scene.render.use_compositing
    simulate.in_viewport = False
    assert scene_tree(bpy.context.scene) is None
    assert bpy.context.scene.render.use_compositing
    assert not [key for key in bpy.context.scene.keys() if key.startswith("cvdgs_")]  # noqa: SIM118 - not a dict


@pytest.mark.parametrize("view_transform", ["Standard", "AgX"])
@pytest.mark.parametrize("kind", ["EMPTY", "LINK_COPY", "FULL_COPY"])
def test_a_copy_of_the_scene_simulates_as_the_original_does(simulate, kind, view_transform):
    """EMPTY is what Blender calls "Copy Settings"; with AgX the view transform moves into the compositor."""
    scene = bpy.context.scene
    scene.view_settings.view_transform = view_transform
    simulate.in_renders = True
    during = scene.view_settings.view_transform
    bpy.ops.scene.new(type=kind)
    copy = bpy.context.scene
    add_object()
    assert node() is not None
    assert scene_tree(copy) != scene_tree(scene)
    assert copy.view_settings.view_transform == during
    copy.cvdgs.simulate.in_renders = False
    assert scene_tree(copy) is None
    assert copy.view_settings.view_transform == view_transform
    assert simulation_node(scene) is not None


def test_a_simulation_that_somebody_deletes_by_hand_stays_away(simulate):
    simulate.in_renders = True
    add_object()
    scene_tree(bpy.context.scene).nodes.remove(node())
    add_object()
    assert node() is None


def test_the_viewers_eyes_are_simulated_unless_others_are_chosen(simulate):
    viewer = bpy.context.scene.cvdgs.viewer
    simulate.in_renders = True
    viewer.cvd, viewer.severity, viewer.simulation = "protan", 0.5, "brettel"
    assert chosen(node(), Socket.TYPE) == "protan"
    assert chosen(node(), Socket.MODEL) == "brettel"
    assert node().inputs[Socket.SEVERITY].default_value == pytest.approx(0.5)
    simulate.cvd = "tritan"
    assert chosen(node(), Socket.TYPE) == "protan"
    simulate.same_as_viewer = False
    assert chosen(node(), Socket.TYPE) == "tritan"


def test_the_wipe_moves_the_border(simulate):
    simulate.in_renders = True
    assert node().inputs[Socket.WIPE].default_value == 0.0
    simulate.wipe, simulate.wipe_position = True, 0.3
    assert node().inputs[Socket.WIPE].default_value == pytest.approx(0.3)
    simulate.wipe = False
    assert node().inputs[Socket.WIPE].default_value == 0.0


def test_one_border_at_a_time(simulate):
    simulate.in_renders = simulate.wipe = True
    simulate.compare = True
    assert not simulate.wipe
    assert node().inputs[Socket.WIPE].default_value == 0.0, "both sides are seen with the observer's eyes"
    simulate.wipe = True
    assert not simulate.compare


def test_compare_shows_both_colours_as_the_observer_sees_them_and_ends_it(simulate, run_folder):
    assert not bpy.ops.cvdgs.compare.poll(), "there are no Gaussians"
    shown = show_run(str(run_folder), bpy.context.scene)
    assert bpy.ops.cvdgs.compare() == {"FINISHED"}
    assert (simulate.in_renders, simulate.in_viewport) == (True, True)
    simulate.wipe_position = 0.3
    assert get_input(shown, Input.COMPARE)
    assert get_input(shown, Input.BORDER) == pytest.approx(0.3)
    bpy.ops.cvdgs.compare()
    assert not get_input(shown, Input.COMPARE)
    assert node() is None


def test_gaussians_that_come_later_are_compared_too(simulate, run_folder):
    simulate.compare = True
    assert get_input(show_run(str(run_folder), bpy.context.scene), Input.COMPARE)


def test_the_operator_switches_both_on_and_off(simulate):
    assert bpy.ops.cvdgs.simulate() == {"FINISHED"}
    assert simulate.in_renders
    assert simulate.in_viewport
    bpy.ops.cvdgs.simulate()
    assert not simulate.in_renders
    assert node() is None


def test_the_asset_operator_tells_where_it_cannot_write(simulate, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(RuntimeError, match="cannot be written"):
        bpy.ops.cvdgs.save_simulation_asset(directory=str(tmp_path / "file"))
    assert bpy.ops.cvdgs.save_simulation_asset(directory=str(tmp_path)) == {"FINISHED"}
    assert list(tmp_path.glob("*.blend"))


def test_the_panel_tells_what_is_changed_and_what_the_model_lacks(simulate):
    scene = bpy.context.scene
    scene.view_settings.view_transform = "AgX"
    scene.cvdgs.viewer.cvd, scene.cvdgs.viewer.simulation = "tritan", "vienot"
    assert any("Brettel" in text for text in drawn(CVDGS_PT_simulate).texts)
    assert not any("AgX" in text for text in drawn(CVDGS_PT_simulate).texts)
    simulate.in_renders = True
    assert "View transform: AgX to Raw" in " ".join(drawn(CVDGS_PT_simulate).texts)


def test_the_panel_tells_what_the_simulation_leaves_out(simulate):
    bpy.context.scene.view_settings.gamma = 1.4
    assert "gamma" in " ".join(drawn(CVDGS_PT_simulate).texts)


@pytest.mark.parametrize("changed", ["viewer", "simulate"])
def test_a_script_changes_a_scene_that_is_not_the_open_one(simulate, run_folder, changed):
    other = bpy.data.scenes.new("Other")
    shown = show_run(str(run_folder), other)
    other.cvdgs.simulate.in_renders = True
    assert simulation_node(other) is not None
    assert node() is None
    if changed == "viewer":
        other.cvdgs.viewer.severity = 0.5
        assert simulation_node(other).inputs[Socket.SEVERITY].default_value == pytest.approx(0.5)
    else:
        other.cvdgs.simulate.wipe = True
        other.cvdgs.simulate.compare = True
        other.cvdgs.simulate.wipe_position = 0.25
        assert get_input(shown, Input.COMPARE)
        assert get_input(shown, Input.BORDER) == pytest.approx(0.25)
    assert node() is None
