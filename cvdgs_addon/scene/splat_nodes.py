"""The geometry-node group that draws Gaussians: a hull for each of them, its colour blended between two layers.

Two hulls, chosen by the input ``Camera Facing``:

* **disc**: a disc through the centre, parallel to the image plane of the active camera. Its axes are those of the
  Gaussian's elliptical projection (EWA splatting, Zwicker et al. 2001, as in 3D Gaussian Splatting, Kerbl et al. 2023),
  the low-pass `LOW_PASS` included, and discs are met in the order of their centres' depths: exactly what the
  rasteriser draws. For renders through the active camera, whichever that is, on every frame, and with ``Camera View``
  for a viewport that looks through it. Many instances of one disc, or one mesh of all of them (see `drawing_nodes`).
* **ellipsoid**: an icosphere around the Gaussian, evaluated along the ray by the material. Right for any ray
  (viewport, reflections, orthographic and panoramic cameras), but met in the order of hull entries, and the
  low-pass becomes an isotropic growth.

Either hull ends where opacity falls to `ALPHA_MIN`. Coordinates on it are in units of that radius, so that the material
needs only the opacity to evaluate the Gaussian (see `splat_material`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import bpy

from ...core.runs.layout import ORIGINAL
from ...core.splats.gaussians import LOW_PASS
from .color_nodes import add_decoding_nodes, view_dependent_part
from .compare_nodes import add_border_nodes, is_left, with_border
from .drawing_nodes import MESH_LIMIT, as_points, disc_hull, few_enough, inside_box, one_mesh, within_budget
from .nodes import NodeWriter, Sockets, Value, add_input, new_group
from .preview_nodes import PREVIEW_COUNT, as_quads
from .projection_nodes import ALPHA_MIN, Camera, Splat, add_camera_nodes, add_frame_nodes, add_hull_nodes
from .relight_nodes import add_shade_nodes, shaded
from .render_settings import FEWEST_BOUNCES, FOG, TRANSPARENT_BOUNCES
from .splat_attributes import Attribute, color_attribute

GROUP_NAME = "CVD Gaussians"


# Circumscribed about the unit sphere, so that the hull cuts nothing off.
ICOSPHERE_RADIUS = math.sqrt(15.0 / (5.0 + 2.0 * math.sqrt(5.0)))

_ORIGIN = (0.0, 0.0, 0.0)


class Input(StrEnum):
    """Inputs of the group, as the modifier shows them."""

    ENHANCED = "Enhanced"
    LAYER = "Layer"
    RELIGHT = "Relight"
    LAMP = "Lamp"
    COMPARE = "Compare"
    BORDER = "Border"
    CAMERA_FACING = "Camera Facing"
    CAMERA_VIEW = "Camera View"
    SCENE_LINEAR = "Scene Linear"
    DILATION = "Dilation"
    MESH_LIMIT = "Mesh Limit"
    PREVIEW = "Preview"
    PREVIEW_COUNT = "Preview Quads"
    AS_POINTS = "As Points"
    POINT_SIZE = "Point Size"
    BUDGET = "Budget"
    BUDGET_IN_RENDERS = "Budget in Renders"
    CROP = "Crop"
    CROP_BOX = "Crop Box"
    WIDTH = "Width"
    HEIGHT = "Height"
    MOTION_BLUR = "Motion Blur"
    BOUNCES = "Transparent Bounces"


def group_name(sh_degree: int) -> str:
    """Name of the node group for Gaussians of an SH degree."""
    return f"{GROUP_NAME} SH{sh_degree}" if sh_degree else GROUP_NAME


@dataclass(frozen=True)
class Hulls:
    """Materials of hulls: the camera-facing one as instance and in a mesh, and the ellipsoid."""

    disc: bpy.types.Material
    mesh_disc: bpy.types.Material
    ellipsoid: bpy.types.Material


@dataclass(frozen=True)
class Materials:
    """What the group draws with: hulls, hulls with the original colours beside, and points."""

    hulls: Hulls
    compared: Hulls
    point: bpy.types.Material


def build_group(sh_degree: int, materials: Materials) -> bpy.types.NodeTree:
    """Make the group, and those that it consists of.

    Args:
        sh_degree: of the original colours, 0 to 3; layers have one colour for all directions.
        materials: of what is drawn.
    """
    tree = new_group("GeometryNodeTree", group_name(sh_degree))
    tree.is_modifier = True
    tree.description = "Draws Gaussian splats as instances or points, blended between original colours and a CVD layer"
    _declare_sockets(tree)
    write = NodeWriter(tree)
    inputs = {socket.name: socket for socket in write.node("NodeGroupInput").outputs}
    points = inputs["Geometry"]
    camera = add_camera_nodes(write, inputs[Input.WIDTH], inputs[Input.HEIGHT])
    frame = add_frame_nodes(write, points)
    # Somebody orbiting in the viewport does not look through the active camera, unless they say so.
    is_render = write.output("FunctionNodeBooleanMath", write.output("GeometryNodeIsViewport"), operation="NOT")
    through_camera = write.both(camera.is_perspective, write.either(is_render, inputs[Input.CAMERA_VIEW]))
    facing = write.both(inputs[Input.CAMERA_FACING], through_camera)

    chosen = write.nested("CVD Gaussian Choice", _chosen, {name: inputs[name] for name in _CHOICE})["chosen"]
    splat = Splat(write, camera, frame)
    in_front = write.compare("GREATER_THAN", splat.depth, camera.clip_start)
    drawn = write.both(chosen, write.switch("BOOLEAN", facing, True, in_front))
    # The faces of the mesh change places between the moments that motion blur compares; instances stay who they are.
    is_sharp = write.output("FunctionNodeBooleanMath", inputs[Input.MOTION_BLUR], operation="NOT")
    few = few_enough(write, points, drawn, inputs[Input.MESH_LIMIT])
    as_mesh = write.both(facing, write.both(is_sharp, few))
    is_compared = write.both(inputs[Input.COMPARE], camera.is_perspective)
    disc, mesh_disc, ellipsoid_material = (
        write.switch("MATERIAL", is_compared, getattr(materials.hulls, kind), getattr(materials.compared, kind))
        for kind in ("disc", "mesh_disc", "ellipsoid")
    )
    disc_material = write.switch("MATERIAL", as_mesh, disc, mesh_disc)
    hull = write.switch("GEOMETRY", facing, _icosphere(write, ellipsoid_material), disc_hull(write, disc_material))
    instances = write.output("GeometryNodeInstanceOnPoints", points, drawn, hull)

    ellipsoid, disc = add_hull_nodes(write, camera, frame, inputs[Input.DILATION])
    placement = write.switch("MATRIX", facing, ellipsoid, disc)
    instances = write.output("GeometryNodeSetInstanceTransform", instances, True, placement)
    colors = _add_color_nodes(write, inputs, camera, frame, sh_degree)
    instances = _with_color(write, instances, colors.shown, "INSTANCE")
    normal = add_border_nodes(write, camera, inputs[Input.BORDER])
    compared = with_border(write, instances, camera, normal, colors.original)
    instances = write.switch("GEOMETRY", is_compared, instances, compared)
    hulls = write.switch("GEOMETRY", as_mesh, instances, one_mesh(write, instances, splat.depth))
    left = write.both(is_compared, is_left(write, camera, normal))
    color = write.switch("RGBA", left, colors.shown, colors.original)
    cloud = as_points(write, points, chosen, splat.scale, inputs[Input.POINT_SIZE], materials.point)
    cloud = _with_color(write, cloud, color, "POINT")
    shown = write.switch("GEOMETRY", inputs[Input.AS_POINTS], hulls, cloud)
    rank = write.attribute("INT", Attribute.RANK).outputs["Attribute"]
    few = write.both(chosen, write.compare("LESS_THAN", rank, inputs[Input.PREVIEW_COUNT]))
    light = write.switch("RGBA", left, colors.shown_light, colors.original_light)
    quads = as_quads(write, points, few, frame, light, materials.point)
    quads = _with_color(write, quads, color, "POINT")
    is_preview = write.both(write.output("GeometryNodeIsViewport"), inputs[Input.PREVIEW])
    _warn_of_fog(write, inputs[Input.BOUNCES])
    write.node("NodeGroupOutput", write.switch("GEOMETRY", is_preview, shown, quads))
    write.arrange()
    return tree


def _declare_sockets(tree: bpy.types.NodeTree) -> None:
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    add_input(tree, "Geometry", "NodeSocketGeometry", "Points with the attributes of Gaussians")
    add_input(tree, Input.ENHANCED, "NodeSocketFloat", "0 shows the original colours, 1 those of the layer",
              subtype="FACTOR", min_value=0.0, max_value=1.0, default_value=1.0)  # fmt: skip
    add_input(tree, Input.LAYER, "NodeSocketString", "Colour attribute to blend to, for example color_deutan-1.0",
              default_value=color_attribute(ORIGINAL))  # fmt: skip
    add_input(tree, Input.RELIGHT, "NodeSocketFloat",
              "How far the lamp shades the Gaussians, which face where the Gaussians around them lead to guess. They "
              "throw no shadows, the photographs' shadows and gloss stay, and figures of contrast no longer hold",
              subtype="FACTOR", min_value=0.0, max_value=1.0)  # fmt: skip
    add_input(tree, Input.LAMP, "NodeSocketObject", "The lamp that shades; where it points counts, not where it stands")
    add_input(tree, Input.COMPARE, "NodeSocketBool",
              "Show the original colours in the left part of the active camera's picture")  # fmt: skip
    add_input(tree, Input.BORDER, "NodeSocketFloat",
              "Where that part ends, as a fraction of the picture's width",
              subtype="FACTOR", min_value=0.0, max_value=1.0, default_value=0.5)  # fmt: skip
    add_input(tree, Input.CAMERA_FACING, "NodeSocketBool",
              "Render discs that face the active camera, exactly as trained; off: ellipsoids, correct for any ray, as "
              "in the viewport",
              default_value=True)  # fmt: skip
    add_input(tree, Input.CAMERA_VIEW, "NodeSocketBool",
              "Draw the same discs in the viewport, which must look through the active camera: several times faster in "
              "Cycles, wrong from anywhere else")  # fmt: skip
    add_input(tree, Input.SCENE_LINEAR, "NodeSocketBool",
              "Convert the colours to scene-linear light, for a scene with lamps and a Standard view transform; "
              "off: photo colours, for the Raw view transform")  # fmt: skip
    add_input(tree, Input.DILATION, "NodeSocketFloat", "Low-pass of the rasteriser, in square pixels",
              min_value=0.0, max_value=10.0, default_value=LOW_PASS)  # fmt: skip
    add_input(tree, Input.MESH_LIMIT, "NodeSocketInt",
              "The most discs to draw as one mesh, which Cycles renders faster but with more memory; a larger number "
              "is drawn as instances. 0: always instances",
              min_value=0, default_value=MESH_LIMIT)  # fmt: skip
    add_input(tree, Input.PREVIEW, "NodeSocketBool",
              "Draw coloured quads in the viewport, for Solid shading; renders show the Gaussians")  # fmt: skip
    add_input(tree, Input.PREVIEW_COUNT, "NodeSocketInt",
              "The most quads of the preview, the largest and most opaque Gaussians first",
              min_value=1, default_value=PREVIEW_COUNT)  # fmt: skip
    add_input(tree, Input.AS_POINTS, "NodeSocketBool",
              "Draw points instead of Gaussians: fast, for positioning and cropping")  # fmt: skip
    add_input(tree, Input.POINT_SIZE, "NodeSocketFloat", "Radius of points in standard deviations of their Gaussians",
              min_value=0.0, default_value=1.0)  # fmt: skip
    add_input(tree, Input.BUDGET, "NodeSocketInt",
              "The most Gaussians to draw in the viewport, the largest and most opaque first; 0: all",
              min_value=0)  # fmt: skip
    add_input(tree, Input.BUDGET_IN_RENDERS, "NodeSocketBool", "Apply the budget to renders too")  # fmt: skip
    add_input(tree, Input.CROP, "NodeSocketBool", "Draw only what is inside the crop box")
    add_input(tree, Input.CROP_BOX, "NodeSocketObject",
              "An Empty shown as a cube that can be moved, rotated and scaled")  # fmt: skip
    for name in (Input.WIDTH, Input.HEIGHT):
        add_input(tree, name, "NodeSocketFloat", "Size of the render in pixels, driven by the scene",
                  min_value=1.0, default_value=1000.0, hide_in_modifier=True)  # fmt: skip
    add_input(tree, Input.MOTION_BLUR, "NodeSocketBool", "Motion blur, driven by the scene", hide_in_modifier=True)
    add_input(tree, Input.BOUNCES, "NodeSocketInt", "Of Cycles, driven by the scene",
              min_value=0, default_value=TRANSPARENT_BOUNCES, hide_in_modifier=True)  # fmt: skip


def _warn_of_fog(write: NodeWriter, bounces: Value) -> None:
    """A warning on the modifier, for files that have the Gaussians but not the add-on."""
    message = write.node("FunctionNodeFormatString")
    message.format_items.new("INT", "bounces")
    write.feed(message.inputs["Format"], f"{FOG}. In Render > Light Paths > Transparent, set {TRANSPARENT_BOUNCES}")
    write.feed(message.inputs["bounces"], bounces)
    too_few = write.compare("LESS_THAN", bounces, FEWEST_BOUNCES)
    write.node("GeometryNodeWarning", too_few, message.outputs["String"], warning_type="WARNING")


_CHOICE = (Input.BUDGET, Input.BUDGET_IN_RENDERS, Input.CROP, Input.CROP_BOX)


def _chosen(write: NodeWriter, inputs: Sockets) -> Mapping[str, Value]:
    """Boolean: a Gaussian, and not a point of the frame, that is opaque enough, within the budget and not cropped."""
    is_gaussian = write.compare("LESS_THAN", write.attribute("INT", Attribute.FRAME).outputs["Attribute"], 0.5)
    opacity = write.attribute("FLOAT", Attribute.OPACITY).outputs["Attribute"]
    visible = write.both(is_gaussian, write.compare("GREATER_THAN", opacity, ALPHA_MIN))
    is_viewport = write.output("GeometryNodeIsViewport")
    is_limited = write.either(is_viewport, inputs[Input.BUDGET_IN_RENDERS])
    rank = write.attribute("INT", Attribute.RANK).outputs["Attribute"]
    affordable = within_budget(write, rank, inputs[Input.BUDGET], is_limited)
    position = write.output("GeometryNodeInputPosition")
    inside = inside_box(write, position, inputs[Input.CROP_BOX], inputs[Input.CROP])
    removed = write.attribute("BOOLEAN", Attribute.REMOVED).outputs["Attribute"]
    there = write.both(visible, write.output("FunctionNodeBooleanMath", removed, operation="NOT"))
    return {"chosen": write.both(there, write.both(affordable, inside))}


def _with_color(write: NodeWriter, geometry: Value, color: Value, domain: str) -> bpy.types.NodeSocket:
    return write.output("GeometryNodeStoreNamedAttribute", geometry, True, Attribute.DRAWN_COLOR, color,
                        data_type="FLOAT_COLOR", domain=domain)  # fmt: skip


def _icosphere(write: NodeWriter, material: bpy.types.Material) -> Value:
    mesh = write.output("GeometryNodeMeshIcoSphere", ICOSPHERE_RADIUS, 1)
    return write.output("GeometryNodeSetMaterial", mesh, True, material)


class _Colors(NamedTuple):
    """Colours of the slider and the original ones: as the scene needs them, trained or as light, and that light."""

    shown: bpy.types.NodeSocket
    shown_light: bpy.types.NodeSocket
    original: bpy.types.NodeSocket
    original_light: bpy.types.NodeSocket


def _add_color_nodes(
    write: NodeWriter, inputs: Sockets, camera: Camera, frame: bpy.types.NodeSocket, sh_degree: int
) -> _Colors:
    original = write.attribute("FLOAT_COLOR", color_attribute(ORIGINAL)).outputs["Attribute"]
    if sh_degree:
        seen_from = {**camera._asdict(), "frame": frame}

        def view_dependent(inner: NodeWriter, sockets: Sockets) -> Mapping[str, Value]:
            view = Camera(**{name: sockets[name] for name in Camera._fields})
            direction = Splat(inner, view, sockets["frame"]).direction
            return {"color": view_dependent_part(inner, direction, sh_degree)}

        part = write.nested(f"CVD View-Dependent Colour SH{sh_degree}", view_dependent, seen_from)["color"]
        original = write.vector_math("MAXIMUM", write.vector_math("ADD", original, part), _ORIGIN)
    layer = write.attribute("FLOAT_COLOR", inputs[Input.LAYER])
    # The original's attribute is only the constant part of its colour.
    is_other = write.output(
        "FunctionNodeCompare", inputs[Input.LAYER], color_attribute(ORIGINAL), data_type="STRING", operation="NOT_EQUAL"
    )
    is_layer = write.both(layer.outputs["Exists"], is_other)
    enhanced = write.switch("RGBA", is_layer, original, layer.outputs["Attribute"])
    kept = write.attribute("FLOAT", Attribute.KEPT_ORIGINAL).outputs["Attribute"]
    share = write.math("MULTIPLY", inputs[Input.ENHANCED], write.math("SUBTRACT", 1.0, kept))
    encoded = write.mix("RGBA", share, original, enhanced)
    is_relit = write.compare("GREATER_THAN", inputs[Input.RELIGHT], 0.0)
    shade = add_shade_nodes(write, inputs[Input.LAMP], frame, inputs[Input.RELIGHT])
    pairs = []
    for color in (encoded, original):
        color = shaded(write, color, shade, is_relit)
        light = add_decoding_nodes(write, color)
        pairs += [write.switch("RGBA", inputs[Input.SCENE_LINEAR], color, light), light]
    return _Colors(*pairs)
