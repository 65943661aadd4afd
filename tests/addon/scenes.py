"""Small scenes for the tests of Blender's side, and their pixels."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

from cvdgs.core.capture.model import PinholeCamera
from cvdgs.core.splats.gaussians import SH_C0, Gaussians
from cvdgs.core.splats.io.ply import write_ply
from cvdgs.cvdgs_addon.scene.cameras import Clip, add_camera, use_camera
from cvdgs.cvdgs_addon.scene.splat_attributes import Attribute
from cvdgs.cvdgs_addon.scene.splats import add_gaussians

CAMERA = PinholeCamera(64, 48, 56.0, 70.0, 30.0, 26.0)
"""With fx != fy and an off-centre principal point."""

CLIP = Clip(0.05, 100.0)


def cloud(count: int, seed: int = 0, size: float = 0.12) -> Gaussians:
    """Gaussians of random shape, opacity and colour in a cube of side two; many overlap."""
    random = np.random.default_rng(seed)
    colors = random.uniform(0.0, 1.0, (count, 3))
    return Gaussians(
        means=random.uniform(-1.0, 1.0, (count, 3)).astype(np.float32),
        log_scales=np.log(size * random.uniform(0.1, 1.0, (count, 3))).astype(np.float32),
        quaternions=random.standard_normal((count, 4)).astype(np.float32),
        opacity_logits=random.uniform(-3.0, 4.0, count).astype(np.float32),
        sh=((colors - 0.5) / SH_C0).astype(np.float32)[:, None, :],
    )


def take(gaussians: Gaussians, indices: Iterable[int]) -> Gaussians:
    """Some of the Gaussians."""
    return gaussians.take(np.array(list(indices), int))


def drawn_points(target: bpy.types.Object) -> tuple[np.ndarray, np.ndarray]:
    """(N, 3) positions and colours of the points that the object's modifier makes."""
    geometry = target.evaluated_get(bpy.context.evaluated_depsgraph_get()).evaluated_geometry()
    count = len(geometry.pointcloud.points)
    positions, colors = np.empty(count * 3, np.float32), np.empty(count * 4, np.float32)
    geometry.pointcloud.points.foreach_get("co", positions)
    geometry.pointcloud.attributes[Attribute.DRAWN_COLOR].data.foreach_get("color", colors)
    return positions.reshape(-1, 3), colors.reshape(-1, 4)[:, :3]


def look_at(eye: Iterable[float], target: Iterable[float] = (0.0, 0.0, 0.0)) -> NDArray[np.float64]:
    """(4, 4) OpenGL camera-to-world matrix with +Z up."""
    eye, target = np.array(list(eye), np.float64), np.array(list(target), np.float64)
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :4] = np.stack([right, np.cross(right, forward), -forward, eye], axis=1)
    return pose


def ring_view(angle: float) -> NDArray[np.float64]:
    """A camera of a ring around the cloud."""
    return look_at((3.5 * np.cos(angle), 3.5 * np.sin(angle), 1.2))


def opencv(camera_to_world: NDArray[np.float64]) -> NDArray[np.float64]:
    """World-to-camera matrix in OpenCV axes of an OpenGL camera-to-world matrix."""
    return np.linalg.inv(camera_to_world @ np.diag([1.0, -1.0, -1.0, 1.0]))


def look_through(
    scene: bpy.types.Scene, camera: PinholeCamera, camera_to_world: NDArray[np.float64]
) -> bpy.types.Object:
    """Add a camera and make it the scene's."""
    added = add_camera("view", camera, camera_to_world, CLIP, scene.collection)
    use_camera(scene, added)
    return added


def add_with_inverse(scene: bpy.types.Scene, gaussians: Gaussians, layer: str, pose: NDArray) -> bpy.types.Object:
    """Add `gaussians` with a layer of the inverse colours, seen by `CAMERA` from `pose`."""
    look_through(scene, CAMERA, pose)
    return add_gaussians(gaussians, {layer: 1.0 - gaussians.base_colors}, scene.collection)


def read_png(path: Path) -> NDArray[np.float64]:
    """(H, W, 3) values in [0, 1]."""
    image = bpy.data.images.load(str(path), check_existing=False)
    image.colorspace_settings.name = "Non-Color"
    pixels = np.empty(image.size[0] * image.size[1] * image.channels, np.float32)
    image.pixels.foreach_get(pixels)
    pixels = pixels.reshape(image.size[1], image.size[0], image.channels)
    bpy.data.images.remove(image)
    return pixels[::-1, :, :3].astype(np.float64)


def render_png(scene: bpy.types.Scene, path: Path) -> NDArray[np.float64]:
    """Render the scene to `path`; returns its pixels."""
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    return read_png(path)


def synthetic_run(folder: Path, count: int = 400) -> Path:
    """Write a finished run as the pipeline leaves it."""
    gaussians = cloud(count)
    (folder / "capture" / "images").mkdir(parents=True)
    write_ply(folder / "splats.ply", gaussians)
    write_ply(folder / "splats.deutan-1.0.ply", gaussians.with_base_colors(1.0 - gaussians.base_colors))
    write_ply(folder / "splats.tritan-0.5.ply", gaussians.with_base_colors(gaussians.base_colors[:, ::-1]))
    frames = []
    for index in range(5):
        frames.append(
            {
                "file_path": f"images/view{index}.png",
                "w": CAMERA.width,
                "h": CAMERA.height,
                "fl_x": CAMERA.fx + index,
                "fl_y": CAMERA.fy + index,
                "cx": CAMERA.cx,
                "cy": CAMERA.cy,
                "transform_matrix": ring_view(2.0 * np.pi * index / 5).tolist(),
            }
        )
    document = {"camera_model": "PINHOLE", "frames": frames}
    (folder / "capture" / "transforms.json").write_text(json.dumps(document))
    return folder
