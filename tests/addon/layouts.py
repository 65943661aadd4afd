"""A stand-in for Blender's layouts, which do not exist without a window: it checks what panels put in, and notes it."""

from __future__ import annotations

from functools import partial
from types import SimpleNamespace
from typing import Any

import bpy

ICONS = bpy.types.UILayout.bl_rna.functions["prop"].parameters["icon"].enum_items.keys()


class RecordingLayout:
    """Notes texts, properties and operators of itself and of all that is made from it.

    Attributes:
        texts: of labels, bars and buttons.
        properties: names of the properties that can be changed.
        operators: identifiers of the operators that can be pressed.
    """

    def __init__(self, parent: RecordingLayout | None = None) -> None:
        own = parent or SimpleNamespace(texts=[], properties=[], operators=[])
        self.texts: list[str] = own.texts
        self.properties: list[str] = own.properties
        self.operators: list[str] = own.operators

    def _inner(self, **_options: Any) -> RecordingLayout:
        return RecordingLayout(self)

    row = column = box = grid_flow = split = _inner

    def panel(self, _name: str, default_closed: bool = False) -> tuple[RecordingLayout, RecordingLayout]:
        return self._inner(), self._inner()

    def label(self, text: str = "", icon: str = "NONE", icon_value: int = 0) -> None:
        assert icon in ICONS
        self.texts.append(text)

    def prop(self, data: Any, name: str, text: str | None = None, icon: str = "NONE", **_options: Any) -> None:
        if name.startswith("["):
            data.path_resolve(name)  # a custom property; fails for one that does not exist
        else:
            assert name in data.bl_rna.properties, name
        assert icon in ICONS
        self.properties.append(name)

    def prop_enum(self, data: Any, name: str, value: str, text: str | None = None) -> None:
        assert value in data.bl_rna.properties[name].enum_items
        self.properties.append(name)
        self.texts.append(text or "")

    def prop_search(self, data: Any, name: str, _owner: Any, _items: str, **_options: Any) -> None:
        self.prop(data, name)

    def operator(self, identifier: str, text: str | None = None, icon: str = "NONE", **_options: Any) -> Any:
        category, name = identifier.split(".")
        getattr(getattr(bpy.ops, category), name).get_rna_type()  # fails for one that does not exist
        assert icon in ICONS
        self.operators.append(identifier)
        self.texts.append(text or "")
        return SimpleNamespace()

    def operator_menu_enum(self, identifier: str, name: str, text: str = "", icon: str = "NONE") -> Any:
        category, operator = identifier.split(".")
        assert name in getattr(getattr(bpy.ops, category), operator).get_rna_type().properties
        return self.operator(identifier, text, icon)

    def menu(self, name: str, icon: str = "NONE", **_options: Any) -> None:
        assert hasattr(bpy.types, name)

    def progress(self, factor: float = 0.0, text: str = "") -> None:
        assert 0.0 <= factor <= 1.0
        self.texts.append(text)

    def template_icon(self, icon_value: int, scale: float = 1.0) -> None: ...

    def separator(self, **_options: Any) -> None: ...


def drawn(panel: type, context: Any = None) -> RecordingLayout:
    """What a panel or menu shows now."""
    layout = RecordingLayout()
    instance = SimpleNamespace(layout=layout)
    if hasattr(panel, "draw_for"):
        instance.draw_for = partial(panel.draw_for, instance)
    panel.draw(instance, context or bpy.context)
    return layout
