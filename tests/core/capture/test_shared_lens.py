"""One lens for views that were calibrated one by one."""

import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pycolmap
import pytest

from cvdgs.core.capture.colmap_files import ColmapModel, read_model
from cvdgs.core.capture.reader import inspect_capture, read_capture
from cvdgs.core.capture.shared_lens import may_share_lens, share_lens
from cvdgs.core.errors import InputError
from cvdgs.core.files.images import write_png

VIEWS, POINTS = 24, 900
SIZE = (300, 400)
FOCAL, DISTORTION = 320.0, (0.06, -0.09)
NOISE = 0.3  # pixels


@dataclass(frozen=True)
class Room:
    """Views of a cloud of points: where the cameras truly are, and the focal length of each."""

    folder: Path
    poses: list[np.ndarray]
    focal: np.ndarray


def look_from(position: np.ndarray) -> np.ndarray:
    """(3, 4) world to camera, looking at the origin."""
    forward = -position / np.linalg.norm(position)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    return np.column_stack([rotation, -rotation @ position])


def write_room(folder: Path, *, zoom: float = 0.0, binary: bool = True, own: bool = True) -> Room:
    """A model as COLMAP leaves it where every photograph has a camera: focal lengths a little off, poses likewise.

    Args:
        zoom: how far the true focal lengths differ, as a part.
        own: a camera for every view; else one for all.
    """
    rng = np.random.default_rng(3)
    cloud = rng.uniform(-1.0, 1.0, (POINTS, 3))
    angles = np.linspace(0.0, 2.0 * np.pi, VIEWS, endpoint=False)
    poses = [look_from(np.array([3.0 * np.cos(a), 3.0 * np.sin(a), 0.6 + 0.3 * np.sin(3.0 * a)])) for a in angles]
    focal = FOCAL * (1.0 + zoom * rng.uniform(-1.0, 1.0, VIEWS))
    model = pycolmap.Reconstruction()
    width, height = SIZE
    tracks: list[list] = [[] for _ in cloud]
    for index, pose in enumerate(poses):
        true = pycolmap.Camera(model="RADIAL", width=width, height=height,
                               params=[focal[index], width / 2, height / 2, *DISTORTION])  # fmt: skip
        seen = rng.random(POINTS) < 0.3
        camera_points = cloud[seen] @ pose[:, :3].T + pose[:, 3]
        pixels = true.img_from_cam(camera_points) + rng.normal(0.0, NOISE, (seen.sum(), 2))
        error = 1.0 + 0.02 * rng.standard_normal()  # of the focal length, which the distance makes up for
        if own or not index:
            params = [focal[index] * (error if own else 1.0), width / 2, height / 2, 0.03]
            camera = pycolmap.Camera(
                camera_id=index + 1, model="SIMPLE_RADIAL", width=width, height=height, params=params
            )
            model.add_camera_with_trivial_rig(camera)
        moved = pose.copy()
        moved[2, 3] *= error if own else 1.0
        image = pycolmap.Image(
            name=f"{index:04d}.png",
            camera_id=index + 1 if own else 1,
            image_id=index + 1,
            points2D=[pycolmap.Point2D(pixel) for pixel in pixels],
        )
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(moved))
        for element, point in enumerate(np.flatnonzero(seen)):
            tracks[point].append(pycolmap.TrackElement(index + 1, element))
    for position, track in zip(cloud, tracks, strict=True):
        if len(track) > 1:
            model.add_point3D(position, pycolmap.Track(track), np.array([90, 120, 60], np.uint8))
    (folder / "sparse" / "0").mkdir(parents=True)
    (model.write_binary if binary else model.write_text)(str(folder / "sparse" / "0"))
    return Room(folder, poses, focal)


def read(room: Room) -> ColmapModel:
    return read_model(room.folder / "sparse" / "0", observed=True)


def centers(model: ColmapModel) -> np.ndarray:
    return np.array([-pose[:, :3].T @ pose[:, 3] for pose in (image.world_to_camera for image in model.images)])


def distance_to_truth(model: ColmapModel, room: Room) -> float:
    """Median distance of the cameras to the true ones, after the similarity that fits best."""
    found = centers(model)
    truth = np.array([-pose[:, :3].T @ pose[:, 3] for pose in room.poses])
    sim = pycolmap.estimate_sim3d(found, truth)
    return float(np.median(np.linalg.norm([sim * center for center in found] - truth, axis=1)))


@pytest.fixture(scope="module")
def room(tmp_path_factory) -> Room:
    return write_room(tmp_path_factory.mktemp("room"))


def test_views_with_a_camera_each_get_one_lens_and_better_poses(room):
    before = read(room)
    assert may_share_lens(before)
    found = share_lens(before)
    assert found is not None
    assert found.views == VIEWS
    (lens,) = found.model.cameras.values()
    assert lens.focal_length == pytest.approx(FOCAL, rel=0.005)
    assert lens.params[3:] == pytest.approx(DISTORTION, abs=0.02)
    assert found.error_shared < 1.5 * NOISE
    assert distance_to_truth(found.model, room) < 0.2 * distance_to_truth(before, room)


def test_it_is_the_same_each_time_and_for_either_form_of_the_files(room, tmp_path):
    models = [share_lens(read(one)) for one in (room, room, write_room(tmp_path, binary=False))]
    first, again, text = (centers(found.model) for found in models)
    np.testing.assert_array_equal(first, again)
    np.testing.assert_allclose(first, text, atol=1e-4)


def test_a_zoom_lens_keeps_a_camera_for_every_view(tmp_path):
    zoomed = read(write_room(tmp_path, zoom=0.06))
    assert may_share_lens(zoomed)  # too little to see by the focal lengths
    found = share_lens(zoomed)
    assert found is not None
    assert found.views == 0
    assert found.model is zoomed
    assert found.error_shared > found.error_apart


def test_what_cannot_be_one_lens_is_not_tried(room, tmp_path):
    assert not may_share_lens(read(write_room(tmp_path, own=False)))
    model = read(room)
    assert not may_share_lens(replace(model, images=model.images[:5]))
    other = pycolmap.Camera(
        camera_id=1, model="OPENCV_FISHEYE", width=300, height=400, params=[320, 320, 150, 200, 0, 0, 0, 0]
    )
    assert not may_share_lens(replace(model, cameras={**model.cameras, 1: other}))
    wide = {number: replace_focal(camera, 1.0 + 0.02 * number) for number, camera in model.cameras.items()}
    assert not may_share_lens(replace(model, cameras=wide))


def replace_focal(camera: pycolmap.Camera, factor: float) -> pycolmap.Camera:
    params = [camera.params[0] * factor, *camera.params[1:]]
    return pycolmap.Camera(
        camera_id=camera.camera_id, model=camera.model, width=camera.width, height=camera.height, params=params
    )


def test_tracks_that_name_points_which_are_not_there_or_lie_nowhere_leave_the_model_as_it_is(room):
    model = read(room)
    strange = []
    for image in model.images:
        observations = image.observations.copy()
        observations["point"] += 10**12
        observations["position"][::2] = np.nan
        strange.append(replace(image, observations=observations))
    assert share_lens(replace(model, images=strange)) is None
    assert share_lens(replace(model, points=np.full_like(model.points, np.inf))) is None
    assert share_lens(replace(model, points=model.points[:0], point_numbers=model.point_numbers[:0])) is None


def test_a_capture_is_read_with_the_lens_and_told_so_but_not_looked_through_with_it(tmp_path):
    made = write_room(tmp_path)
    (tmp_path / "images").mkdir()
    for index in range(VIEWS):
        write_png(tmp_path / "images" / f"{index:04d}.png", np.full((*SIZE[::-1], 3), 7 * index, np.uint8))
    capture = read_capture(made.folder, max_size=100)
    (warning,) = (warning for warning in capture.warnings if warning.name == "shared-lens")
    assert "f 3" in warning.message
    assert f"all {VIEWS} views" in warning.message
    assert len({view.camera.fx for view in capture.views}) == 1
    assert "shared-lens" not in {warning.name for warning in inspect_capture(made.folder).warnings}


def test_a_pose_that_is_none_is_refused_before_the_lens_is_fitted(tmp_path):
    made = write_room(tmp_path, binary=False)
    listed = made.folder / "sparse" / "0" / "images.txt"
    damaged = re.sub(r"(?m)^(\d+)(?: \S+){4} (.* 0004\.png)$", r"\1 0 0 0 0 \2", listed.read_text())
    listed.write_text(damaged)
    (tmp_path / "images").mkdir()
    with pytest.raises(InputError, match=r"the pose of 0004\.png holds NaN"):
        read_capture(made.folder, max_size=100)
