"""Putting the CVD simulation into a scene's compositor and taking it out again."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from cvdgs.core.color.matrices import linear_simulation
from cvdgs.cvdgs_addon.compositor.apply import (
    Simulation,
    remove_simulation,
    renders_can_go_without,
    show_simulation,
    simulation_node,
    use_simulation,
)
from cvdgs.cvdgs_addon.compositor.scene_tree import NODE_NAME, ensure_tree, output_socket, scene_tree

from .pictures import composited, feed_picture, random_picture
from .scenes import read_png
from .test_simulation_node import decoded, encoded

DEUTAN = linear_simulation("deutan", 1.0).matrix
EIGHT_BITS = 1.0 / 255.0


@pytest.fixture
def fresh_scene():
    bpy.ops.wm.read_homefile(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"  # with EEVEE, Blender aborts where there is no OpenGL
    return scene


def shown(scene: bpy.types.Scene, folder) -> np.ndarray:
    """(H, W, 3) what the screen shows of the render: after the view transform."""
    settings = scene.render.image_settings
    if bpy.app.version >= (5, 0):
        settings.media_type = "IMAGE"
    settings.file_format, settings.color_mode, settings.color_depth = "PNG", "RGB", "8"
    scene.render.dither_intensity = 0.0
    scene.render.filepath = str(folder / "shown.png")
    bpy.ops.render.render(write_still=True)
    return read_png(folder / "shown.png")


def structure(tree: bpy.types.NodeTree) -> tuple[set[str], set[tuple[str, str, str, str]]]:
    """Nodes and links of a tree, by name."""
    links = {
        (link.from_node.name, link.from_socket.name, link.to_node.name, link.to_socket.name) for link in tree.links
    }
    return {node.name for node in tree.nodes}, links


def artists_tree(scene: bpy.types.Scene) -> bpy.types.NodeTree:
    """A compositor as an artist may have it: a picture through an exposure to output and viewer."""
    image = feed_picture(scene, random_picture())
    tree = image.id_data
    if "cvdgs_made" in tree:
        del tree["cvdgs_made"]
    exposure, viewer = tree.nodes.new("CompositorNodeExposure"), tree.nodes.new("CompositorNodeViewer")
    exposure.inputs["Exposure"].default_value = 0.0
    tree.links.new(image.outputs["Image"], exposure.inputs["Image"])
    tree.links.new(exposure.outputs["Image"], output_socket(tree))
    tree.links.new(exposure.outputs["Image"], viewer.inputs["Image"])
    return tree


@pytest.mark.parametrize("view_transform", ["AgX", "Filmic", "Standard", "Raw"])
@pytest.mark.parametrize("exposure", [0.0, 0.7])
def test_what_the_screen_shows_is_what_is_simulated(fresh_scene, tmp_path, view_transform, exposure):
    """With any view transform: first the render as it is shown, then the same as it is seen."""
    if view_transform == "Raw" and exposure:
        pytest.skip("screen values that are changed once more")
    fresh_scene.view_settings.view_transform = view_transform
    fresh_scene.view_settings.exposure = exposure
    feed_picture(fresh_scene, random_picture())
    before = shown(fresh_scene, tmp_path)
    show_simulation(fresh_scene, Simulation("deutan", 1.0))
    expected = encoded((decoded(before) @ DEUTAN.T).clip(0.0, 1.0))
    # Eight bits before and after; the matrix at most doubles an error, and the slope of dark values adds to it.
    assert np.abs(shown(fresh_scene, tmp_path) - expected).max() < 5.0 * EIGHT_BITS
    remove_simulation(fresh_scene)
    assert fresh_scene.view_settings.view_transform == view_transform
    assert fresh_scene.view_settings.exposure == pytest.approx(exposure)


def test_a_scene_without_compositor_gets_one_and_loses_it_again(fresh_scene):
    fresh_scene.view_settings.view_transform = "Standard"
    show_simulation(fresh_scene, Simulation())
    node = simulation_node(fresh_scene)
    assert node.inputs["Image"].links[0].from_node.bl_idname == "CompositorNodeRLayers"
    assert output_socket(scene_tree(fresh_scene)).links[0].from_node == node
    remove_simulation(fresh_scene)
    assert scene_tree(fresh_scene) is None
    assert not [
        tree for tree in bpy.data.node_groups if tree.bl_idname == "CompositorNodeTree" and "cvdgs_made" in tree
    ]


def test_the_compositor_comes_and_goes_as_often_as_the_simulation(fresh_scene):
    fresh_scene.view_settings.view_transform = "Standard"
    for _ in range(3):
        show_simulation(fresh_scene, Simulation())
        assert renders_can_go_without(fresh_scene)
        remove_simulation(fresh_scene)
        assert scene_tree(fresh_scene) is None


def test_an_artists_compositor_is_left_as_it_was(fresh_scene, tmp_path):
    fresh_scene.view_settings.view_transform = "AgX"
    tree = artists_tree(fresh_scene)
    before, pixels = structure(tree), composited(fresh_scene, tmp_path)
    show_simulation(fresh_scene, Simulation("protan", 0.6))
    node = simulation_node(fresh_scene)
    assert {link.to_node.bl_idname for link in node.outputs["Image"].links} >= {"CompositorNodeViewer"}
    assert len(node.outputs["Image"].links) == 2
    assert not renders_can_go_without(fresh_scene)
    remove_simulation(fresh_scene)
    assert structure(tree) == before
    np.testing.assert_array_equal(composited(fresh_scene, tmp_path), pixels)


@pytest.mark.skipif(bpy.app.version >= (5, 0), reason="a compositor is not switched off but taken away")
@pytest.mark.parametrize("is_used", [False, True])
def test_a_compositor_that_was_switched_off_is_so_again(fresh_scene, is_used):
    fresh_scene.use_nodes = True
    tree = artists_tree(fresh_scene)
    fresh_scene.use_nodes = is_used
    before = structure(tree)
    show_simulation(fresh_scene, Simulation())
    show_simulation(fresh_scene, Simulation(severity=0.5))
    assert fresh_scene.use_nodes
    remove_simulation(fresh_scene)
    assert fresh_scene.use_nodes == is_used
    assert structure(fresh_scene.node_tree) == before


def insert_glare(tree: bpy.types.NodeTree, link: bpy.types.NodeLink) -> bpy.types.Node:
    """Put a node called "mine" into a link of the tree, as an artist does; returns the node."""
    source, target = link.from_socket, link.to_socket
    glare = tree.nodes.new("CompositorNodeGlare")
    glare.name = "mine"
    tree.links.new(source, glare.inputs["Image"])
    tree.links.new(glare.outputs["Image"], target)
    return glare


@pytest.mark.parametrize("view_transform", ["AgX", "Standard"])
@pytest.mark.parametrize("place", ["before it", "in it", "after it"])
def test_nodes_that_somebody_adds_to_the_simulations_compositor_stay(fresh_scene, view_transform, place):
    """Wherever they were put: with AgX the simulation is a chain of nodes."""
    fresh_scene.view_settings.view_transform = view_transform
    show_simulation(fresh_scene, Simulation())
    use_simulation(fresh_scene, in_renders=True, in_viewport=True)
    tree, node = scene_tree(fresh_scene), simulation_node(fresh_scene)
    (layers,) = (found for found in tree.nodes if found.bl_idname == "CompositorNodeRLayers")
    link = {
        "before it": layers.outputs["Image"].links[0],
        "in it": node.inputs["Image"].links[0],
        "after it": node.outputs["Image"].links[0],
    }[place]
    insert_glare(tree, link)
    assert not renders_can_go_without(fresh_scene)
    use_simulation(fresh_scene, in_renders=False, in_viewport=True)
    assert fresh_scene.render.use_compositing
    remove_simulation(fresh_scene)
    assert scene_tree(fresh_scene) == tree
    assert fresh_scene.render.use_compositing
    output = output_socket(tree).node.name
    assert structure(tree) == (
        {layers.name, "mine", output},
        {(layers.name, "Image", "mine", "Image"), ("mine", "Image", output, "Image")},
    )
    show_simulation(fresh_scene, Simulation())
    remove_simulation(fresh_scene)
    assert "mine" in scene_tree(fresh_scene).nodes


def test_a_compositor_whose_added_nodes_were_deleted_goes_with_the_simulation(fresh_scene):
    show_simulation(fresh_scene, Simulation())
    tree = scene_tree(fresh_scene)
    glare = tree.nodes.new("CompositorNodeGlare")
    remove_simulation(fresh_scene)
    tree.nodes.remove(glare)
    show_simulation(fresh_scene, Simulation())
    remove_simulation(fresh_scene)
    assert scene_tree(fresh_scene) is None


def test_changing_what_is_simulated_changes_the_node_that_is_there(fresh_scene):
    first = show_simulation(fresh_scene, Simulation("deutan", 1.0))
    second = show_simulation(fresh_scene, Simulation("tritan", 0.5, untouched=0.5))
    assert first == second
    assert [node.name for node in scene_tree(fresh_scene).nodes].count(NODE_NAME) == 1
    assert second.inputs["Severity"].default_value == 0.5


def shadings_of_views() -> list[bpy.types.View3DShading]:
    """Of all 3D views."""
    areas = [area for screen in bpy.data.screens for area in screen.areas]
    return [space.shading for area in areas for space in area.spaces if space.type == "VIEW_3D"]


def test_the_viewport_alone_can_show_it(fresh_scene):
    """The empty start file has a 3D view, in background too."""
    fresh_scene.view_settings.view_transform = "Standard"
    show_simulation(fresh_scene, Simulation())
    use_simulation(fresh_scene, in_renders=False, in_viewport=True)
    assert not fresh_scene.render.use_compositing
    shadings = shadings_of_views()
    assert shadings
    assert {shading.use_compositor for shading in shadings} == {"ALWAYS"}
    use_simulation(fresh_scene, in_renders=True, in_viewport=False)
    assert fresh_scene.render.use_compositing
    assert {shading.use_compositor for shading in shadings} == {"DISABLED"}


def test_the_viewport_is_as_it_was_when_the_last_scene_needs_it_no_more(fresh_scene):
    second = bpy.data.scenes.new("second")
    shadings = shadings_of_views()
    before = [shading.use_compositor for shading in shadings]
    for scene in (fresh_scene, second):
        show_simulation(scene, Simulation())
        use_simulation(scene, in_renders=False, in_viewport=True)
    remove_simulation(fresh_scene)
    assert {shading.use_compositor for shading in shadings} == {"ALWAYS"}
    remove_simulation(second)
    assert [shading.use_compositor for shading in shadings] == before


def test_renders_keep_a_compositor_that_holds_the_view_transform(fresh_scene, tmp_path):
    """Without it they would come out untransformed."""
    fresh_scene.view_settings.view_transform = "AgX"
    feed_picture(fresh_scene, random_picture())
    show_simulation(fresh_scene, Simulation())
    use_simulation(fresh_scene, in_renders=False, in_viewport=True)
    assert fresh_scene.render.use_compositing
    assert not renders_can_go_without(fresh_scene)


def test_a_tree_without_output_gets_one(fresh_scene):
    tree = ensure_tree(fresh_scene)
    assert len(tree.nodes) == 0
    show_simulation(fresh_scene, Simulation())
    assert output_socket(tree).is_linked


def test_saving_and_loading_keeps_the_simulation_and_what_it_changed(fresh_scene, tmp_path):
    fresh_scene.view_settings.view_transform = "AgX"
    show_simulation(fresh_scene, Simulation("tritan", 0.3))
    assert fresh_scene.view_settings.view_transform == "Raw"
    path = str(tmp_path / "scene.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    scene = bpy.context.scene
    assert simulation_node(scene).inputs["Severity"].default_value == pytest.approx(0.3)
    remove_simulation(scene)
    assert scene.view_settings.view_transform == "AgX"
