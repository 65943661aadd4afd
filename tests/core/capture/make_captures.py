"""Writes small captures in every format that the reader takes, of a scene whose colours are known in closed form.

The scene is the plane z = 4 in front of cameras on the line y = 0, looking along +z, painted with smooth waves.
Photographs are rendered by unprojecting every pixel with pycolmap: they are distorted exactly as the model says.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pycolmap

from cvdgs.core.capture.model import Capture

PLANE_DEPTH = 4.0
WIDTH, HEIGHT = 96, 72
_SUPERSAMPLES = 3


def paint(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """(..., 3) float colours in [0, 255] of points of the plane."""
    return 127.5 + 110.0 * np.stack(
        [np.sin(2.1 * x + 0.4 * y), np.sin(1.7 * y - 0.3 * x + 1.0), np.cos(1.3 * x - 1.9 * y)], axis=-1
    )


def pinhole(width: int = WIDTH, height: int = HEIGHT, focal: float = 80.0, camera_id: int = 1) -> pycolmap.Camera:
    params = [focal, focal, width / 2, height / 2]
    return pycolmap.Camera(camera_id=camera_id, model="PINHOLE", width=width, height=height, params=params)


def with_model(model: str, distortion: list[float], width: int = WIDTH, height: int = HEIGHT) -> pycolmap.Camera:
    """A camera of any COLMAP model with a focal length of 80 pixels and the given further parameters."""
    camera = pycolmap.Camera.create_from_model_name(1, model, 80.0, width, height)
    params = np.array(camera.params)
    if distortion:
        params[-len(distortion) :] = distortion
    camera.params = params
    return camera


def turned(degrees: float) -> np.ndarray:
    """(3, 3) rotation about the camera's x axis."""
    angle = np.radians(degrees)
    return np.array([[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]], float)


@dataclass
class Shot:
    """One photograph of the plane: name, camera and world-to-camera pose."""

    name: str
    camera: pycolmap.Camera
    world_to_camera: np.ndarray

    def colors(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Colours that rays (x, y, 1) of this camera see."""
        rotation, translation = self.world_to_camera[:3, :3], self.world_to_camera[:3, 3]
        directions = np.stack([x, y, np.ones_like(x)], axis=-1) @ rotation
        center = -rotation.T @ translation
        distance = (PLANE_DEPTH - center[2]) / directions[..., 2]
        hit = center + directions * distance[..., None]
        return paint(hit[..., 0], hit[..., 1])

    def render(self) -> np.ndarray:
        """(H, W, 3) uint8, each pixel the mean of 3 x 3 rays through the distorted camera."""
        camera = self.camera
        offsets = (np.arange(_SUPERSAMPLES) + 0.5) / _SUPERSAMPLES
        total = np.zeros((camera.height, camera.width, 3))
        for dy in offsets:
            for dx in offsets:
                u, v = np.meshgrid(np.arange(camera.width) + dx, np.arange(camera.height) + dy)
                rays = camera.cam_ray_from_img(np.column_stack([u.ravel(), v.ravel()]))
                depth = np.where(rays[:, 2] > 1e-3, rays[:, 2], np.nan)
                colors = self.colors(rays[:, 0] / depth, rays[:, 1] / depth)
                total += np.nan_to_num(colors).reshape(total.shape)
        return np.rint(np.clip(total / _SUPERSAMPLES**2, 0, 255)).astype(np.uint8)


def shots(count: int = 3, camera: pycolmap.Camera | None = None, pattern: str = "{:04d}.png") -> list[Shot]:
    """`count` photographs along a line, slightly turned."""
    result = []
    for index in range(count):
        pose = np.eye(4)
        pose[:3, :3] = turned(2.0 * index - 2.0)
        pose[:3, 3] = -pose[:3, :3] @ np.array([0.3 * index, 0.0, 0.0])
        result.append(Shot(pattern.format(index + 1), camera or pinhole(), pose))
    return result


def save(path: Path, pixels: np.ndarray, **attributes: object) -> Path:
    """Write an image in the format of its extension, 8 bit for uint8, 16 bit for uint16, half for float."""
    path.parent.mkdir(parents=True, exist_ok=True)
    pixels = pixels if pixels.ndim == 3 else pixels[..., None]
    kind = {"u1": oiio.UINT8, "u2": oiio.UINT16, "f4": oiio.HALF}[pixels.dtype.str[1:]]
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], kind)
    spec.attribute("oiio:UnassociatedAlpha", 1)
    spec.attribute("CompressionQuality", 98)
    for name, value in attributes.items():
        spec.attribute(name, value)
    file = oiio.ImageOutput.create(str(path))
    assert file.open(str(path), spec), file.geterror()
    assert file.write_image(np.ascontiguousarray(pixels)), file.geterror()
    assert file.close()
    return path


def save_images(folder: Path, photographs: list[Shot]) -> None:
    for shot in photographs:
        save(folder / shot.name, shot.render())


@dataclass
class PlanePoints:
    """Points of the plane and their colours."""

    positions: np.ndarray = field(default_factory=lambda: _grid_of_points())

    @property
    def colors(self) -> np.ndarray:
        return np.rint(paint(self.positions[:, 0], self.positions[:, 1])).astype(np.uint8)


def _grid_of_points() -> np.ndarray:
    x, y = np.meshgrid(np.linspace(-1, 1.5, 6), np.linspace(-1, 1, 5))
    return np.column_stack([x.ravel(), y.ravel(), np.full(x.size, PLANE_DEPTH)])


def reconstruction(photographs: list[Shot], points: PlanePoints | None = None) -> pycolmap.Reconstruction:
    """A COLMAP model in which every photograph sees every point."""
    points = points or PlanePoints()
    model = pycolmap.Reconstruction()
    cameras: dict[int, pycolmap.Camera] = {}
    for shot in photographs:
        if shot.camera.camera_id not in cameras:
            cameras[shot.camera.camera_id] = shot.camera
            model.add_camera_with_trivial_rig(shot.camera)
    for number, shot in enumerate(photographs, start=1):
        image = pycolmap.Image(
            name=shot.name,
            camera_id=shot.camera.camera_id,
            image_id=number,
            points2D=[pycolmap.Point2D(np.array([1.0 + i, 2.0])) for i in range(len(points.positions))],
        )
        pose = pycolmap.Rigid3d(shot.world_to_camera[:3])
        model.add_image_with_trivial_frame(image, pose)
    for index, (position, color) in enumerate(zip(points.positions, points.colors, strict=True)):
        track = pycolmap.Track()
        for number in range(1, len(photographs) + 1):
            track.add_element(number, index)
        model.add_point3D(position, track, color)
    return model


def write_colmap(
    root: Path,
    photographs: list[Shot],
    *,
    model_folder: str = "sparse/0",
    image_folder: str = "images",
    text: bool = False,
    old: bool = False,
    images: bool = True,
) -> Path:
    """A COLMAP capture; `old` as before rigs and frames were added."""
    folder = root / model_folder
    folder.mkdir(parents=True, exist_ok=True)
    model = reconstruction(photographs)
    if text:
        model.write_text(str(folder))
    else:
        model.write_binary(str(folder))
    if old:
        for path in [*folder.glob("rigs.*"), *folder.glob("frames.*")]:
            path.unlink()
    if images:
        save_images(root / image_folder, photographs)
    return root


def opengl_camera_to_world(world_to_camera: np.ndarray) -> list[list[float]]:
    return (np.linalg.inv(world_to_camera) @ np.diag([1.0, -1.0, -1.0, 1.0])).tolist()


def frames(photographs: list[Shot], folder: str = "images/") -> list[dict]:
    return [
        {"file_path": folder + shot.name, "transform_matrix": opengl_camera_to_world(shot.world_to_camera)}
        for shot in photographs
    ]


def intrinsics(camera: pycolmap.Camera) -> dict:
    """A PINHOLE camera as the keys of transforms.json."""
    fx, fy, cx, cy = camera.params[:4]
    return {"w": camera.width, "h": camera.height, "fl_x": fx, "fl_y": fy, "cx": cx, "cy": cy}


def write_transforms(
    root: Path,
    photographs: list[Shot],
    document: dict | None = None,
    *,
    name: str = "transforms.json",
    images: bool = True,
) -> Path:
    """A transforms.json capture; `document` replaces the default contents."""
    root.mkdir(parents=True, exist_ok=True)
    document = document or {**intrinsics(photographs[0].camera), "frames": frames(photographs)}
    (root / name).write_text(json.dumps(document))
    if images:
        save_images(root / "images", photographs)
    return root


def warnings_of(capture: Capture) -> list[str]:
    """The names of its warnings, in order."""
    return [warning.name for warning in capture.warnings]
