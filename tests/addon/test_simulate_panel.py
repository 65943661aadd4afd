"""The sub-panel "Simulate": every property takes effect at once, and switching off leaves nothing."""

from __future__ import annotations

import bpy
import pytest

from cvdgs.cvdgs_addon.compositor.apply import simulation_node
from cvdgs.cvdgs_addon.compositor.scene_tree import scene_tree
from cvdgs.cvdgs_addon.compositor.simulation_group import Socket, chosen
from cvdgs.ui.viewer import CVDGS_PT_simulate

from .layouts import drawn


@pytest.fixture
def simulate(addon):
    bpy.context.scene.view_settings.view_transform = "Standard"
    return bpy.context.scene.cvdgs.simulate


def node() -> bpy.types.Node | None:
    return simulation_node(bpy.context.scene)


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
