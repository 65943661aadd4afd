"""Puts together the pictures of objects and of Gaussians that are rendered apart (see `scene.apart`)."""

from __future__ import annotations

import bpy

from ..scene.apart import (
    COVERAGE_LAYER,
    GAUSSIANS_LAYER,
    OBJECTS_LAYER,
    follows_another,
    gaussians_scene,
    is_apart,
    objects_scene,
    put_together,
    take_apart,
)
from ..scene.display import render_changes
from ..scene.nodes import NodeWriter, Sockets, Value
from ..scene.remembered_settings import change_settings, restore_settings
from ..scene.render_settings import Display, display_of
from ..scene.splats import is_splats
from .scene_tree import APART_NODE, ensure_tree, leave_tree, output_socket, picture_source, scene_tree

_PICTURE = "CVD objects over Gaussians"
_RENDER = "cvdgs_apart_render"
_OPAQUE = 0.9999
_EDGE = 8  # pixels at most between an object's edge and the Gaussians beside it
_HAS_INPUTS = bpy.app.version >= (5, 0)  # before, options of these nodes were no sockets


def arrange(scene: bpy.types.Scene) -> None:
    """Render objects and Gaussians of `scene` apart where Cycles is set up for lamps, else together."""
    wanted = (
        scene.render.engine == "CYCLES"
        and display_of(scene) is Display.SCENE_LINEAR
        and any(render_changes(scene))
        and any(map(is_splats, scene.objects))
    )
    if wanted and is_apart(scene) and _is_joined(scene):
        return
    _take_out(scene)
    if wanted:
        take_apart(scene)
        _insert(scene)
    else:
        put_together(scene)


def _is_joined(scene: bpy.types.Scene) -> bool:
    tree = scene_tree(scene)
    return tree is not None and APART_NODE in tree.nodes


def _insert(scene: bpy.types.Scene) -> None:
    """Add what is rendered apart to what `scene` renders itself, which is nothing; in 3D views it is the other way."""
    tree = ensure_tree(scene)
    output = output_socket(tree)
    own = next((node for node in tree.nodes if _renders(node, scene)), None)
    source = own.outputs["Image"] if own is not None else picture_source(tree, output)
    targets = [link.to_socket for link in source.links] or [output]
    write = NodeWriter(tree)
    lit, shown = objects_scene(scene), gaussians_scene(scene)
    layers = {
        name: write.node("CompositorNodeRLayers", scene=helper, layer=name)
        for name, helper in ((GAUSSIANS_LAYER, shown), (OBJECTS_LAYER, lit), (COVERAGE_LAYER, lit))
    }
    pictures = {name: node.outputs["Image"] for name, node in layers.items()}
    joined = write.nested(_PICTURE, _join, pictures)["Picture"]
    node = write.node("ShaderNodeVectorMath", source, joined, operation="ADD")
    node.name, node.label = APART_NODE, _PICTURE
    made = [*layers.values(), joined.node, node]
    for number, placed in enumerate(made):
        placed.location = (
            source.node.location.x + 180.0 * max(0, number - 2),
            source.node.location.y - 300.0 * (number + 1),
        )
    for target in targets:
        tree.links.new(node.outputs["Vector"], target)
    change_settings(scene, _RENDER, {"render.use_compositing": True})


def _take_out(scene: bpy.types.Scene) -> None:
    restore_settings(scene, _RENDER)
    tree = scene_tree(scene)
    node = tree.nodes.get(APART_NODE) if tree is not None else None
    if tree is None or node is None:
        return
    targets = [link.to_socket for link in node.outputs["Vector"].links]
    source = node.inputs[0].links[0].from_socket if node.inputs[0].is_linked else None
    for target in targets if source is not None else ():
        tree.links.new(source, target)
    groups = [found for found in tree.nodes if _joins(found)]
    layers = [found for found in tree.nodes if _renders_part(found, groups)]
    made = {group.node_tree for group in groups}
    for ours in (node, *groups, *layers):
        tree.nodes.remove(ours)
    for group in made:
        if not group.users:
            bpy.data.node_groups.remove(group)
    leave_tree(scene, tree)


def _joins(node: bpy.types.Node) -> bool:
    """Whether `_insert` made the node, to put pictures together."""
    group = getattr(node, "node_tree", None)
    return group is not None and group.name.startswith(_PICTURE)


def _renders_part(node: bpy.types.Node, groups: list[bpy.types.Node]) -> bool:
    """Whether `_insert` made the node, to render what `groups` put together, whatever stands between them by now."""
    if node.bl_idname != "CompositorNodeRLayers":
        return False
    if node.scene is not None and follows_another(node.scene):
        return True
    return any(link.to_node in groups for link in node.outputs["Image"].links)  # its scene was deleted


def _renders(node: bpy.types.Node, scene: bpy.types.Scene) -> bool:
    return node.bl_idname == "CompositorNodeRLayers" and node.scene in (None, scene)


def _join(write: NodeWriter, pictures: Sockets) -> dict[str, Value]:
    """The Gaussians with their holes filled, behind the objects and their shadows, behind what stands before those.

    An object's alpha in the Gaussians' picture m is how much of it Gaussians hide, in one sample: at its edges, where
    it is partly covered, that of the pixels beside it is taken, and the Gaussians' colour likewise.
    """
    shown, lit, covered = (pictures[name] for name in (GAUSSIANS_LAYER, OBJECTS_LAYER, COVERAGE_LAYER))
    hidden, alpha, coverage = (
        write.output("CompositorNodeSeparateColor", picture, name="Alpha") for picture in (shown, lit, covered)
    )
    eroded = write.node("CompositorNodeDilateErode", hidden)
    filled = write.node("CompositorNodeInpaint", shown)
    if _HAS_INPUTS:
        eroded.inputs["Size"].default_value, filled.inputs["Size"].default_value = -1, _EDGE
    else:
        eroded.mode, eroded.distance, filled.distance = "STEP", -1, _EDGE
    inside = write.math("GREATER_THAN", coverage, _OPAQUE)
    before = write.mix("FLOAT", inside, eroded.outputs[0], hidden)
    share = write.math("DIVIDE", before, write.math("MAXIMUM", hidden, 1e-6))
    front = _scaled(write, shown, write.math("MULTIPLY", coverage, share))
    behind = _scaled(write, filled.outputs[0], write.math("SUBTRACT", 1.0, alpha))
    objects = _scaled(write, lit, write.math("SUBTRACT", 1.0, before))
    return {"Picture": write.vector_math("ADD", write.vector_math("ADD", behind, objects), front)}


def _scaled(write: NodeWriter, picture: Value, factor: Value) -> bpy.types.NodeSocket:
    node = write.node("ShaderNodeVectorMath", picture, operation="SCALE")
    write.feed(node.inputs["Scale"], factor)
    return node.outputs["Vector"]
