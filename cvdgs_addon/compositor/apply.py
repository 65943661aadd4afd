"""Puts the CVD simulation between a scene's picture and its output, and takes it away again."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import bpy

from ..scene.remembered_settings import change_settings, changes, restore_settings
from ..scene.render_settings import SIMULATION_VIEW
from .apart import arrange
from .display_nodes import Picture, add_display_nodes, picture_kind, raw_view
from .scene_tree import (
    DISPLAY_NODE,
    NODE_NAME,
    ensure_tree,
    is_ours,
    leave_tree,
    output_socket,
    picture_source,
    scene_tree,
    viewers_of,
)
from .simulation_group import GROUP_NAME, Socket, choose, simulation_group

_RENDER, _VIEWPORTS = "cvdgs_simulation_render", "cvdgs_simulation_viewports"
_SPACING = 220.0  # between nodes


@dataclass(frozen=True)
class Simulation:
    """What to simulate.

    Attributes:
        cvd: "protan", "deutan", "tritan" or "achromat".
        severity: 0 to 1.
        model: "machado", "vienot" or "brettel".
        untouched: share of the picture's width, from the left, that stays as it is.
    """

    cvd: str = "deutan"
    severity: float = 1.0
    model: str = "machado"
    untouched: float = 0.0


def apply_simulation(scene: bpy.types.Scene) -> None:
    """Put in force what ``scene.cvdgs.simulate`` says of renders and 3D views."""
    simulate = scene.cvdgs.simulate
    chosen = scene.cvdgs.viewer if simulate.same_as_viewer else simulate
    untouched = simulate.wipe_position if simulate.wipe else 0.0
    if simulate.in_renders or simulate.in_viewport:
        show_simulation(scene, Simulation(chosen.cvd, chosen.severity, chosen.simulation, untouched))
        use_simulation(scene, in_renders=simulate.in_renders, in_viewport=simulate.in_viewport)
    else:
        remove_simulation(scene)


@contextmanager
def simulation_lifted(scene: bpy.types.Scene) -> Iterator[None]:
    """For changes of the view transform: the simulation is away within the block, and back for the new one after.

    What stands among the Gaussians is rendered apart from then on where the new settings are for lamps, and only there.
    """
    remove_simulation(scene)
    try:
        yield
    finally:
        arrange(scene)
        apply_simulation(scene)


def show_simulation(scene: bpy.types.Scene, simulation: Simulation) -> bpy.types.Node:
    """Put the simulation into the scene's compositor, or change the one that is there.

    Where the view transform is more than an encoding it moves into the compositor (see `display_nodes`).
    """
    node = simulation_node(scene) or _insert(scene)
    choose(node, Socket.TYPE, simulation.cvd)
    choose(node, Socket.MODEL, simulation.model)
    node.inputs[Socket.SEVERITY].default_value = simulation.severity
    node.inputs[Socket.WIPE].default_value = simulation.untouched
    return node


def use_simulation(scene: bpy.types.Scene, *, in_renders: bool, in_viewport: bool) -> None:
    """Choose where a simulation that is there is seen.

    Renders go without only where the compositor does nothing else (see `renders_can_go_without`).
    """
    restore_settings(scene, _RENDER)
    if in_renders or renders_can_go_without(scene):
        change_settings(scene, _RENDER, {"render.use_compositing": in_renders})
    _composite_viewports(scene, in_viewport)


def renders_can_go_without(scene: bpy.types.Scene) -> bool:
    """Whether the viewport alone can show the simulation: where the compositor does nothing else.

    Renders need it beside nodes of the artist's own, and where the view transform has moved into it.
    """
    tree = scene_tree(scene)
    return SIMULATION_VIEW not in scene and (tree is None or is_ours(tree))


def remove_simulation(scene: bpy.types.Scene) -> None:
    """Take the simulation away, with all that `show_simulation` and `use_simulation` changed."""
    node = simulation_node(scene)
    if node is not None:
        _take_out(scene_tree(scene), node)
    tree = scene_tree(scene)
    if tree is not None:
        leave_tree(scene, tree)
    restore_settings(scene, SIMULATION_VIEW)
    restore_settings(scene, _RENDER)
    _composite_viewports(scene, False)


def simulation_node(scene: bpy.types.Scene) -> bpy.types.Node | None:
    """The node that `show_simulation` put there."""
    tree = scene_tree(scene)
    return tree.nodes.get(NODE_NAME) if tree is not None else None


def told_changes(scene: bpy.types.Scene) -> Iterator[str]:
    """The settings of `scene` that the simulation changed and `remove_simulation` will restore, in words."""
    for purpose in (SIMULATION_VIEW, _RENDER):
        yield from changes(scene, purpose)


def _insert(scene: bpy.types.Scene) -> bpy.types.Node:
    group = simulation_group()  # refuses before anything is changed
    tree = ensure_tree(scene)
    output = output_socket(tree)
    source = picture_source(tree, output)
    targets = [output, *viewers_of(tree, source)]
    kind = picture_kind(scene)
    before = add_display_nodes(tree, scene) if kind is Picture.CONVERTED else []
    for index, display in enumerate(before):
        display.name = f"{DISPLAY_NODE} {index}"
    node = tree.nodes.new("CompositorNodeGroup")
    node.node_tree = group
    node.name, node.label = NODE_NAME, GROUP_NAME
    node.inputs[Socket.DISPLAY_REFERRED].default_value = kind is not Picture.SCENE_LINEAR
    picture = source
    for number, following in enumerate([*before, node], start=1):
        following.location = (source.node.location.x + (number + 0.5) * _SPACING, source.node.location.y - _SPACING)
        tree.links.new(picture, following.inputs["Image"])
        picture = following.outputs["Image"]
    for target in targets:
        tree.links.new(picture, target)
    if kind is Picture.CONVERTED:
        change_settings(scene, SIMULATION_VIEW, raw_view())
    return node


def _take_out(tree: bpy.types.NodeTree, node: bpy.types.Node) -> None:
    """Remove our nodes and let the picture go where theirs went; what somebody put between them stays."""
    for ours in [found for found in tree.nodes if found == node or found.name.startswith(DISPLAY_NODE)]:
        source = ours.inputs["Image"].links[0].from_socket if ours.inputs["Image"].is_linked else None
        targets = [link.to_socket for link in ours.outputs["Image"].links] if source is not None else []
        for target in targets:
            tree.links.new(source, target)
        tree.nodes.remove(ours)


def _composite_viewports(scene: bpy.types.Scene, on: bool) -> None:
    """Let 3D views show the compositor's result, or as they did before if no other scene has them show it."""
    before = _views_before(scene)
    others: dict[str, str] = {}
    for other in bpy.data.scenes:
        others |= _views_before(other) if other != scene else {}
    for place, shading in _viewport_shadings():
        if on and place not in before:
            before[place] = others.get(place, shading.use_compositor)
            shading.use_compositor = "ALWAYS"
        elif not on and place in before and place not in others:
            shading.use_compositor = before[place]
    if on:
        scene[_VIEWPORTS] = json.dumps(before)
    elif _VIEWPORTS in scene:
        del scene[_VIEWPORTS]


def _views_before(scene: bpy.types.Scene) -> dict[str, str]:
    """How 3D views were, by their place, before `scene` had them show the compositor's result."""
    before: dict[str, str] = json.loads(scene.get(_VIEWPORTS) or "{}")
    return before


def _viewport_shadings() -> Iterator[tuple[str, bpy.types.View3DShading]]:
    """The shading of every 3D view, and where that is."""
    for screen in bpy.data.screens:
        for index, area in enumerate(screen.areas):
            for space in area.spaces:
                if space.type == "VIEW_3D":
                    yield f"{screen.name}/{index}", space.shading
