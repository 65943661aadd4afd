"""Cycles materials of the showroom: woven cloth, satin, organza, plaster, wood. bpy and numpy.

All UV maps are in metres, so a texture's scale is one over the size of its repeat.
"""

from __future__ import annotations

from typing import TypeAlias

import bpy
import numpy as np
from numpy.typing import NDArray

from .weaves import Weave

Node: TypeAlias = bpy.types.ShaderNode


def _new(name: str) -> tuple[bpy.types.Material, bpy.types.NodeTree, Node]:
    """A material, its tree and its Principled BSDF node."""
    material = bpy.data.materials.new(name)
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    tree = material.node_tree
    return material, tree, next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")


def _image(name: str, pixels: NDArray[np.floating], linear_data: bool) -> bpy.types.Image:
    """A packed float image of (H, W) or (H, W, 3) values; colours are linear sRGB."""
    if pixels.ndim == 2:
        pixels = np.repeat(pixels[..., None], 3, axis=-1)
    height, width = pixels.shape[:2]
    image = bpy.data.images.new(name, width, height, alpha=False, float_buffer=True)
    image.colorspace_settings.name = "Non-Color" if linear_data else "Linear Rec.709"
    rgba = np.ones((height, width, 4), np.float32)
    rgba[..., :3] = pixels
    image.pixels.foreach_set(rgba.ravel())
    image.update()
    image.pack()
    return image


def _texture(tree: bpy.types.NodeTree, image: bpy.types.Image, weave: Weave, turn: float) -> Node:
    """An image texture node that repeats every `weave.width` x `weave.depth` metres, turned by `turn` radians."""
    coordinates = tree.nodes.new("ShaderNodeTexCoord")
    turned = tree.nodes.new("ShaderNodeMapping")
    turned.inputs["Rotation"].default_value[2] = turn
    scaled = tree.nodes.new("ShaderNodeMapping")
    scaled.inputs["Scale"].default_value = (1 / weave.width, 1 / weave.depth, 1.0)
    node = tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    tree.links.new(coordinates.outputs["UV"], turned.inputs["Vector"])
    tree.links.new(turned.outputs["Vector"], scaled.inputs["Vector"])
    tree.links.new(scaled.outputs["Vector"], node.inputs["Vector"])
    return node


def woven(name: str, weave: Weave, relief: float = 0.35, turn: float = 0.0, sheen: float = 0.08) -> bpy.types.Material:
    """Matt cloth with the weave's colours, and bumps as high as `relief` yarn widths."""
    material, tree, shader = _new(name)
    color = _texture(tree, _image(f"{name} albedo", weave.albedo, False), weave, turn)
    height = _texture(tree, _image(f"{name} height", weave.height, True), weave, turn)
    bump = tree.nodes.new("ShaderNodeBump")
    bump.inputs["Distance"].default_value = relief * weave.yarn
    tree.links.new(height.outputs["Color"], bump.inputs["Height"])
    tree.links.new(color.outputs["Color"], shader.inputs["Base Color"])
    tree.links.new(bump.outputs["Normal"], shader.inputs["Normal"])
    shader.inputs["Roughness"].default_value = 0.9
    shader.inputs["Specular IOR Level"].default_value = 0.15
    shader.inputs["Sheen Weight"].default_value = sheen
    shader.inputs["Sheen Roughness"].default_value = 0.6
    return material


def satin(name: str, color: NDArray[np.floating], roughness: float) -> bpy.types.Material:
    """Satin: long floats along v reflect in a streak across it (anisotropic), the colour of the yarn itself."""
    material, tree, shader = _new(name)
    shader.inputs["Base Color"].default_value = (*color, 1.0)
    shader.inputs["Roughness"].default_value = roughness
    # Filament yarn reflects in its own colour, as metals do, from a part of its surface.
    shader.inputs["Metallic"].default_value = 0.45
    shader.inputs["Anisotropic"].default_value = 0.6
    tangent = tree.nodes.new("ShaderNodeTangent")
    tangent.direction_type = "UV_MAP"
    tangent.uv_map = "UVMap"
    tree.links.new(tangent.outputs["Tangent"], shader.inputs["Tangent"])
    return material


def organza(name: str, color: NDArray[np.floating], opacity: float) -> bpy.types.Material:
    """A sheer: `opacity` of the light meets thread, half of it passes through; denser where seen along the cloth."""
    material, tree, shader = _new(name)
    tree.nodes.remove(shader)
    output = next(node for node in tree.nodes if node.type == "OUTPUT_MATERIAL")
    thread_color = (*color, 1.0)
    front, through, clear = (
        tree.nodes.new(kind)
        for kind in ("ShaderNodeBsdfDiffuse", "ShaderNodeBsdfTranslucent", "ShaderNodeBsdfTransparent")
    )
    front.inputs["Color"].default_value = through.inputs["Color"].default_value = thread_color
    thread, cloth = tree.nodes.new("ShaderNodeMixShader"), tree.nodes.new("ShaderNodeMixShader")
    thread.inputs["Fac"].default_value = 0.5
    # Seen at an angle the path through the threads grows: 1 - (1 - opacity)^(1 / cos), flattened by Layer Weight.
    facing = tree.nodes.new("ShaderNodeLayerWeight")
    facing.inputs["Blend"].default_value = 0.25
    density = tree.nodes.new("ShaderNodeMapRange")
    density.inputs["To Min"].default_value = opacity
    density.inputs["To Max"].default_value = opacity + (1 - opacity) * 0.6 if opacity > 0 else 0.0
    tree.links.new(facing.outputs["Facing"], density.inputs["Value"])
    tree.links.new(front.outputs["BSDF"], thread.inputs[1])
    tree.links.new(through.outputs["BSDF"], thread.inputs[2])
    tree.links.new(density.outputs["Result"], cloth.inputs["Fac"])
    tree.links.new(clear.outputs["BSDF"], cloth.inputs[1])
    tree.links.new(thread.outputs["Shader"], cloth.inputs[2])
    tree.links.new(cloth.outputs["Shader"], output.inputs["Surface"])
    return material


def plaster(name: str, color: NDArray[np.floating], mottling: float = 0.05, scale: float = 4.0) -> bpy.types.Material:
    """Trowelled lime plaster: soft clouds of brightness and a fine bump, in object space."""
    material, tree, shader = _new(name)
    _mottle(tree, shader, color, mottling, scale, stretch=(1.0, 1.0, 1.6), bump=0.003)
    shader.inputs["Roughness"].default_value = 0.9
    shader.inputs["Specular IOR Level"].default_value = 0.15
    return material


def wood(name: str, color: NDArray[np.floating], grain: tuple[float, float, float]) -> bpy.types.Material:
    """Oiled wood: noise stretched along the grain; `grain` scales x, y and z (small along the grain)."""
    material, tree, shader = _new(name)
    _mottle(tree, shader, color, 0.20, 6.0, stretch=grain, bump=0.0006)
    shader.inputs["Roughness"].default_value = 0.7
    shader.inputs["Specular IOR Level"].default_value = 0.25
    return material


def plain(name: str, color: NDArray[np.floating], roughness: float = 0.8) -> bpy.types.Material:
    """One colour, matt."""
    material, _, shader = _new(name)
    shader.inputs["Base Color"].default_value = (*color, 1.0)
    shader.inputs["Roughness"].default_value = roughness
    shader.inputs["Specular IOR Level"].default_value = 0.2
    return material


def mirror(name: str) -> bpy.types.Material:
    """Silvered glass."""
    material, _, shader = _new(name)
    shader.inputs["Base Color"].default_value = (0.9, 0.92, 0.91, 1.0)
    shader.inputs["Metallic"].default_value = 1.0
    shader.inputs["Roughness"].default_value = 0.0
    return material


def glowing(name: str, color: NDArray[np.floating], strength: float) -> bpy.types.Material:
    """A surface that shines in one colour, `strength` times as bright as lit white."""
    material, _, shader = _new(name)
    shader.inputs["Base Color"].default_value = (0.0, 0.0, 0.0, 1.0)
    shader.inputs["Emission Color"].default_value = (*color, 1.0)
    shader.inputs["Emission Strength"].default_value = strength
    return material


def _mottle(
    tree: bpy.types.NodeTree,
    shader: Node,
    color: NDArray[np.floating],
    amount: float,
    scale: float,
    stretch: tuple[float, float, float],
    bump: float,
) -> None:
    """Vary the base colour by +-`amount` with fractal noise and emboss the surface by `bump` metres."""
    coordinates = tree.nodes.new("ShaderNodeTexCoord")
    mapping = tree.nodes.new("ShaderNodeMapping")
    mapping.inputs["Scale"].default_value = stretch
    noise = tree.nodes.new("ShaderNodeTexNoise")
    noise.inputs["Scale"].default_value = scale
    noise.inputs["Detail"].default_value = 6.0
    noise.inputs["Roughness"].default_value = 0.6
    ramp = tree.nodes.new("ShaderNodeValToRGB")
    color = np.asarray(color)
    for element, position, gain in zip(ramp.color_ramp.elements, (0.3, 0.7), (1 - amount, 1 + amount), strict=True):
        element.position = position
        element.color = (*np.clip(color * gain, 0, 1), 1.0)
    relief = tree.nodes.new("ShaderNodeBump")
    relief.inputs["Distance"].default_value = bump
    tree.links.new(coordinates.outputs["Object"], mapping.inputs["Vector"])
    tree.links.new(mapping.outputs["Vector"], noise.inputs["Vector"])
    fraction = noise.outputs[0]
    tree.links.new(fraction, ramp.inputs["Fac"])
    tree.links.new(ramp.outputs["Color"], shader.inputs["Base Color"])
    tree.links.new(fraction, relief.inputs["Height"])
    tree.links.new(relief.outputs["Normal"], shader.inputs["Normal"])
