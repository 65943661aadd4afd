"""Real captures, where the evaluation data is there: two descriptions of one capture agree."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pycolmap
import pytest

from cvdgs.core.bootstrap import ROOT
from cvdgs.core.capture.colmap_files import read_model
from cvdgs.core.capture.model import Capture
from cvdgs.core.capture.reader import inspect_capture, read_capture
from cvdgs.core.capture.undistort import choose_pinhole, source_pixels
from cvdgs.core.errors import InputError
from cvdgs.core.runtime.progress import CAMERAS
from cvdgs.core.runtime.protocol import Reporter

DATA = ROOT.parent / "shared" / "data"
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason="the evaluation data is not there")


def similarity(source: np.ndarray, target: np.ndarray) -> np.ndarray:
    """`source` points moved onto `target` by the best similarity (Umeyama 1991, through pycolmap)."""
    transform = pycolmap.estimate_sim3d(source, target)
    return np.array([transform * point for point in source])


def centers(capture: Capture) -> np.ndarray:
    return np.array([view.center for view in capture.views])


def test_fox_is_the_same_from_colmap_and_from_transforms() -> None:
    colmap = read_capture(DATA / "fox", max_size=120)
    transforms = read_capture(DATA / "fox" / "transforms.json", max_size=120)
    assert (colmap.format, transforms.format) == ("colmap", "transforms")
    assert len(colmap.views) == len(transforms.views) == 50
    assert colmap.points.shape == (10_288, 3)
    moved = similarity(centers(transforms), centers(colmap))
    extent = np.ptp(centers(colmap), axis=0).max()
    assert np.abs(moved - centers(colmap)).max() < 1e-4 * extent
    for first, second in zip(colmap.views, transforms.views, strict=True):
        assert first.key == second.key
        np.testing.assert_array_equal(first.image, second.image)


def test_kermit_with_a_camera_for_every_image_is_the_same_from_both(tmp_path: Path) -> None:
    shutil.copytree(DATA / "kermit" / "sparse_from_bundle", tmp_path / "sparse")
    shutil.copytree(DATA / "kermit" / "images", tmp_path / "images")
    colmap = read_capture(tmp_path, max_size=160)
    transforms = read_capture(DATA / "kermit" / "transforms_from_bundle.json", max_size=160)
    assert [view.key for view in colmap.views] == [view.key for view in transforms.views]
    assert len({view.camera.fx for view in colmap.views}) == 9
    for first, second in zip(colmap.views, transforms.views, strict=True):
        assert first.camera.fx == pytest.approx(second.camera.fx, rel=1e-9)
        np.testing.assert_allclose(first.world_to_camera, second.world_to_camera, atol=1e-6)
        assert np.abs(first.image.astype(int) - second.image).max() <= 1
    assert {"few-views", "unregistered"} <= {warning.name for warning in colmap.warnings}


@pytest.mark.parametrize("name", ["fox", "kermit"])
def test_observed_features_project_onto_the_points_through_the_views(name: str) -> None:
    """COLMAP's own features, carried from the photographs into the views, meet the projected points."""
    capture = read_capture(DATA / name, max_size=160)
    model = pycolmap.Reconstruction(str(DATA / name / "sparse" / "0"))
    views = {view.source.name: view for view in capture.views}
    errors = []
    for image in list(model.images.values())[::7]:
        view, camera = views[image.name], image.camera
        seen = [p for p in image.points2D if p.has_point3D()][::5]
        pixels = np.array([p.xy for p in seen])
        points = np.array([model.point3D(p.point3D_id).xyz for p in seen])
        local = points @ view.world_to_camera[:3, :3].T + view.world_to_camera[:3, 3]
        projected = local[:, :2] / local[:, 2:] * (view.camera.fx, view.camera.fy) + (view.camera.cx, view.camera.cy)
        rays = camera.cam_from_img(pixels)
        observed = rays * (view.camera.fx, view.camera.fy) + (view.camera.cx, view.camera.cy)
        errors.append(np.linalg.norm(projected - observed, axis=1) * camera.width / view.camera.width)
    assert np.mean(np.concatenate(errors)) < 0.9  # the models' own mean reprojection errors are 0.73 and 0.64


@pytest.mark.parametrize("model", ["SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "OPENCV", "OPENCV_FISHEYE"])
@pytest.mark.parametrize("form", ["binary", "text"])
def test_one_scene_under_several_camera_models_projects_its_points_alike(tmp_path: Path, model: str, form: str) -> None:
    kept = ".bin" if form == "binary" else ".txt"
    for path in (DATA / "colmap" / model).iterdir():
        if path.suffix == kept:
            shutil.copy(path, tmp_path / path.name)
    reconstruction = pycolmap.Reconstruction(str(tmp_path))
    camera = next(iter(reconstruction.cameras.values()))
    chosen = choose_pinhole(camera, where=tmp_path)
    places = source_pixels(camera, chosen) * (camera.width, camera.height)
    assert places.min() > -0.5
    assert (places.max(axis=(0, 1)) < (camera.width + 0.5, camera.height + 0.5)).all()
    image = reconstruction.image(next(iter(reconstruction.reg_image_ids())))
    for point in list(reconstruction.points3D.values())[::50]:
        local = image.cam_from_world() * point.xyz
        expected = image.project_point(point.xyz)
        if expected is None or local[2] <= 0:
            continue
        u = chosen.fx * local[0] / local[2] + chosen.cx
        v = chosen.fy * local[1] / local[2] + chosen.cy
        column, row = int(u), int(v)
        if 0 <= column < chosen.width - 1 and 0 <= row < chosen.height - 1:
            step = places[row + 1, column + 1] - places[row, column]
            place = places[row, column] + step * (u - column - 0.5, v - row - 0.5)
            np.testing.assert_allclose(place, expected, atol=0.05)


@pytest.mark.parametrize("form", ["binary", "text"])
def test_models_are_read_as_colmap_reads_them(tmp_path: Path, form: str) -> None:
    kept = ".bin" if form == "binary" else ".txt"
    for path in (DATA / "colmap" / "OPENCV").iterdir():
        if path.suffix == kept:
            shutil.copy(path, tmp_path / path.name)
    expected, model = pycolmap.Reconstruction(str(tmp_path)), read_model(tmp_path)
    cameras = dict(expected.cameras.items())
    assert model.cameras.keys() == cameras.keys()
    for number, camera in cameras.items():
        assert (model.cameras[number].model, model.cameras[number].width) == (camera.model, camera.width)
        np.testing.assert_array_equal(model.cameras[number].params, camera.params)
    assert len(model.images) == expected.num_reg_images()
    for image in model.images:
        (other,) = [one for one in expected.images.values() if one.name == image.name]
        np.testing.assert_allclose(image.world_to_camera, other.cam_from_world().matrix(), atol=1e-9)
    points = [point for point in expected.points3D.values() if point.track.length() >= 2]
    # Two points may lie in one place and differ in their colours.
    read = np.column_stack([model.points, model.point_colors])
    known = np.array([[*point.xyz.astype(np.float32), *point.color] for point in points])
    np.testing.assert_array_equal(read[np.lexsort(read.T)], known[np.lexsort(known.T)])


def test_absent_photographs_of_a_downloaded_camera_file_are_listed(tmp_path: Path) -> None:
    shutil.copy(DATA / "transforms" / "instant_ngp_fox_67frames_17_images_absent.json", tmp_path / "transforms.json")
    shutil.copytree(DATA / "fox" / "images", tmp_path / "images")
    summary = inspect_capture(tmp_path)
    assert summary.views == 50
    assert summary.sizes == ((720, 1280, 50),)
    (message,) = [warning.message for warning in summary.warnings if warning.name == "missing-images"]
    assert "17 of 67" in message


def test_model_with_subfolders_and_no_photographs_is_refused() -> None:
    folder = DATA / "colmap" / "sceaux_sbcv_mit" / "colmap_example_model_txt_missing_cams_and_subfolders"
    with pytest.raises(InputError, match="9 of 9 images are missing"):
        inspect_capture(folder)


@pytest.mark.slow
def test_photographs_are_reduced_to_the_size_asked_for() -> None:
    capture = read_capture(DATA / "fox", max_size=480)
    assert {view.image.shape for view in capture.views} == {(480, 270, 3)}


@pytest.mark.slow
def test_sfm_finds_the_cameras_of_kermit(tmp_path: Path) -> None:
    class Recorder(Reporter):
        def __init__(self) -> None:
            self.fractions: list[float] = []

        def progress(self, stage: str, fraction: float, message: str = "") -> None:
            if stage == CAMERAS:
                self.fractions.append(fraction)

    shutil.copytree(DATA / "kermit" / "images", tmp_path / "kermit")
    recorder = Recorder()
    estimated = read_capture(tmp_path / "kermit", max_size=160, cameras="estimate", reporter=recorder)
    reference = read_capture(DATA / "kermit", max_size=160)
    assert [view.key for view in estimated.views] == [view.key for view in reference.views]
    moved = similarity(centers(estimated), centers(reference))
    extent = np.ptp(centers(reference), axis=0).max()
    assert np.linalg.norm(moved - centers(reference), axis=1).max() < 0.05 * extent
    assert len(estimated.points) > 300
    assert recorder.fractions
    assert sorted(path.name for path in tmp_path.iterdir()) == ["kermit"]
    assert all(path.suffix == ".jpg" for path in (tmp_path / "kermit").iterdir())


def test_a_meeting_room_stands_on_its_green_floor() -> None:
    capture = read_capture(DATA / "room_lounge", max_size=32)
    red, green, blue = capture.point_colors.astype(float).T
    assert capture.up is not None
    heights = capture.points @ capture.up.direction
    low = heights < np.median(heights)
    floor = capture.points[(green > 1.08 * red) & (green > 1.08 * blue) & low].astype(float)
    for _ in range(5):
        normal = np.linalg.svd(floor - floor.mean(axis=0))[2][2]
        away = np.abs((floor - floor.mean(axis=0)) @ normal)
        floor = floor[away < 2.0 * np.median(away) + 1e-9]
    assert np.degrees(np.arccos(abs(normal @ capture.up.direction))) < 3.0


# Of a picture's frame on the wall behind the fox, two places up and down its edge, in pixels of the photograph.
EDGES = {"0018": ((271, 1), (291, 245)), "0077": ((217, 2), (208, 350)), "0089": ((301, 2), (317, 370))}


def test_a_fox_hangs_upright_on_its_wall() -> None:
    """The wall is upright, and so are the edges of a picture that hangs on it."""
    capture = read_capture(DATA / "fox", max_size=32)
    model = pycolmap.Reconstruction(str(DATA / "fox" / "sparse" / "0"))
    points = capture.points.astype(float)
    generator, extent, most = np.random.default_rng(0), np.ptp(np.percentile(points, [2, 98], axis=0), axis=0).max(), 0
    for _ in range(1000):
        three = points[generator.integers(0, len(points), 3)]
        normal = np.cross(three[1] - three[0], three[2] - three[0])
        near = np.abs((points - three[0]) @ normal) < 0.004 * extent * np.linalg.norm(normal)
        if np.count_nonzero(near) > most:
            wall, most = points[near], np.count_nonzero(near)
    center = wall.mean(axis=0)
    normal = np.linalg.svd(wall - center)[2][2]
    assert capture.up is not None
    assert most > 0.4 * len(points)
    assert abs(np.degrees(np.arcsin(normal @ capture.up.direction))) < 3.0
    edges = []
    for image in model.images.values():
        if (name := Path(image.name).stem) in EDGES:
            rays = np.column_stack([image.camera.cam_from_img(np.array(EDGES[name], float)), np.ones(2)])
            eye, rays = image.projection_center(), rays @ image.cam_from_world().rotation.matrix()
            upper, lower = eye + rays * ((center - eye) @ normal / (rays @ normal))[:, None]
            edges.append((upper - lower) / np.linalg.norm(upper - lower))
    assert len(edges) == len(EDGES)
    for edge in edges:
        assert np.degrees(np.arccos(edge @ capture.up.direction)) < 3.0


@pytest.mark.slow
def test_photographs_round_a_doll_are_placed_by_a_lens_near_the_calibrated_one() -> None:
    capture = read_capture(DATA / "plush_bedroom", max_size=None, cameras="estimate")
    assert capture.estimate is not None
    assert capture.estimate.placed >= 0.95 * capture.estimate.photographs
    (ratio,) = capture.estimate.focal_ratios  # of the lens; undistorted views have a focal length of their own
    assert ratio * 940 == pytest.approx(763.97, rel=0.02)


@pytest.mark.slow
def test_a_room_in_few_photographs_is_refused() -> None:
    with pytest.raises(InputError, match=r"could be connected|no cameras could be estimated"):
        read_capture(DATA / "room_few_views", max_size=None, cameras="estimate")
