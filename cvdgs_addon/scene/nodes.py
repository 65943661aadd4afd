"""A thin writer for node trees, so that node groups read as formulae, and the inputs of their modifiers.

The same nodes in Blender 4.5 and 5.x; a modifier's inputs moved in Blender 5.2.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

import bpy

Value: TypeAlias = bpy.types.NodeSocket | bool | float | Sequence[float] | str | bpy.types.ID
"""What feeds an input: another node's output, or a constant."""


Sockets: TypeAlias = Mapping[str, bpy.types.NodeSocket]

# What declares a socket of a group, by the type of the sockets that it stands for.
_DECLARED = {
    "VALUE": "NodeSocketFloat",
    "INT": "NodeSocketInt",
    "BOOLEAN": "NodeSocketBool",
    "VECTOR": "NodeSocketVector",
    "RGBA": "NodeSocketColor",
    "MATRIX": "NodeSocketMatrix",
    "STRING": "NodeSocketString",
    "OBJECT": "NodeSocketObject",
    "GEOMETRY": "NodeSocketGeometry",
}
InputValue: TypeAlias = float | bool | str | bpy.types.Object | None


class NodeWriter:
    """Adds linked nodes to `tree`. Every method returns an output socket, which feeds the next call.

    Sockets are found among the *enabled* ones: nodes with a data type carry a hidden socket for every other type.
    """

    def __init__(self, tree: bpy.types.NodeTree) -> None:
        self.tree = tree

    def node(self, kind: str, *inputs: Value | None, **properties: Any) -> bpy.types.Node:
        """A node of type `kind` with `properties` set and its first inputs fed; None leaves an input at its default."""
        node = self.tree.nodes.new(kind)
        for name, value in properties.items():
            setattr(node, name, value)
        enabled = [socket for socket in node.inputs if socket.enabled]
        for socket, value in zip(enabled, inputs, strict=False):
            if value is not None:
                self.feed(socket, value)
        return node

    def feed(self, socket: bpy.types.NodeSocket, value: Value) -> None:
        """Link an output to `socket`, or set its constant."""
        if isinstance(value, bpy.types.NodeSocket):
            self.tree.links.new(value, socket)
        else:
            socket.default_value = value

    def output(self, kind: str, *inputs: Value | None, name: str = "", **properties: Any) -> bpy.types.NodeSocket:
        """The first enabled output of a new node, or the one whose name or identifier is `name`."""
        node = self.node(kind, *inputs, **properties)
        found = (socket for socket in node.outputs if socket.enabled)
        return next(socket for socket in found if name in ("", socket.name, socket.identifier))

    def math(self, operation: str, *values: Value) -> bpy.types.NodeSocket:
        """A scalar operation, e.g. ``math("MULTIPLY", a, 2.0)``."""
        return self.output("ShaderNodeMath", *values, operation=operation)

    def sum(self, *values: Value) -> bpy.types.NodeSocket:
        """Sum of two or more scalars."""
        total = values[0]
        for value in values[1:]:
            total = self.math("ADD", total, value)
        return total

    def product(self, *values: Value) -> bpy.types.NodeSocket:
        """Product of two or more scalars."""
        product = values[0]
        for value in values[1:]:
            product = self.math("MULTIPLY", product, value)
        return product

    def vector_math(self, operation: str, *values: Value) -> bpy.types.NodeSocket:
        """A vector operation; a scalar result (dot product, length) comes back as such."""
        return self.output("ShaderNodeVectorMath", *values, operation=operation)

    def separate(self, vector: Value) -> tuple[bpy.types.NodeSocket, ...]:
        """The x, y and z of a vector."""
        return tuple(self.node("ShaderNodeSeparateXYZ", vector).outputs)

    def combine(self, x: Value, y: Value, z: Value) -> bpy.types.NodeSocket:
        """A vector of three scalars."""
        return self.output("ShaderNodeCombineXYZ", x, y, z)

    def compare(self, operation: str, a: Value, b: Value) -> bpy.types.NodeSocket:
        """Boolean comparison of two scalars."""
        return self.output("FunctionNodeCompare", a, b, data_type="FLOAT", operation=operation)

    def both(self, a: Value, b: Value) -> bpy.types.NodeSocket:
        """Logical and."""
        return self.output("FunctionNodeBooleanMath", a, b, operation="AND")

    def either(self, a: Value, b: Value) -> bpy.types.NodeSocket:
        """Logical or."""
        return self.output("FunctionNodeBooleanMath", a, b, operation="OR")

    def switch(self, kind: str, condition: Value, false: Value, true: Value) -> bpy.types.NodeSocket:
        """`true` where `condition` holds, else `false`; `kind` is the socket type ("MATRIX", "VECTOR", ...)."""
        return self.output("GeometryNodeSwitch", condition, false, true, input_type=kind)

    def mix(self, kind: str, factor: Value, a: Value, b: Value) -> bpy.types.NodeSocket:
        """Linear interpolation; `kind` is "FLOAT", "VECTOR" or "RGBA"."""
        return self.output("ShaderNodeMix", factor, a, b, data_type=kind, clamp_factor=True)

    def multiply_matrices(self, *matrices: Value) -> bpy.types.NodeSocket:
        """Product of two or more 4x4 matrices, applied to a point from the right."""
        product = matrices[0]
        for matrix in matrices[1:]:
            product = self.output("FunctionNodeMatrixMultiply", product, matrix)
        return product

    def matrix(self, *columns: Sequence[Value]) -> bpy.types.NodeSocket:
        """An affine 4x4 matrix of its x, y, z and translation columns, three scalars each."""
        last_row = (0.0, 0.0, 0.0, 1.0)
        entries = [entry for column, last in zip(columns, last_row, strict=True) for entry in (*column, last)]
        return self.output("FunctionNodeCombineMatrix", *entries)

    def nested(
        self, name: str, build: Callable[[NodeWriter, Sockets], Mapping[str, Value]], inputs: Sockets
    ) -> dict[str, bpy.types.NodeSocket]:
        """What `build` writes, as a group of its own; returns its outputs by name.

        Groups in groups are easier to read, and much faster to make: every change of a tree makes Blender look at all
        of that tree, so that the time grows with the square of its size.

        Args:
            name: of the group.
            build: gets a writer for the group and its inputs; returns its outputs.
            inputs: what feeds the group.
        """
        tree = new_group(self.tree.bl_idname, name)
        for key, socket in inputs.items():
            tree.interface.new_socket(key, in_out="INPUT", socket_type=_DECLARED[socket.type])
        write = NodeWriter(tree)
        sockets = write.node("NodeGroupInput").outputs
        outputs = build(write, {key: sockets[key] for key in inputs})
        for key, value in outputs.items():
            assert isinstance(value, bpy.types.NodeSocket)
            tree.interface.new_socket(key, in_out="OUTPUT", socket_type=_DECLARED[value.type])
        write.node("NodeGroupOutput", *outputs.values())
        write.arrange()
        return self.group(tree, **inputs)

    def group(self, tree: bpy.types.NodeTree, **inputs: Value) -> dict[str, bpy.types.NodeSocket]:
        """A node that uses `tree`, a group of the same type of tree: inputs and outputs by name."""
        node = self.node(self.tree.bl_idname.removesuffix("Tree") + "Group", node_tree=tree)
        for name, value in inputs.items():
            self.feed(node.inputs[name], value)
        return {socket.name: socket for socket in node.outputs}

    def attribute(self, kind: str, name: Value) -> bpy.types.Node:
        """A named attribute; its outputs are the value and whether it exists."""
        return self.node("GeometryNodeInputNamedAttribute", name, data_type=kind)

    def arrange(self, spacing: float = 180.0) -> None:
        """Place the nodes in columns by their distance from the inputs, so that a person can read the tree."""
        sources: dict[str, list[str]] = {}
        for link in self.tree.links:
            sources.setdefault(link.to_node.name, []).append(link.from_node.name)
        column: dict[str, int] = {}
        height: dict[int, int] = {}
        for node in self.tree.nodes:  # nodes are made after what feeds them
            place = 1 + max((column[source] for source in sources.get(node.name, ())), default=-1)
            column[node.name] = place
            height[place] = height.get(place, 0) + 1
            node.location = (place * spacing, -height[place] * spacing)


def new_group(kind: str, name: str) -> bpy.types.NodeTree:
    """An empty node group of tree type `kind`."""
    return bpy.data.node_groups.new(name, kind)


def add_input(
    tree: bpy.types.NodeTree, name: str, kind: str, description: str, **properties: Any
) -> bpy.types.NodeTreeInterfaceSocket:
    """A documented input of a node group; `properties` are those of the socket, e.g. ``max_value=1.0``."""
    socket = tree.interface.new_socket(name, description=description, in_out="INPUT", socket_type=kind)
    for key, value in properties.items():
        setattr(socket, key, value)
    return socket


def get_modifier_input(modifier: bpy.types.NodesModifier, name: str) -> InputValue:
    """The value of the input called `name`."""
    identifier = _identifier(modifier, name)
    return getattr(modifier.properties.inputs, identifier).value if _has_own_type(modifier) else modifier[identifier]


def set_modifier_input(modifier: bpy.types.NodesModifier, name: str, value: InputValue) -> None:
    """Set the input called `name`; the object has to be tagged for an update."""
    identifier = _identifier(modifier, name)
    if _has_own_type(modifier):
        getattr(modifier.properties.inputs, identifier).value = value
    else:
        modifier[identifier] = value


def modifier_input_path(modifier: bpy.types.NodesModifier, name: str) -> str:
    """Data path of the input called `name` from the object: for keyframes, drivers and panels."""
    identifier = _identifier(modifier, name)
    place = f".properties.inputs.{identifier}.value" if _has_own_type(modifier) else f'["{identifier}"]'
    return f'modifiers["{modifier.name}"]{place}'


def modifier_input_property(modifier: bpy.types.NodesModifier, name: str) -> tuple[bpy.types.bpy_struct, str]:
    """Owner and name of the property that is the input called `name`: for ``layout.prop``."""
    identifier = _identifier(modifier, name)
    if _has_own_type(modifier):
        return getattr(modifier.properties.inputs, identifier), "value"
    return modifier, f'["{identifier}"]'


def _has_own_type(modifier: bpy.types.NodesModifier) -> bool:
    """Whether inputs are properties of their own (5.2) and not custom properties of the modifier."""
    return hasattr(modifier, "properties")


def _identifier(modifier: bpy.types.NodesModifier, name: str) -> str:
    for item in modifier.node_group.interface.items_tree:
        if item.item_type == "SOCKET" and item.in_out == "INPUT" and item.name == name:
            return item.identifier
    raise KeyError(f"node group '{modifier.node_group.name}' has no input '{name}'")
