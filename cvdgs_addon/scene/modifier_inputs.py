"""Values of a geometry-nodes modifier's inputs, by the name that the user sees; they moved in Blender 5.2."""

from __future__ import annotations

from typing import TypeAlias

import bpy

InputValue: TypeAlias = float | bool | str | bpy.types.Object | None


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
