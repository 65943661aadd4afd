"""A scene's compositor tree in either generation of Blender's API: where its picture comes from and goes to."""

from __future__ import annotations

import bpy

_HAS_GROUPS = bpy.app.version >= (5, 0)  # before, the tree belongs to the scene and ends in a Composite node
_OUTPUT = "NodeGroupOutput" if _HAS_GROUPS else "CompositorNodeComposite"
_SOURCE, _VIEWER = "CompositorNodeRLayers", "CompositorNodeViewer"
_TREE_NAME = "CVD Compositor"
_OURS = "cvdgs_made"  # custom property of a tree that `ensure_tree` made
_SWITCHED_ON = "cvdgs_switched_on"  # and of one whose *Use Nodes* it ticked

NODE_NAME = "CVD simulation (add-on)"
"""The node that simulates (see `apply`)."""
DISPLAY_NODE = "CVD display (add-on)"
"""What the names of nodes begin with that bring the view transform before the simulation."""
APART_NODE = "CVD objects apart (add-on)"
"""The node that brings what is rendered apart into the picture (see `apart`)."""


def scene_tree(scene: bpy.types.Scene) -> bpy.types.NodeTree | None:
    """The compositor tree in force, if there is one."""
    if _HAS_GROUPS:
        return scene.compositing_node_group
    return scene.node_tree if scene.use_nodes else None


def ensure_tree(scene: bpy.types.Scene) -> bpy.types.NodeTree:
    """The compositor tree in force; where there is none, a new one that shows the render as it is."""
    tree = scene_tree(scene)
    if tree is not None:
        return tree
    if _HAS_GROUPS:
        tree = scene.compositing_node_group = bpy.data.node_groups.new(_TREE_NAME, "CompositorNodeTree")
    else:
        had_nodes = scene.node_tree is not None and len(scene.node_tree.nodes) > 0
        scene.use_nodes = True
        tree = scene.node_tree
        if had_nodes:
            tree[_SWITCHED_ON] = True  # somebody's
            return tree
        tree.nodes.clear()
    tree[_OURS] = True
    return tree


def is_ours(tree: bpy.types.NodeTree) -> bool:
    """Whether `ensure_tree` made the tree, and it holds nothing but the render, the simulation and the output.

    Not where somebody has added a node since, nor where the tree brings something into the picture.
    """
    return bool(tree.get(_OURS)) and all(
        node.bl_idname in (_OUTPUT, _SOURCE) or node.name == NODE_NAME or node.name.startswith(DISPLAY_NODE)
        for node in tree.nodes
    )


def leave_tree(scene: bpy.types.Scene, tree: bpy.types.NodeTree) -> None:
    """Undo `ensure_tree` where none of the nodes that it was needed for is left in the tree of `scene`."""
    if is_ours(tree):
        _remove_tree(scene, tree)
    elif tree.get(_SWITCHED_ON) and not any(name in tree.nodes for name in (NODE_NAME, APART_NODE)):
        del tree[_SWITCHED_ON]
        scene.use_nodes = False


def _remove_tree(scene: bpy.types.Scene, tree: bpy.types.NodeTree) -> None:
    """Leave `scene` without the tree that `ensure_tree` made for it."""
    if _HAS_GROUPS:
        bpy.data.node_groups.remove(tree)
        return
    tree.nodes.clear()
    del tree[_OURS]
    scene.use_nodes = False


def output_socket(tree: bpy.types.NodeTree) -> bpy.types.NodeSocket:
    """What the picture that is rendered or shown goes into, made where it is missing."""
    outputs = [node for node in tree.nodes if node.bl_idname == _OUTPUT]
    if _HAS_GROUPS and not any(_is_image_output(item) for item in tree.interface.items_tree):
        tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    output = next((node for node in outputs if getattr(node, "is_active_output", True)), None)
    if output is None:
        output = outputs[0] if outputs else tree.nodes.new(_OUTPUT)
    return next(socket for socket in output.inputs if socket.type == "RGBA")


def picture_source(tree: bpy.types.NodeTree, output: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    """What feeds `output`; where nothing does, a new Render Layers node."""
    if output.is_linked:
        return output.links[0].from_socket
    layers = next((node for node in tree.nodes if node.bl_idname == _SOURCE), None) or tree.nodes.new(_SOURCE)
    return layers.outputs["Image"]


def viewers_of(tree: bpy.types.NodeTree, source: bpy.types.NodeSocket) -> list[bpy.types.NodeSocket]:
    """Inputs of Viewer nodes that `source` feeds: viewports may show those instead of the output."""
    links = [link for link in tree.links if link.to_node.bl_idname == _VIEWER]
    return [link.to_socket for link in links if link.from_socket == source]


def _is_image_output(item: bpy.types.NodeTreeInterfaceItem) -> bool:
    return item.item_type == "SOCKET" and item.in_out == "OUTPUT" and item.socket_type == "NodeSocketColor"
