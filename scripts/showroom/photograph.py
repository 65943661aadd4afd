"""Photographs the set that stands in the current Blender scene: images, depth maps, sparse points. bpy and numpy."""

from __future__ import annotations

from pathlib import Path

import bpy
import mathutils
import numpy as np
from mathutils.bvhtree import BVHTree
from numpy.typing import NDArray

from ...core.errors import InputError
from .cameras import SENSOR_WIDTH, Pose, pixel_centres, pixel_directions
from .settings import CameraSettings, CaptureSettings

# Indirect light above this is cut: fireflies cannot be reconstructed, and no fabric shows so bright a reflection.
CLAMP_INDIRECT = 4.0


def set_up_camera(settings: CameraSettings) -> bpy.types.Object:
    """The scene's camera: a square-pixel pinhole with its principal point in the centre."""
    scene = bpy.context.scene
    data = bpy.data.cameras.new("photographer")
    data.sensor_fit, data.sensor_width, data.lens = "HORIZONTAL", SENSOR_WIDTH, settings.focal_length
    data.clip_end = 100.0
    camera = bpy.data.objects.new(data.name, data)
    scene.collection.objects.link(camera)
    scene.camera = camera
    scene.render.resolution_x, scene.render.resolution_y = settings.width, settings.height
    scene.render.resolution_percentage = 100
    return camera


def place(camera: bpy.types.Object, pose: Pose) -> None:
    """Move the camera to `pose` and update the dependency graph."""
    camera.matrix_world = mathutils.Matrix(pose.camera_to_world.tolist())
    bpy.context.view_layer.update()


def set_up_render(settings: CaptureSettings, threads: int) -> None:
    """Cycles on the CPU, denoised, and the sRGB display transform, so that pixels are display-referred sRGB.

    Args:
        threads: to render with; 0 uses all cores. It does not change the image.
    """
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.device = "CPU"
    cycles.seed = settings.seed
    cycles.samples = settings.samples
    cycles.use_adaptive_sampling = False
    cycles.use_denoising, cycles.denoiser = True, "OPENIMAGEDENOISE"
    # Albedo and normals free of noise keep the yarns sharp.
    cycles.denoising_input_passes, cycles.denoising_prefilter = "RGB_ALBEDO_NORMAL", "ACCURATE"
    cycles.max_bounces, cycles.diffuse_bounces, cycles.glossy_bounces = 4, 2, 2
    cycles.transmission_bounces, cycles.transparent_max_bounces = 3, 12
    cycles.caustics_reflective = cycles.caustics_refractive = False
    cycles.sample_clamp_indirect = CLAMP_INDIRECT
    render = scene.render
    render.use_persistent_data = True
    render.threads_mode, render.threads = ("FIXED", threads) if threads else ("AUTO", 1)
    render.dither_intensity = 0.0
    render.film_transparent = False
    scene.display_settings.display_device = "sRGB"
    scene.view_settings.view_transform, scene.view_settings.look = "Standard", "None"
    scene.view_settings.exposure, scene.view_settings.gamma = 0.0, 1.0
    if bpy.app.version >= (5, 0):
        render.image_settings.media_type = "IMAGE"
    render.image_settings.file_format = "JPEG"
    render.image_settings.color_mode = "RGB"
    render.image_settings.quality = settings.jpeg_quality


def render_view(camera: bpy.types.Object, pose: Pose, path: Path) -> None:
    """Render one photograph into a JPEG file.

    Raises:
        InputError: the file cannot be written.
    """
    place(camera, pose)
    bpy.context.scene.render.filepath = str(path)
    bpy.context.scene.render.use_file_extension = False
    try:
        bpy.ops.render.render(write_still=True)
    except RuntimeError:
        raise InputError("the image cannot be written", where=path, remedy="check space and permissions") from None


def read_image(path: Path) -> NDArray[np.float32]:
    """(H, W, 3) encoded values in [0, 1] of an 8-bit image, row 0 at the top."""
    image = bpy.data.images.load(str(path))
    try:
        width, height = image.size
        pixels = np.empty(width * height * image.channels, np.float32)
        image.pixels.foreach_get(pixels)
    finally:
        bpy.data.images.remove(image)
    return pixels.reshape(height, width, -1)[::-1, :, :3].copy()


class Surfaces:
    """All surfaces of the scene, with modifiers applied, for casting rays: depth without sampling noise."""

    def __init__(self) -> None:
        graph = bpy.context.evaluated_depsgraph_get()
        vertices: list[NDArray[np.float64]] = []
        triangles: list[NDArray[np.int32]] = []
        start = 0
        for obj in bpy.context.scene.objects:
            if obj.type != "MESH" or obj.hide_render:
                continue
            evaluated = obj.evaluated_get(graph)
            mesh = evaluated.to_mesh()
            mesh.calc_loop_triangles()
            corners = np.empty(len(mesh.vertices) * 3, np.float32)
            mesh.vertices.foreach_get("co", corners)
            indices = np.empty(len(mesh.loop_triangles) * 3, np.int32)
            mesh.loop_triangles.foreach_get("vertices", indices)
            to_world = np.array(obj.matrix_world)
            vertices.append(corners.reshape(-1, 3) @ to_world[:3, :3].T + to_world[:3, 3])
            triangles.append(indices.reshape(-1, 3) + start)
            start += len(vertices[-1])
            evaluated.to_mesh_clear()
        self._tree = BVHTree.FromPolygons(
            np.concatenate(vertices).tolist(), np.concatenate(triangles).tolist(), all_triangles=True
        )

    def cast(self, pose: Pose, settings: CameraSettings, pixels: NDArray[np.floating]) -> NDArray[np.float64]:
        """Planar depth (N,) of the first surface that (N, 2) pixel positions (x, y) see; infinite where there is none.

        Organza counts as a surface.
        """
        rotation, eye = pose.camera_to_world[:3, :3], pose.camera_to_world[:3, 3]
        rays = pixel_directions(settings, pixels)
        # The distance along a ray, whose direction Blender normalises, times this is the planar depth.
        planar = 1.0 / np.linalg.norm(rays, axis=1)
        origin, cast = tuple(eye), self._tree.ray_cast
        hits = [cast(origin, direction)[3] for direction in (rays @ rotation.T).tolist()]
        return planar * np.array([np.inf if distance is None else distance for distance in hits])

    def depth_map(self, pose: Pose, settings: CameraSettings) -> NDArray[np.float64]:
        """(H, W) planar depth in metres at the pixel centres."""
        return self.cast(pose, settings, pixel_centres(settings)).reshape(settings.height, settings.width)


def sparse_points(
    surfaces: Surfaces, poses: list[Pose], images: list[Path], settings: CaptureSettings
) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Points such as structure from motion finds: more where there is texture, slightly off, with their photo's colour.

    Returns:
        (P, 3) positions in metres and (P, 3) sRGB colours.
    """
    rng = np.random.default_rng(settings.seed + 1)
    counts = np.bincount(np.arange(settings.points) % len(poses), minlength=len(poses))
    positions, colors = [], []
    for pose, path, count in zip(poses, images, counts, strict=True):
        image = read_image(path)
        rows, columns = _textured_pixels(image, count, rng)
        centres = np.stack([columns, rows], axis=-1) + 0.5
        depth = surfaces.cast(pose, settings.cameras, centres)
        seen = np.isfinite(depth)
        rays = pixel_directions(settings.cameras, centres) @ pose.camera_to_world[:3, :3].T
        exact = pose.camera_to_world[:3, 3] + rays[seen] * depth[seen, None]
        positions.append(exact + rng.standard_normal(exact.shape) * settings.point_noise * depth[seen, None])
        colors.append(np.rint(image[rows, columns][seen] * 255))
    return np.concatenate(positions).astype(np.float32), np.concatenate(colors).astype(np.uint8)


def _textured_pixels(
    image: NDArray[np.float32], count: int, rng: np.random.Generator
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns of `count` pixels (or all) drawn by their local contrast, and a third of them anywhere."""
    gray = image.mean(axis=-1)
    contrast = np.hypot(*np.gradient(gray)).ravel()
    everywhere = np.full(contrast.size, 1.0 / contrast.size)
    weight = everywhere / 3 + contrast / max(float(contrast.sum()), 1e-9) * 2 / 3
    chosen = rng.choice(contrast.size, size=min(count, contrast.size), replace=False, p=weight / weight.sum())
    return np.divmod(chosen, gray.shape[1])
