"""The materials that evaluate a Gaussian on its hull (see `splat_nodes`), in Cycles and EEVEE."""

from __future__ import annotations

from enum import StrEnum

import bpy

from .nodes import NodeWriter, Value
from .projection_nodes import ALPHA_MIN
from .splat_attributes import Attribute

DISC_NAME = "CVD Gaussian Disc"
MESH_DISC_NAME = "CVD Gaussian Mesh Disc"
ELLIPSOID_NAME = "CVD Gaussian Ellipsoid"
POINT_NAME = "CVD Gaussian Point"

ALPHA_MAX = 0.999  # of the rasteriser: no Gaussian hides what is behind it entirely


_COMPARED = "{} Compared"


class _Kept(StrEnum):
    """Where opacity and colour are kept, as the attribute node calls it."""

    ON_INSTANCE = "INSTANCER"
    ON_MESH = "GEOMETRY"


def hull_name(name: str, *, compared: bool) -> str:
    """Name of the material that draws hulls of this kind; `compared`: that with the original colours beside."""
    return _COMPARED.format(name) if compared else name


def build_disc_material(*, compared: bool = False) -> bpy.types.Material:
    """Evaluates the Gaussian where the ray meets the plane of its centre."""
    material = _new_material(hull_name(DISC_NAME, compared=compared))
    write = NodeWriter(material.node_tree)
    _show_disc(write, write.output("ShaderNodeTexCoord", name="Object"), _Kept.ON_INSTANCE, compared)
    return material


def build_mesh_disc_material(*, compared: bool = False) -> bpy.types.Material:
    """Does the same for discs that are faces of one mesh (see `drawing_nodes`)."""
    material = _new_material(hull_name(MESH_DISC_NAME, compared=compared))
    write = NodeWriter(material.node_tree)
    _show_disc(write, _attribute(write, Attribute.ON_DISC, "Vector", _Kept.ON_MESH), _Kept.ON_MESH, compared)
    return material


def build_ellipsoid_material(*, compared: bool = False) -> bpy.types.Material:
    """Evaluates the Gaussian at its maximum along the ray, once for each hull: where the ray enters."""
    material = _new_material(hull_name(ELLIPSOID_NAME, compared=compared))
    write = NodeWriter(material.node_tree)
    point = write.output("ShaderNodeTexCoord", name="Object")
    geometry = write.node("ShaderNodeNewGeometry")
    ray = write.output("ShaderNodeVectorTransform", geometry.outputs["Incoming"],
                       vector_type="VECTOR", convert_from="WORLD", convert_to="OBJECT")  # fmt: skip
    # Squared distance of the ray from the centre: |p|^2 - (p.d)^2 / |d|^2.
    along = write.vector_math("DOT_PRODUCT", point, ray)
    foot = write.math("DIVIDE", write.math("MULTIPLY", along, along), write.vector_math("DOT_PRODUCT", ray, ray))
    squared_radius = write.math("SUBTRACT", write.vector_math("DOT_PRODUCT", point, point), foot)
    entering = write.math("SUBTRACT", 1.0, geometry.outputs["Backfacing"])
    alpha = _alpha(write, squared_radius, _Kept.ON_INSTANCE)
    color = _color(write, point, _Kept.ON_INSTANCE, compared)
    _finish(write, write.math("MULTIPLY", entering, alpha), color)
    return material


def build_point_material() -> bpy.types.Material:
    """Shows the colour of a point, opaque."""
    material = _new_material(POINT_NAME)
    write = NodeWriter(material.node_tree)
    color = write.output("ShaderNodeAttribute", name="Color", attribute_name=Attribute.DRAWN_COLOR)
    write.node("ShaderNodeOutputMaterial", write.output("ShaderNodeEmission", color))
    write.arrange()
    return material


def _new_material(name: str) -> bpy.types.Material:
    material = bpy.data.materials.new(name)
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    material.node_tree.nodes.clear()
    material.surface_render_method = "BLENDED"  # EEVEE: sorted and mixed, not dithered
    material.cycles.emission_sampling = "NONE"  # Cycles: a picture's colours, not thousands of lamps
    return material


def _show_disc(write: NodeWriter, point: Value, kept: _Kept, compared: bool) -> None:
    squared_radius = write.vector_math("DOT_PRODUCT", point, point)
    _finish(write, _alpha(write, squared_radius, kept), _color(write, point, kept, compared))


def _alpha(write: NodeWriter, squared_radius: Value, kept: _Kept) -> Value:
    """o exp(-r^2 / 2) with r in standard deviations, from the squared radius in units of the hull's.

    The hull's radius is where it falls to `ALPHA_MIN`, so it is o (ALPHA_MIN / o)^(squared radius).
    """
    opacity = _attribute(write, Attribute.OPACITY, "Fac", kept)
    falloff = write.math("POWER", write.math("DIVIDE", ALPHA_MIN, opacity), squared_radius)
    alpha = write.math("MINIMUM", write.math("MULTIPLY", opacity, falloff), ALPHA_MAX)
    return write.math("MULTIPLY", alpha, write.math("LESS_THAN", squared_radius, 1.0))


def _attribute(write: NodeWriter, name: str, output: str, kept: _Kept) -> Value:
    return write.output("ShaderNodeAttribute", name=output, attribute_type=kept, attribute_name=name)


def _color(write: NodeWriter, point: Value, kept: _Kept, compared: bool) -> Value:
    """The drawn colour; where colours are compared, the original one left of the border (see `compare_nodes`)."""
    drawn = _attribute(write, Attribute.DRAWN_COLOR, "Color", kept)
    if not compared:
        return drawn
    plane = write.node("ShaderNodeAttribute", attribute_type=kept, attribute_name=Attribute.BORDER)
    side = write.sum(write.vector_math("DOT_PRODUCT", plane.outputs["Color"], point), plane.outputs["Alpha"])
    original = _attribute(write, Attribute.ORIGINAL_COLOR, "Color", kept)
    return write.mix("RGBA", write.math("LESS_THAN", side, 0.0), drawn, original)


def _finish(write: NodeWriter, alpha: Value, color: Value) -> None:
    """Emission of `color`, mixed over what is behind by `alpha`."""
    emission = write.output("ShaderNodeEmission", color)
    mixed = write.output("ShaderNodeMixShader", alpha, write.output("ShaderNodeBsdfTransparent"), emission)
    write.node("ShaderNodeOutputMaterial", mixed)
    write.arrange()
