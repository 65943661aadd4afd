"""Recolours chosen Gaussians in a layer of its own, beside the layer that it began from: that stays as it was made.

It has the name of that layer and an ending, and is a colour attribute as all layers are, so renders, comparisons,
simulations and exports know it.
"""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError
from .splat_attributes import Attribute, color_attribute, is_gaussian, opaque, read_attribute, write_attribute

_ENDING = "-edited"


@dataclass(frozen=True)
class Change:
    """What is done to colours in HSV of display-referred sRGB, as Blender's node *Hue/Saturation/Value* has it.

    Attributes:
        hue: added, in turns.
        saturation, value: factors.
    """

    hue: float = 0.0
    saturation: float = 1.0
    value: float = 1.0


def recolor(splats: bpy.types.Object, chosen: NDArray[np.bool_], layer: str, change: Change) -> str:
    """Change colours of `layer` in its edited layer, which is made where it is missing; returns that one's name.

    Args:
        splats: in Object Mode.
        chosen: (V,) the points to recolour. They no longer keep their original colours, which would hide the change.
        layer: a layer of `splats`; changes of its edited layer, which it may be itself, are added up.
        change: of the colours.

    Raises:
        InputError: none is chosen, or there is no such layer.
    """
    if not (chosen & is_gaussian(splats.data)).any():
        raise InputError("no Gaussians are selected", where=splats.name, remedy="select some first")
    name = edited_layer(layer)
    mesh = splats.data
    existing = color_attribute(name) if color_attribute(name) in mesh.attributes else color_attribute(layer)
    colors = np.clip(read_attribute(mesh, existing)[:, :3], 0.0, 1.0)
    colors[chosen] = changed(colors[chosen], change)
    write_attribute(mesh, color_attribute(name), "FLOAT_COLOR", opaque(colors))
    if Attribute.KEPT_ORIGINAL in mesh.attributes:
        kept = read_attribute(mesh, Attribute.KEPT_ORIGINAL)
        write_attribute(mesh, Attribute.KEPT_ORIGINAL, "FLOAT", np.where(chosen, 0.0, kept).astype(np.float32))
    mesh.update()
    return name


def restore(splats: bpy.types.Object, chosen: NDArray[np.bool_]) -> None:
    """Give the (V,) `chosen` points the colours back that the edited layers began from."""
    mesh = splats.data
    for name in edited_layers(splats):
        attribute = color_attribute(name)
        before = np.clip(read_attribute(mesh, color_attribute(source_layer(name)))[:, :3], 0.0, 1.0)
        colors = np.where(chosen[:, None], before, read_attribute(mesh, attribute)[:, :3])
        write_attribute(mesh, attribute, "FLOAT_COLOR", opaque(colors))
    mesh.update()


def edited_layer(layer: str) -> str:
    """Name of the layer that has the changes of `layer`, which may be that one itself."""
    return source_layer(layer) + _ENDING


def source_layer(layer: str) -> str:
    """Name of the layer that `layer` was edited from, which may be that one itself."""
    return layer.removesuffix(_ENDING)


def edited_layers(splats: bpy.types.Object) -> list[str]:
    """Names of the edited layers of `splats` whose sources are there."""
    prefix, names = color_attribute(""), splats.data.attributes.keys()
    layers = [name.removeprefix(prefix) for name in names if name.startswith(prefix) and name.endswith(_ENDING)]
    return [layer for layer in layers if color_attribute(source_layer(layer)) in names]


def remove_edited_layers(splats: bpy.types.Object) -> None:
    """Remove the edited layers of `splats`."""
    for name in edited_layers(splats):
        splats.data.attributes.remove(splats.data.attributes[color_attribute(name)])


def changed(colors: NDArray, change: Change) -> NDArray[np.float64]:
    """(N, 3) colours in [0, 1], changed; what the gamut has no place for ends at its border.

    Source: Smith, "Color gamut transform pairs", SIGGRAPH 1978.
    """
    colors = np.asarray(colors, np.float64)
    value, least = colors.max(axis=1), colors.min(axis=1)
    chroma = value - least
    safe = np.where(chroma > 0.0, chroma, 1.0)
    red, green, blue = colors.T
    sector = np.select(
        [value == red, value == green],
        [(green - blue) / safe % 6.0, (blue - red) / safe + 2.0],
        (red - green) / safe + 4.0,
    )
    hue = np.where(chroma > 0.0, sector, 0.0) + 6.0 * change.hue
    saturation = np.divide(chroma, value, out=np.zeros_like(value), where=value > 0.0)
    saturation = np.clip(saturation * change.saturation, 0.0, 1.0)
    value = np.clip(value * change.value, 0.0, 1.0)
    steps = (np.array([5.0, 3.0, 1.0]) + hue[:, None]) % 6.0
    return value[:, None] * (1.0 - saturation[:, None] * np.clip(np.minimum(steps, 4.0 - steps), 0.0, 1.0))
