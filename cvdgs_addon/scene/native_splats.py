"""Blender's own Gaussian splats, a type of point cloud from Blender 5.3 on: a copy of what an object shows.

Attributes as Blender's importer makes them: ``position``, ``scale`` (standard deviations), ``rotation`` (wxyz),
``radiance:base`` (the constant coefficients, and the opacity) and ``radiance:sh_<k>``.
"""

from __future__ import annotations

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core.splats.gaussians import Gaussians
from ..export import read_gaussians
from ..shown import shown_layer
from .beside import link_beside
from .splat_attributes import write_attribute

_SPLAT_TYPE = "GAUSSIAN_SPLAT"
_COPY_OF = "cvdgs_copy_of"  # custom property of the point cloud's object: the Gaussians that it copies


def has_native_splats() -> bool:
    """Whether this Blender draws Gaussian splats by itself."""
    return _type_property() is not None and hasattr(bpy.types.PointCloud, "resize")


def why_not_native() -> str:
    """What to tell where it does not."""
    return f"Blender {bpy.app.version_string} has no splats of its own; Blender 5.3 does"


def native_splats_of(splats: bpy.types.Object) -> bpy.types.Object | None:
    """The copy of `splats`, if there is one."""
    return next(filter(is_native_splats, splats.children), None)


def is_native_splats(candidate: bpy.types.Object) -> bool:
    """Whether `candidate` is a copy made by `add_native_splats`, or a duplicate of one."""
    return candidate.type == "POINTCLOUD" and _COPY_OF in candidate


def native_attributes(gaussians: Gaussians) -> dict[str, tuple[str, NDArray[np.float32]]]:
    """Type and values of each attribute beside the position, by name."""
    base = np.concatenate([gaussians.sh[:, 0], gaussians.opacities[:, None]], axis=1)
    rotations = gaussians.quaternions / np.linalg.norm(gaussians.quaternions, axis=1, keepdims=True)
    attributes = {
        "scale": ("FLOAT_VECTOR", np.exp(gaussians.log_scales)),
        "rotation": ("QUATERNION", rotations),
        "radiance:base": ("FLOAT4", base),
    }
    for index in range(1, gaussians.sh.shape[1]):
        attributes[f"radiance:sh_{index - 1}"] = ("FLOAT_VECTOR", gaussians.sh[:, index])
    return {name: (kind, np.ascontiguousarray(values, np.float32)) for name, (kind, values) in attributes.items()}


def add_native_splats(splats: bpy.types.Object) -> bpy.types.Object:
    """Add a copy of what `splats` show, as its child; needs `has_native_splats`."""
    gaussians = read_gaussians(splats, *shown_layer(splats), as_in_viewport=True).gaussians
    type_property = _type_property()
    assert type_property is not None
    cloud = bpy.data.pointclouds.new(f"{splats.name} Native")
    cloud.resize(len(gaussians))
    cloud.points.foreach_set("co", gaussians.means.ravel())
    setattr(cloud, type_property, _SPLAT_TYPE)
    for name, (kind, values) in native_attributes(gaussians).items():
        write_attribute(cloud, name, kind, values)
    copy = bpy.data.objects.new(cloud.name, cloud)
    copy[_COPY_OF] = splats.name
    copy.parent = splats
    link_beside(splats, copy)
    return copy


def _type_property() -> str | None:
    """Name of the point cloud's property that can be `_SPLAT_TYPE`."""
    for candidate in bpy.types.PointCloud.bl_rna.properties:
        if candidate.type == "ENUM" and _SPLAT_TYPE in candidate.enum_items:
            return candidate.identifier
    return None
