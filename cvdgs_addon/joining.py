"""Two runs of one place, aligned, become one object of Gaussians; what they were made of stays in the file, hidden."""

from __future__ import annotations

from collections.abc import Sequence

import bpy
import mathutils
import numpy as np
from numpy.typing import NDArray

from ..core.runs.layout import ORIGINAL
from ..core.splats.strategy.editing import concatenate
from .comparison import follow_comparison
from .export import ExportedGaussians, read_gaussians
from .scene.beside import collections_of
from .scene.display import BACKGROUND_PROPERTY, Form, form_of, show_form
from .scene.neighbours import hide_gaussians
from .scene.recolor import source_layer
from .scene.splat_attributes import Attribute, is_gaussian, read_attribute, write_attribute
from .scene.splat_nodes import Input
from .scene.splats import add_gaussians, get_input, layer_names, set_input, show_layer
from .scene.world_matrix import world_of
from .shown import shown_layer

_ENDING = " Gaussians"


def join(scene: bpy.types.Scene, first: bpy.types.Object, second: bpy.types.Object) -> bpy.types.Object:
    """One object of the Gaussians of both as they are now, which the panels are about then; the two are hidden.

    It stands where `first` stands and belongs to the same capture. Layers of the same name become one; where one of the
    two lacks a layer, its Gaussians keep their original colours in it. What was removed or cropped away is left out.

    Raises:
        InputError: one of them is being edited, or has no Gaussians left.
    """
    bpy.context.view_layer.update()
    into = world_of(first).inverted_safe() @ world_of(second)
    parts = [_read(first, ORIGINAL), _read(second, ORIGINAL, into)]
    degree = max(part.gaussians.sh_degree for part in parts)
    gaussians = concatenate(*(part.gaussians.with_sh_degree(degree) for part in parts))
    names = dict.fromkeys(name for splats in (first, second) for name in layer_names(splats) if name != ORIGINAL)
    layers = {name: np.concatenate([_colors(first, name), _colors(second, name)]) for name in names}
    title = f"{first.name.removesuffix(_ENDING)} + {second.name.removesuffix(_ENDING)}{_ENDING}"
    joined = add_gaussians(gaussians, layers, collections_of(first)[0], title)
    _keep_floaters(joined, (first, second), parts)
    joined.parent, joined.matrix_parent_inverse = first.parent, first.matrix_parent_inverse
    joined.matrix_basis = first.matrix_basis
    if BACKGROUND_PROPERTY in first:
        joined[BACKGROUND_PROPERTY] = first[BACKGROUND_PROPERTY]
    set_input(joined, Input.SCENE_LINEAR, get_input(first, Input.SCENE_LINEAR))
    show_layer(joined, *shown_layer(first))
    show_form(joined, Form.INSTANCES if form_of(first) is Form.NATIVE else form_of(first))
    hide_gaussians(scene, [first, second])
    scene.cvdgs.display.target = joined
    follow_comparison(scene)
    return joined


def _read(splats: bpy.types.Object, layer: str, axes: mathutils.Matrix | None = None) -> ExportedGaussians:
    return read_gaussians(splats, layer, 1.0, axes=axes)


def _colors(splats: bpy.types.Object, layer: str) -> NDArray[np.float32]:
    """(N, 3) of the Gaussians that are left, in a layer or in what comes closest to it."""
    candidates = (layer, source_layer(layer), ORIGINAL)
    return _read(splats, next(name for name in candidates if name in layer_names(splats))).gaussians.base_colors


def _keep_floaters(
    joined: bpy.types.Object, sources: Sequence[bpy.types.Object], parts: Sequence[ExportedGaussians]
) -> None:
    """Give `joined` the floater scores of its sources; Gaussians of one that has none are no floaters."""
    scores = [
        read_attribute(splats.data, Attribute.FLOATER)[part.points]
        if Attribute.FLOATER in splats.data.attributes
        else np.zeros(len(part.gaussians), np.float32)
        for splats, part in zip(sources, parts, strict=True)
    ]
    if any(Attribute.FLOATER in splats.data.attributes for splats in sources):
        all_scores = np.zeros(len(joined.data.vertices), np.float32)
        all_scores[is_gaussian(joined.data)] = np.concatenate(scores)
        write_attribute(joined.data, Attribute.FLOATER, "FLOAT", all_scores)
