"""The geometry-node group that draws Gaussians: one instance a Gaussian, its colour blended between two layers.

Two hulls, chosen by the input ``Camera Facing``:

* **disc**: a disc through the centre, parallel to the image plane of the active camera. Its axes are those of the
  Gaussian's elliptical projection (EWA splatting, Zwicker et al. 2001, as in 3D Gaussian Splatting, Kerbl et al. 2023),
  the low-pass `DILATION` included, and discs are met in the order of their centres' depths: exactly what the
  rasteriser draws. For renders through the active camera, whichever that is, on every frame.
* **ellipsoid**: an icosphere around the Gaussian, evaluated along the ray by the material. Right for any ray
  (viewport, reflections, orthographic and panoramic cameras), but met in the order of hull entries, and the
  low-pass becomes an isotropic growth.

Either hull ends where opacity falls to `ALPHA_MIN`. Object coordinates on it are in units of that radius, so that the
material needs only the opacity to evaluate the Gaussian (see `splat_material`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum, StrEnum

import bpy

from .harmonics_nodes import view_dependent_part
from .nodes import NodeWriter, Value, add_input, new_group

GROUP_NAME = "CVD Gaussians"

DILATION = 0.3  # px^2 that the rasteriser adds to the variance of every projection (Kerbl et al. 2023)
ALPHA_MIN = 1.0 / 255.0  # what is less opaque is not drawn
FIELD_MARGIN = 0.3  # the projection is linearised within the image and this many half widths around (Kerbl et al. 2023)

# Circumscribed about the unit sphere and the unit circle, so that the hull cuts nothing off.
ICOSPHERE_RADIUS = math.sqrt(15.0 / (5.0 + 2.0 * math.sqrt(5.0)))
DISC_CORNERS = 8  # fewer cost more in rays through transparent corners than they save in triangles
DISC_RADIUS = 1.0 / math.cos(math.pi / DISC_CORNERS)

_X, _Y, _Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
_ORIGIN = (0.0, 0.0, 0.0)

ORIGINAL = "original"  # the layer of the photographs' own colours


class Attribute(StrEnum):
    """Attributes of the mesh's points, and of the instances. Colour layers are called ``color_<layer>``."""

    SCALE = "scale"  # FLOAT_VECTOR, standard deviations along the local axes
    ROTATION = "rotation"  # QUATERNION, wxyz, local to object
    OPACITY = "opacity"  # FLOAT
    FRAME = "frame"  # INT, 0 for a Gaussian, else which point of the frame (see `Frame`)
    DRAWN_COLOR = "drawn_color"  # FLOAT_COLOR, of instances only: what the material shows


class Frame(IntEnum):
    """Values of `Attribute.FRAME`.

    Apply Transform moves a mesh's points but not its attributes. Four extra points follow it, and the group takes the
    linear map that they went through and applies it to every Gaussian's axes.
    """

    ORIGIN = 1
    X = 2
    Y = 3
    Z = 4


class Input(StrEnum):
    """Inputs of the group, as the modifier shows them."""

    ENHANCED = "Enhanced"
    LAYER = "Layer"
    CAMERA_FACING = "Camera Facing"
    SCENE_LINEAR = "Scene Linear"
    DILATION = "Dilation"
    WIDTH = "Width"
    HEIGHT = "Height"


def color_attribute(layer: str) -> str:
    """Name of the colour attribute of `layer`, e.g. ``color_deutan-1.0``."""
    return f"color_{layer}"


def group_name(sh_degree: int) -> str:
    """Name of the node group for Gaussians of an SH degree."""
    return f"{GROUP_NAME} SH{sh_degree}" if sh_degree else GROUP_NAME


def build_group(sh_degree: int, disc: bpy.types.Material, ellipsoid: bpy.types.Material) -> bpy.types.NodeTree:
    """Make the group.

    Args:
        sh_degree: of the original colours, 0 to 3; layers have one colour for all directions.
        disc: material of the camera-facing hull.
        ellipsoid: material of the hull around the Gaussian.
    """
    tree = new_group("GeometryNodeTree", group_name(sh_degree))
    tree.is_modifier = True
    tree.description = "Draws Gaussian splats as instances, blended between the original colours and a CVD layer"
    _declare_sockets(tree)
    write = NodeWriter(tree)
    inputs = {socket.name: socket for socket in write.node("NodeGroupInput").outputs}
    points = inputs["Geometry"]
    camera = _camera(write, inputs[Input.WIDTH], inputs[Input.HEIGHT])
    # Somebody orbiting in the viewport does not look through the active camera.
    is_render = write.output("FunctionNodeBooleanMath", write.output("GeometryNodeIsViewport"), operation="NOT")
    facing = write.both(inputs[Input.CAMERA_FACING], write.both(camera.is_perspective, is_render))

    splat = _Splat(write, points, camera)
    in_front = write.compare("GREATER_THAN", splat.depth, camera.clip_start)
    seen = write.switch("BOOLEAN", facing, True, in_front)
    visible = write.compare("GREATER_THAN", splat.opacity, ALPHA_MIN)
    is_gaussian = write.compare("LESS_THAN", write.attribute("INT", Attribute.FRAME).outputs["Attribute"], 0.5)
    drawn = write.both(is_gaussian, write.both(visible, seen))
    hull = write.switch("GEOMETRY", facing, _icosphere(write, ellipsoid), _disc(write, disc))
    instances = write.output("GeometryNodeInstanceOnPoints", points, drawn, hull)

    dilation = inputs[Input.DILATION]
    placement = write.switch("MATRIX", facing, splat.ellipsoid(dilation), splat.disc(dilation))
    instances = write.output("GeometryNodeSetInstanceTransform", instances, True, placement)
    color = _color(write, inputs, splat.direction if sh_degree else None, sh_degree)
    instances = write.output("GeometryNodeStoreNamedAttribute", instances, True, Attribute.DRAWN_COLOR, color,
                             data_type="FLOAT_COLOR", domain="INSTANCE")  # fmt: skip
    write.node("NodeGroupOutput", instances)
    write.arrange()
    return tree


def _declare_sockets(tree: bpy.types.NodeTree) -> None:
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    add_input(tree, "Geometry", "NodeSocketGeometry", "Points with the attributes of Gaussians")
    add_input(tree, Input.ENHANCED, "NodeSocketFloat", "0 shows the original colours, 1 those of the layer",
              subtype="FACTOR", min_value=0.0, max_value=1.0, default_value=1.0)  # fmt: skip
    add_input(tree, Input.LAYER, "NodeSocketString", "Colour attribute to blend to, for example color_deutan-1.0",
              default_value=color_attribute(ORIGINAL))  # fmt: skip
    add_input(tree, Input.CAMERA_FACING, "NodeSocketBool",
              "Render discs that face the active camera, exactly as trained; off: ellipsoids, right for any ray, as in "
              "the viewport",
              default_value=True)  # fmt: skip
    add_input(tree, Input.SCENE_LINEAR, "NodeSocketBool",
              "Convert the colours to scene-linear light, for a scene with lamps and a Standard view transform; "
              "off: photo colours, for the Raw view transform", default_value=False)  # fmt: skip
    add_input(tree, Input.DILATION, "NodeSocketFloat", "Low-pass of the rasteriser, in square pixels",
              min_value=0.0, max_value=10.0, default_value=DILATION)  # fmt: skip
    for name in (Input.WIDTH, Input.HEIGHT):
        add_input(tree, name, "NodeSocketFloat", "Size of the render in pixels, driven by the scene",
                  min_value=1.0, default_value=1000.0, hide_in_modifier=True)  # fmt: skip


@dataclass(frozen=True)
class _Camera:
    """Sockets that describe the active camera, seen from the object that carries the Gaussians.

    Attributes:
        to_object: matrix from camera space (x right, y up, z backwards) to the object's.
        from_object: its inverse.
        pixel_angle_x, pixel_angle_y: width and height of a pixel at depth 1.
        limits_x, limits_y: lowest and highest tangent at which the projection is linearised.
        clip_start: nearest visible depth.
        is_perspective: boolean.
    """

    to_object: bpy.types.NodeSocket
    from_object: bpy.types.NodeSocket
    pixel_angle_x: bpy.types.NodeSocket
    pixel_angle_y: bpy.types.NodeSocket
    limits_x: tuple[bpy.types.NodeSocket, ...]
    limits_y: tuple[bpy.types.NodeSocket, ...]
    clip_start: bpy.types.NodeSocket
    is_perspective: bpy.types.NodeSocket


def _camera(write: NodeWriter, width: Value, height: Value) -> _Camera:
    active = write.output("GeometryNodeInputActiveCamera")
    info = write.node("GeometryNodeCameraInfo", active)
    to_object = write.output("GeometryNodeObjectInfo", active, name="Transform", transform_space="RELATIVE")
    # The projection matrix knows lens, sensor, shift and aspects: x_ndc = P00 tangent_x - P02, within -1 and 1.
    entries = write.node("FunctionNodeSeparateMatrix", info.outputs["Projection Matrix"]).outputs
    half_field_x = write.math("DIVIDE", 1.0, entries["Column 1 Row 1"])
    half_field_y = write.math("DIVIDE", 1.0, entries["Column 2 Row 2"])
    return _Camera(
        to_object=to_object,
        from_object=write.output("FunctionNodeInvertMatrix", to_object),
        pixel_angle_x=write.math("DIVIDE", write.math("MULTIPLY", 2.0, half_field_x), width),
        pixel_angle_y=write.math("DIVIDE", write.math("MULTIPLY", 2.0, half_field_y), height),
        limits_x=_tangent_limits(write, half_field_x, entries["Column 3 Row 1"]),
        limits_y=_tangent_limits(write, half_field_y, entries["Column 3 Row 2"]),
        clip_start=info.outputs["Clip Start"],
        is_perspective=write.output("FunctionNodeBooleanMath", info.outputs["Is Orthographic"], operation="NOT"),
    )


def _tangent_limits(write: NodeWriter, half_field: Value, shift: Value) -> tuple[bpy.types.NodeSocket, ...]:
    bounds = (-1.0 - FIELD_MARGIN, 1.0 + FIELD_MARGIN)
    return tuple(write.math("MULTIPLY", half_field, write.math("ADD", shift, bound)) for bound in bounds)


class _Splat:
    """Sockets of one Gaussian's hull: fields, the same on the points and on the instances made of them."""

    def __init__(self, write: NodeWriter, points: Value, camera: _Camera) -> None:
        self._write = write
        self._camera = camera
        self.position = write.output("GeometryNodeInputPosition")
        self.center = write.output("FunctionNodeTransformPoint", self.position, camera.from_object)
        self.depth = write.math("MULTIPLY", -1.0, write.separate(self.center)[2])
        self.scale = write.attribute("FLOAT_VECTOR", Attribute.SCALE).outputs["Attribute"]
        self.rotation = write.attribute("QUATERNION", Attribute.ROTATION).outputs["Attribute"]
        self.opacity = write.attribute("FLOAT", Attribute.OPACITY).outputs["Attribute"]
        self.frame = _frame(write, points)
        # o exp(-r^2 / 2) = ALPHA_MIN at r = sqrt(2 ln(o / ALPHA_MIN)) standard deviations.
        ratio = write.math("MAXIMUM", write.math("DIVIDE", self.opacity, ALPHA_MIN), 1.0)
        self.reach = write.math("SQRT", write.math("MULTIPLY", 2.0, write.math("LOGARITHM", ratio, math.e)))

    @property
    def direction(self) -> Value:
        """Unit vector from the camera to the centre, in the axes in which the Gaussians were made."""
        write = self._write
        eye = write.output("FunctionNodeTransformPoint", _ORIGIN, self._camera.to_object)
        ray = write.vector_math("SUBTRACT", self.position, eye)
        unframed = write.output("FunctionNodeInvertMatrix", self.frame)
        return write.vector_math("NORMALIZE", write.output("FunctionNodeTransformDirection", ray, unframed))

    def ellipsoid(self, dilation: Value) -> Value:
        """Matrix that takes the unit sphere to the ellipsoid, grown by the low-pass at this depth."""
        write, camera = self._write, self._camera
        pixel_area = write.math("MULTIPLY", self._pixel(camera.pixel_angle_x), self._pixel(camera.pixel_angle_y))
        growth = write.math("MULTIPLY", dilation, pixel_area)
        variance = write.vector_math("MULTIPLY", self.scale, self.scale)
        grown = write.vector_math("ADD", variance, write.combine(growth, growth, growth))
        roots = write.combine(*(write.math("SQRT", component) for component in write.separate(grown)))
        radii = write.output("ShaderNodeVectorMath", roots, self.reach, operation="SCALE")
        shape = write.output("FunctionNodeCombineTransform", _ORIGIN, self.rotation, radii)
        to_center = write.output("FunctionNodeCombineTransform", self.position)
        return write.multiply_matrices(to_center, self.frame, shape)

    def disc(self, dilation: Value) -> Value:
        """Matrix that takes the unit disc to the Gaussian's projection, in the plane of its depth."""
        write, camera = self._write, self._camera
        xx, xy, yy = self._projected_covariance()
        xx = write.math("MULTIPLY_ADD", dilation, self._squared(self._pixel(camera.pixel_angle_x)), xx)
        yy = write.math("MULTIPLY_ADD", dilation, self._squared(self._pixel(camera.pixel_angle_y)), yy)
        # Eigenvalues mean +- spread and the direction of the larger one.
        mean = write.math("MULTIPLY", 0.5, write.sum(xx, yy))
        half_difference = write.math("MULTIPLY", 0.5, write.math("SUBTRACT", xx, yy))
        spread = write.math("SQRT", write.sum(self._squared(half_difference), self._squared(xy)))
        angle = write.math("MULTIPLY", 0.5, write.math("ARCTAN2", xy, half_difference))
        cosine, sine = write.math("COSINE", angle), write.math("SINE", angle)
        major = self._radius(write.sum(mean, spread))
        # Their product is the determinant; mean - spread would lose the minor one to rounding.
        determinant = write.math("SUBTRACT", write.math("MULTIPLY", xx, yy), self._squared(xy))
        minor = self._radius(write.math("DIVIDE", determinant, write.sum(mean, spread)))
        backwards = write.math("MULTIPLY", -1.0, minor)
        in_camera = write.matrix(
            (write.math("MULTIPLY", major, cosine), write.math("MULTIPLY", major, sine), 0.0),
            (write.math("MULTIPLY", backwards, sine), write.math("MULTIPLY", minor, cosine), 0.0),
            (0.0, 0.0, minor),  # any third axis: the disc is flat, but the matrix has to be invertible
            write.separate(self.center),
        )
        return write.multiply_matrices(camera.to_object, in_camera)

    def _projected_covariance(self) -> tuple[Value, Value, Value]:
        """xx, xy and yy of the covariance J W S W^T J^T, J scaled by the depth so that it is in scene units."""
        write, camera = self._write, self._camera
        x, y, _ = write.separate(self.center)
        tangent_x = self._clamped(write.math("DIVIDE", x, self.depth), camera.limits_x)
        tangent_y = self._clamped(write.math("DIVIDE", y, self.depth), camera.limits_y)
        to_camera = write.multiply_matrices(camera.from_object, self.frame)
        columns = []
        for axis, deviation in zip((_X, _Y, _Z), write.separate(self.scale), strict=True):
            direction = write.output("FunctionNodeRotateVector", axis, self.rotation)
            direction = write.output("FunctionNodeTransformDirection", direction, to_camera)
            dx, dy, dz = (write.math("MULTIPLY", deviation, component) for component in write.separate(direction))
            # x / depth changes by (dx + tangent dz) / depth: z points backwards.
            u, v = write.math("MULTIPLY_ADD", tangent_x, dz, dx), write.math("MULTIPLY_ADD", tangent_y, dz, dy)
            columns.append((u, v))
        xx = write.sum(*(self._squared(u) for u, _ in columns))
        xy = write.sum(*(write.math("MULTIPLY", u, v) for u, v in columns))
        yy = write.sum(*(self._squared(v) for _, v in columns))
        return xx, xy, yy

    def _pixel(self, angle: Value) -> Value:
        """Size of a pixel at the depth of the centre, in scene units."""
        return self._write.math("MULTIPLY", self.depth, angle)

    def _radius(self, variance: Value) -> Value:
        write = self._write
        return write.math("MULTIPLY", self.reach, write.math("SQRT", write.math("MAXIMUM", variance, 0.0)))

    def _squared(self, value: Value) -> Value:
        return self._write.math("MULTIPLY", value, value)

    def _clamped(self, value: Value, limits: tuple[Value, ...]) -> Value:
        return self._write.output("ShaderNodeClamp", value, *limits)


def _frame(write: NodeWriter, points: Value) -> Value:
    """Matrix of the linear map that the frame's points went through since they were made; identity without a frame."""
    number = write.attribute("INT", Attribute.FRAME).outputs["Attribute"]
    position = write.output("GeometryNodeInputPosition")

    def mean(field: Value, which: int) -> Value:
        selection = write.output("FunctionNodeCompare", number, which, data_type="INT", operation="EQUAL")
        kind = "GeometryNodeAttributeStatistic"
        return write.output(kind, points, selection, field, name="Mean", data_type="FLOAT_VECTOR")

    origin = mean(position, Frame.ORIGIN)
    size = write.separate(mean(write.attribute("FLOAT_VECTOR", Attribute.SCALE).outputs["Attribute"], Frame.ORIGIN))[0]
    columns: list[Sequence[Value]] = []
    for which in (Frame.X, Frame.Y, Frame.Z):
        edge = write.vector_math("SUBTRACT", mean(position, which), origin)
        columns.append(write.separate(write.vector_math("DIVIDE", edge, write.combine(size, size, size))))
    moved = write.matrix(*columns, _ORIGIN)
    invertible = write.output("FunctionNodeInvertMatrix", moved, name="Invertible")
    identity = write.output("FunctionNodeCombineTransform")
    return write.switch("MATRIX", invertible, identity, moved)


def _icosphere(write: NodeWriter, material: bpy.types.Material) -> Value:
    mesh = write.output("GeometryNodeMeshIcoSphere", ICOSPHERE_RADIUS, 1)
    return write.output("GeometryNodeSetMaterial", mesh, True, material)


def _disc(write: NodeWriter, material: bpy.types.Material) -> Value:
    mesh = write.output("GeometryNodeMeshCircle", DISC_CORNERS, DISC_RADIUS, fill_type="NGON")
    return write.output("GeometryNodeSetMaterial", mesh, True, material)


def _color(
    write: NodeWriter, inputs: dict[str, bpy.types.NodeSocket], direction: Value | None, sh_degree: int
) -> Value:
    """The colour to show, as trained or converted to scene-linear light."""
    original = write.attribute("FLOAT_COLOR", color_attribute(ORIGINAL)).outputs["Attribute"]
    if direction is not None:
        total = write.vector_math("ADD", original, view_dependent_part(write, direction, sh_degree))
        original = write.vector_math("MAXIMUM", total, _ORIGIN)
    layer = write.attribute("FLOAT_COLOR", inputs[Input.LAYER])
    # The original's attribute is only the constant part of its colour.
    is_other = write.output(
        "FunctionNodeCompare",
        inputs[Input.LAYER],
        color_attribute(ORIGINAL),
        data_type="STRING",
        operation="NOT_EQUAL",
    )
    is_layer = write.both(layer.outputs["Exists"], is_other)
    enhanced = write.switch("RGBA", is_layer, original, layer.outputs["Attribute"])
    encoded = write.mix("RGBA", inputs[Input.ENHANCED], original, enhanced)
    channels = [_decoded(write, channel) for channel in write.separate(encoded)]
    return write.switch("RGBA", inputs[Input.SCENE_LINEAR], encoded, write.combine(*channels))


def _decoded(write: NodeWriter, value: Value) -> Value:
    """Scene-linear light of an sRGB value (IEC 61966-2-1)."""
    power = write.math("POWER", write.math("DIVIDE", write.sum(value, 0.055), 1.055), 2.4)
    is_dark = write.compare("LESS_EQUAL", value, 0.04045)
    return write.switch("FLOAT", is_dark, power, write.math("DIVIDE", value, 12.92))
