"""Geometry nodes that project Gaussians: the active camera, and the hulls' places in front of it.

Fields, the same on the points and on the instances made of them; see `splat_nodes` for what they are for.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import bpy

from .nodes import NodeWriter, Sockets, Value
from .splat_attributes import Attribute, Frame

ALPHA_MIN = 1.0 / 255.0  # what is less opaque is not drawn
FIELD_MARGIN = 0.3  # the projection is linearised within the image and this many half widths around (Kerbl et al. 2023)

_X, _Y, _Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
_ORIGIN = (0.0, 0.0, 0.0)


class Camera(NamedTuple):
    """Sockets that describe the active camera, seen from the object that carries the Gaussians.

    Attributes:
        to_object: matrix from camera space (x right, y up, z backwards) to the object's.
        from_object: its inverse.
        pixel_angle_x, pixel_angle_y: width and height of a pixel at depth 1.
        low_x, high_x, low_y, high_y: lowest and highest tangents at which the projection is linearised.
        clip_start: nearest visible depth.
        is_perspective: boolean.
    """

    to_object: bpy.types.NodeSocket
    from_object: bpy.types.NodeSocket
    pixel_angle_x: bpy.types.NodeSocket
    pixel_angle_y: bpy.types.NodeSocket
    low_x: bpy.types.NodeSocket
    high_x: bpy.types.NodeSocket
    low_y: bpy.types.NodeSocket
    high_y: bpy.types.NodeSocket
    clip_start: bpy.types.NodeSocket
    is_perspective: bpy.types.NodeSocket


def add_camera_nodes(write: NodeWriter, width: bpy.types.NodeSocket, height: bpy.types.NodeSocket) -> Camera:
    """The active camera, for renders of the given size in pixels."""
    return Camera(**write.nested("CVD Camera", _camera, {"width": width, "height": height}))


def add_frame_nodes(write: NodeWriter, points: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    """Matrix of the linear map that the frame's points went through since they were made; identity without a frame."""
    return write.nested("CVD Frame", _frame, {"points": points})["matrix"]


def add_hull_nodes(
    write: NodeWriter, camera: Camera, frame: bpy.types.NodeSocket, dilation: bpy.types.NodeSocket
) -> tuple[bpy.types.NodeSocket, bpy.types.NodeSocket]:
    """Matrices that take the unit sphere to the ellipsoid, and the unit disc to the projection."""
    inputs = {**camera._asdict(), "frame": frame, "dilation": dilation}
    ellipsoid = write.nested("CVD Gaussian Ellipsoid", _ellipsoid, inputs)["matrix"]
    return ellipsoid, write.nested("CVD Gaussian Disc", _disc, inputs)["matrix"]


def _ellipsoid(write: NodeWriter, inputs: Sockets) -> Mapping[str, Value]:
    splat = Splat(write, _camera_of(inputs), inputs["frame"])
    return {"matrix": splat.ellipsoid(inputs["dilation"])}


def _disc(write: NodeWriter, inputs: Sockets) -> Mapping[str, Value]:
    splat = Splat(write, _camera_of(inputs), inputs["frame"])
    return {"matrix": splat.disc(inputs["dilation"])}


def _camera_of(inputs: Sockets) -> Camera:
    return Camera(**{name: inputs[name] for name in Camera._fields})


def _camera(write: NodeWriter, inputs: Sockets) -> Mapping[str, Value]:
    active = write.output("GeometryNodeInputActiveCamera")
    info = write.node("GeometryNodeCameraInfo", active)
    to_object = write.output("GeometryNodeObjectInfo", active, name="Transform", transform_space="RELATIVE")
    # The projection matrix knows lens, sensor, shift and aspects: x_ndc = P00 tangent_x - P02, within -1 and 1.
    entries = write.node("FunctionNodeSeparateMatrix", info.outputs["Projection Matrix"]).outputs
    half_field_x = write.math("DIVIDE", 1.0, entries["Column 1 Row 1"])
    half_field_y = write.math("DIVIDE", 1.0, entries["Column 2 Row 2"])
    low_x, high_x = _tangent_limits(write, half_field_x, entries["Column 3 Row 1"])
    low_y, high_y = _tangent_limits(write, half_field_y, entries["Column 3 Row 2"])
    return {
        "to_object": to_object,
        "from_object": write.output("FunctionNodeInvertMatrix", to_object),
        "pixel_angle_x": write.math("DIVIDE", write.math("MULTIPLY", 2.0, half_field_x), inputs["width"]),
        "pixel_angle_y": write.math("DIVIDE", write.math("MULTIPLY", 2.0, half_field_y), inputs["height"]),
        "low_x": low_x,
        "high_x": high_x,
        "low_y": low_y,
        "high_y": high_y,
        "clip_start": info.outputs["Clip Start"],
        "is_perspective": write.output("FunctionNodeBooleanMath", info.outputs["Is Orthographic"], operation="NOT"),
    }


def _tangent_limits(write: NodeWriter, half_field: Value, shift: Value) -> tuple[bpy.types.NodeSocket, ...]:
    bounds = (-1.0 - FIELD_MARGIN, 1.0 + FIELD_MARGIN)
    return tuple(write.math("MULTIPLY", half_field, write.math("ADD", shift, bound)) for bound in bounds)


def _frame(write: NodeWriter, inputs: Sockets) -> Mapping[str, Value]:
    points = inputs["points"]
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
    return {"matrix": write.switch("MATRIX", invertible, identity, moved)}


class Splat:
    """Sockets of one Gaussian's hull: fields, the same on the points and on the instances made of them."""

    def __init__(self, write: NodeWriter, camera: Camera, frame: Value) -> None:
        self._write = write
        self._camera = camera
        self.position = write.output("GeometryNodeInputPosition")
        self.center = write.output("FunctionNodeTransformPoint", self.position, camera.from_object)
        self.depth = write.math("MULTIPLY", -1.0, write.separate(self.center)[2])
        self.scale = write.attribute("FLOAT_VECTOR", Attribute.SCALE).outputs["Attribute"]
        self.rotation = write.attribute("QUATERNION", Attribute.ROTATION).outputs["Attribute"]
        self.opacity = write.attribute("FLOAT", Attribute.OPACITY).outputs["Attribute"]
        self.frame = frame

    @property
    def reach(self) -> Value:
        """Radius at which o exp(-r^2 / 2) = ALPHA_MIN, in standard deviations: r = sqrt(2 ln(o / ALPHA_MIN))."""
        write = self._write
        ratio = write.math("MAXIMUM", write.math("DIVIDE", self.opacity, ALPHA_MIN), 1.0)
        return write.math("SQRT", write.math("MULTIPLY", 2.0, write.math("LOGARITHM", ratio, math.e)))

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
        grown = write.vector_math("ADD", variance, write.combine(*self._in_own_units(growth)))
        roots = write.combine(*(write.math("SQRT", component) for component in write.separate(grown)))
        radii = write.output("ShaderNodeVectorMath", roots, self.reach, operation="SCALE")
        shape = write.output("FunctionNodeCombineTransform", _ORIGIN, self.rotation, radii)
        to_center = write.output("FunctionNodeCombineTransform", self.position)
        return write.multiply_matrices(to_center, self.frame, shape)

    def _in_own_units(self, variance: Value) -> list[Value]:
        """What becomes `variance` in camera space across each of the Gaussian's axes once object and frame resize it.

        By the planes across the axes, which turn by the inverse transpose: what is thin is a disc, and its thickness
        counts. Where the map is uneven and shears, what is thin along two axes still differs a little.
        """
        write = self._write
        to_camera = write.multiply_matrices(self._camera.from_object, self.frame)
        normals = write.output("FunctionNodeTransposeMatrix", write.output("FunctionNodeInvertMatrix", to_camera))
        resized = []
        for axis in (_X, _Y, _Z):
            direction = write.output("FunctionNodeRotateVector", axis, self.rotation)
            across = write.output("FunctionNodeTransformDirection", direction, normals)
            resized.append(write.math("MULTIPLY", variance, write.vector_math("DOT_PRODUCT", across, across)))
        return resized

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
        tangent_x = self._clamped(write.math("DIVIDE", x, self.depth), camera.low_x, camera.high_x)
        tangent_y = self._clamped(write.math("DIVIDE", y, self.depth), camera.low_y, camera.high_y)
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

    def _clamped(self, value: Value, low: Value, high: Value) -> Value:
        return self._write.output("ShaderNodeClamp", value, low, high)
