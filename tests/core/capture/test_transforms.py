"""Camera files of the NeRF family."""

from __future__ import annotations

import json
import math
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plyfile import PlyData, PlyElement

from cvdgs.core.capture.model import Capture
from cvdgs.core.capture.points import read_point_cloud, write_point_cloud
from cvdgs.core.capture.reader import inspect_capture, read_capture
from cvdgs.core.errors import InputError
from cvdgs.core.runs.report import SCHEMA

from .make_captures import (
    Shot,
    frames,
    intrinsics,
    opengl_camera_to_world,
    pinhole,
    save_images,
    shots,
    warnings_of,
    with_model,
    write_colmap,
    write_transforms,
)


def assert_same_views(capture: Capture, photographs: list[Shot]) -> None:
    for view, shot in zip(capture.views, photographs, strict=True):
        np.testing.assert_allclose(view.world_to_camera, shot.world_to_camera, atol=1e-9)
        np.testing.assert_array_equal(view.image, shot.render())
        camera = view.camera
        np.testing.assert_allclose([camera.fx, camera.fy, camera.cx, camera.cy], shot.camera.params, rtol=1e-12)


def test_intrinsics_for_the_whole_file(tmp_path: Path) -> None:
    photographs = shots(3)
    capture = read_capture(write_transforms(tmp_path, photographs), max_size=None)
    assert capture.format == "transforms"
    assert_same_views(capture, photographs)
    assert warnings_of(capture) == ["few-views", "no-points"]


def test_the_file_itself_is_accepted(tmp_path: Path) -> None:
    write_transforms(tmp_path, shots(3), name="other.json")
    assert len(read_capture(tmp_path / "other.json", max_size=None).views) == 3


@pytest.mark.parametrize("below", ["room/scene", "shop/data/processed/room/scene"])
def test_a_camera_file_in_a_folder_below_is_found(tmp_path: Path, below: str) -> None:
    photographs = shots(3)
    write_transforms(tmp_path / "parent" / below, photographs)
    (tmp_path / "parent" / "README.txt").write_text("a room")
    archive = Path(shutil.make_archive(str(tmp_path / "room"), "zip", tmp_path / "parent"))
    for given in (tmp_path / "parent", archive):
        capture = read_capture(given, max_size=None)
        assert capture.format == "transforms"
        assert_same_views(capture, photographs)
    assert inspect_capture(tmp_path / "parent", cameras="estimate").format == "sfm"


def test_a_camera_file_in_a_folder_below_may_name_photographs_beside_it_but_none_outside(tmp_path: Path) -> None:
    photographs = shots(3)
    save_images(tmp_path / "parent" / "photos", photographs)
    document = {**intrinsics(photographs[0].camera), "frames": frames(photographs, "../photos/")}
    write_transforms(tmp_path / "parent" / "cameras", photographs, document, images=False)
    assert_same_views(read_capture(tmp_path / "parent", max_size=None), photographs)
    (tmp_path / "parent" / "photos").rename(tmp_path / "photos")
    document["frames"] = frames(photographs, "../../photos/")
    write_transforms(tmp_path / "parent" / "cameras", photographs, document, images=False)
    with pytest.raises(InputError, match="leads out of the capture folder"):
        inspect_capture(tmp_path / "parent")


def test_a_camera_file_in_a_folder_below_names_no_mask_outside(tmp_path: Path) -> None:
    photographs = shots(3)
    save_images(tmp_path / "elsewhere", photographs)
    listed = [
        frame | {"mask_path": f"masks/{shot.name}"}
        for frame, shot in zip(frames(photographs), photographs, strict=True)
    ]
    document = {**intrinsics(photographs[0].camera), "frames": listed}
    scene = write_transforms(tmp_path / "parent" / "scene", photographs, document)
    (scene / "masks").symlink_to(tmp_path / "elsewhere")
    for given in (scene, tmp_path / "parent"):
        with pytest.raises(InputError, match="leads out of the capture folder"):
            inspect_capture(given)


def test_of_several_captures_in_one_folder_none_is_taken(tmp_path: Path) -> None:
    for name in ("transforms_train.json", "transforms_test.json"):
        write_transforms(tmp_path / "chair", shots(3), name=name)
    assert inspect_capture(tmp_path).views == 3
    write_transforms(tmp_path / "lego", shots(3))
    with pytest.raises(InputError) as error:
        inspect_capture(tmp_path)
    assert "2 captures with cameras are in it: chair, lego - give the folder of one of them" in str(error.value)


def test_cameras_that_a_run_has_estimated_are_not_those_of_its_photographs(tmp_path: Path) -> None:
    save_images(tmp_path / "images", shots(3))
    write_transforms(tmp_path / "out" / "capture", shots(3))
    (tmp_path / "out" / "report.json").write_text(json.dumps({"schema": SCHEMA}))
    assert inspect_capture(tmp_path).format == "sfm"


def test_a_file_with_a_mark_of_windows_editors_is_read(tmp_path: Path) -> None:
    write_transforms(tmp_path, shots(3))
    file = tmp_path / "transforms.json"
    file.write_bytes(b"\xef\xbb\xbf" + file.read_bytes())
    assert inspect_capture(tmp_path).views == 3


def test_masks_that_are_missing_are_counted(tmp_path: Path) -> None:
    listed = frames(shots(3))
    listed[0]["mask_path"] = listed[2]["mask_path"] = "masks/mask.png"
    capture = inspect_capture(write_transforms(tmp_path, shots(3), {**intrinsics(pinhole()), "frames": listed}))
    (message,) = [warning.message for warning in capture.warnings if warning.name == "missing-masks"]
    assert "masks of 2 photographs" in message


def test_intrinsics_in_every_frame(tmp_path: Path) -> None:
    photographs = shots(2, pinhole(focal=80.0)) + shots(4, pinhole(72, 96, focal=61.5))[2:]
    listed = [{**frame, **intrinsics(s.camera)} for frame, s in zip(frames(photographs), photographs, strict=True)]
    assert_same_views(
        read_capture(write_transforms(tmp_path, photographs, {"frames": listed}), max_size=None), photographs
    )


def test_focal_lengths_that_differ(tmp_path: Path) -> None:
    camera = pinhole()
    camera.params = [80.0, 104.0, 48.0, 36.0]
    photographs = shots(2, camera)
    assert_same_views(read_capture(write_transforms(tmp_path, photographs), max_size=None), photographs)


def test_field_of_view_alone_takes_the_size_from_the_image(tmp_path: Path) -> None:
    photographs = shots(2)
    document = {"camera_angle_x": 2 * math.atan(48 / 80), "frames": frames(photographs)}
    assert_same_views(read_capture(write_transforms(tmp_path, photographs, document), max_size=None), photographs)


def test_a_focal_length_counts_for_more_than_a_field_of_view_that_says_otherwise(tmp_path: Path) -> None:
    """As of photographs that were cropped after their cameras were written."""
    photographs = shots(2)
    document = {"fl_x": 80.0, "camera_angle_x": 0.5, "frames": frames(photographs)}
    assert_same_views(read_capture(write_transforms(tmp_path, photographs, document), max_size=None), photographs)


def test_names_without_extension_and_split_files(tmp_path: Path) -> None:
    photographs = shots(2, pattern="r_{}.png")
    listed = frames(photographs, "./train/")
    for frame in listed:
        frame["file_path"] = frame["file_path"].removesuffix(".png")
    document = {"camera_angle_x": 2 * math.atan(48 / 80), "frames": listed}
    write_transforms(tmp_path, photographs, document, name="transforms_train.json", images=False)
    write_transforms(tmp_path, photographs, {"frames": []}, name="transforms_test.json", images=False)
    save_images(tmp_path / "train", photographs)
    capture = read_capture(tmp_path, max_size=None)
    assert_same_views(capture, photographs)
    assert [view.key for view in capture.views] == ["r_1", "r_2"]


@pytest.mark.parametrize(
    ("keys", "model", "distortion"),
    [
        ({"k1": 0.06, "k2": -0.08, "p1": -0.004, "p2": 0.003}, "OPENCV", [0.06, -0.08, -0.004, 0.003]),
        ({"camera_model": "OPENCV", "k1": 0.06, "k3": 0.02}, "FULL_OPENCV", [0.06, 0, 0, 0, 0.02, 0, 0, 0]),
        (
            {"camera_model": "OPENCV_FISHEYE", "k1": 0.05, "k2": -0.02, "k3": 0.01, "k4": 0.001},
            "OPENCV_FISHEYE",
            [0.05, -0.02, 0.01, 0.001],
        ),
        ({"camera_model": "FULL_OPENCV", "k1": 0.06, "k4": 0.02}, "FULL_OPENCV", [0.06, 0, 0, 0, 0, 0.02, 0, 0]),
        (
            {"camera_model": "OPENCV", "k1": 0.06, "k4": 0.02, "k6": 0.01},
            "FULL_OPENCV",
            [0.06, *[0] * 4, 0.02, 0, 0.01],
        ),
        ({"is_fisheye": True, "k1": 0.05}, "OPENCV_FISHEYE", [0.05, 0, 0, 0]),
        ({"camera_model": "SIMPLE_RADIAL", "k1": -0.1}, "SIMPLE_RADIAL", [-0.1]),
        ({"distortion_params": [0.06, -0.08, 0, 0, -0.004, 0.003]}, "OPENCV", [0.06, -0.08, -0.004, 0.003]),
        ({"is_fisheye": True, "distortion_params": [0.05, -0.02]}, "OPENCV_FISHEYE", [0.05, -0.02, 0, 0]),
    ],
)
def test_distortion_is_that_of_the_colmap_model(
    tmp_path: Path, keys: dict[str, Any], model: str, distortion: list[float]
) -> None:
    photographs = shots(2, with_model(model, distortion))
    document = {**intrinsics(pinhole()), **keys, "frames": frames(photographs)}
    write_transforms(tmp_path / "transforms", photographs, document)
    write_colmap(tmp_path / "colmap", photographs)
    ours = read_capture(tmp_path / "transforms", max_size=64)
    reference = read_capture(tmp_path / "colmap", max_size=64)
    for view, expected in zip(ours.views, reference.views, strict=True):
        assert view.camera.fx == pytest.approx(expected.camera.fx, rel=1e-9)
        assert np.abs(view.image.astype(int) - expected.image).max() <= 1


@pytest.mark.parametrize("model", [{"camera_model": "OPENCV"}, {}])
def test_a_fourth_coefficient_of_a_polynomial_is_refused(tmp_path: Path, model: dict[str, str]) -> None:
    """As nerfstudio's converters write it for lenses of RealityScan and Metashape; COLMAP's k4 is something else."""
    photographs = shots(2)
    document = {**intrinsics(pinhole()), **model, "k1": 0.06, "k4": 0.01, "frames": frames(photographs)}
    with pytest.raises(InputError, match=r"k4 of OPENCV is not supported - calibrate without k4, or undistort"):
        inspect_capture(write_transforms(tmp_path, photographs, document))


def test_unknown_camera_model_is_refused(tmp_path: Path) -> None:
    photographs = shots(2)
    document = {**intrinsics(pinhole()), "camera_model": "FISHEYE624", "frames": frames(photographs)}
    with pytest.raises(InputError, match="FISHEYE624 is not supported"):
        inspect_capture(write_transforms(tmp_path, photographs, document))


def test_points_are_in_the_frame_of_the_poses_whatever_was_applied(tmp_path: Path) -> None:
    photographs = shots(2)
    points = np.array([[0.0, 0.0, 4.0], [np.nan, 0.0, 4.0], [0.5, 0.25, 4.0]], np.float32)
    colors = np.array([[1, 2, 3], [4, 5, 6], [7, 8, 9]], np.uint8)
    document = {
        **intrinsics(pinhole()),
        "applied_transform": [[0.0, 1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0]],
        "applied_scale": 0.5,
        "ply_file_path": "sparse_pc.ply",
        "frames": frames(photographs),
    }
    write_transforms(tmp_path, photographs, document)
    write_point_cloud(tmp_path / "sparse_pc.ply", points, colors)
    capture = read_capture(tmp_path, max_size=None)
    np.testing.assert_array_equal(capture.points, points[[0, 2]])
    np.testing.assert_array_equal(capture.point_colors, colors[[0, 2]])
    assert "unusable-points" in warnings_of(capture)


@pytest.mark.parametrize(
    "name", ["/home/jane/scene/sparse_pc.ply", "C:\\scenes\\sparse_pc.ply", "//server/scenes/sparse_pc.ply"]
)
def test_points_that_a_file_of_another_machine_names_are_those_beside_it_or_none(tmp_path: Path, name: str) -> None:
    write_transforms(tmp_path, shots(3), {**intrinsics(pinhole()), "ply_file_path": name, "frames": frames(shots(3))})
    without = inspect_capture(tmp_path)
    assert (without.views, without.points) == (3, 0)
    (message,) = [warning.message for warning in without.warnings if warning.name == "missing-points"]
    assert name in message
    write_point_cloud(tmp_path / "sparse_pc.ply", np.ones((5, 3), np.float32), np.zeros((5, 3), np.uint8))
    found = inspect_capture(tmp_path)
    assert found.points == 5
    assert "missing-points" not in [warning.name for warning in found.warnings]


def test_points_of_another_capture_are_not_read(tmp_path: Path) -> None:
    elsewhere, root = tmp_path / "elsewhere.ply", tmp_path / "capture"
    write_point_cloud(elsewhere, np.ones((5, 3), np.float32), np.zeros((5, 3), np.uint8))
    document = {**intrinsics(pinhole()), "ply_file_path": str(elsewhere), "frames": frames(shots(3))}
    write_transforms(root, shots(3), document)
    assert inspect_capture(root).points == 0
    (root / "elsewhere.ply").symlink_to(elsewhere)
    with pytest.raises(InputError, match="leads out of the capture folder"):
        inspect_capture(root)


@pytest.mark.parametrize(
    ("kind", "stored"),
    [("u1", [0, 128, 255]), ("u2", [0, 128 * 257, 65535]), ("f4", [0.0, 128 / 255, 1.0]), ("i4", [-1, 128, 300])],
)
@pytest.mark.parametrize("text", [False, True], ids=["binary", "text"])
def test_colours_of_points_mean_the_same_in_every_type(tmp_path: Path, kind: str, stored: list, text: bool) -> None:
    vertices = np.zeros(3, [*((axis, "<f4") for axis in "xyz"), *((c, kind) for c in ("red", "green", "blue"))])
    vertices["red"] = vertices["green"] = vertices["blue"] = stored
    PlyData([PlyElement.describe(vertices, "vertex")], text=text).write(str(tmp_path / "points.ply"))
    _, colors = read_point_cloud(tmp_path / "points.ply")
    np.testing.assert_array_equal(colors, np.repeat([[0], [128], [255]], 3, axis=1))


def test_colours_of_8_bits_may_be_in_fields_of_16(tmp_path: Path) -> None:
    vertices = np.zeros(2, [*((axis, "<f4") for axis in "xyz"), *((c, "u2") for c in ("red", "green", "blue"))])
    vertices["red"] = [7, 255]
    PlyData([PlyElement.describe(vertices, "vertex")]).write(str(tmp_path / "points.ply"))
    _, colors = read_point_cloud(tmp_path / "points.ply")
    np.testing.assert_array_equal(colors, [[7, 0, 0], [255, 0, 0]])


def test_cut_points_are_refused(tmp_path: Path) -> None:
    document = {**intrinsics(pinhole()), "ply_file_path": "p.ply", "frames": frames(shots(2))}
    write_transforms(tmp_path, shots(2), document)
    write_point_cloud(tmp_path / "p.ply", np.zeros((50, 3), np.float32), np.zeros((50, 3), np.uint8))
    (tmp_path / "p.ply").write_bytes((tmp_path / "p.ply").read_bytes()[:-100])
    with pytest.raises(InputError, match=r"p.ply: the file is cut short: 7 of 50 points"):
        inspect_capture(tmp_path)


def test_missing_images_are_left_out_and_listed(tmp_path: Path) -> None:
    write_transforms(tmp_path, shots(4))
    (tmp_path / "images" / "0003.png").unlink()
    capture = read_capture(tmp_path, max_size=None)
    assert len(capture.views) == 3
    (message,) = [warning.message for warning in capture.warnings if warning.name == "missing-images"]
    assert "1 of 4" in message
    assert "images/0003.png" in message


def test_smaller_copies_stand_for_images_that_are_not_there(tmp_path: Path) -> None:
    large, small = (shots(3, pinhole(width, height, focal)) for width, height, focal in ((192, 144, 160), (96, 72, 80)))
    write_transforms(tmp_path, large, images=False)
    save_images(tmp_path / "images_4", shots(3, pinhole(48, 36, 40)))
    save_images(tmp_path / "images_2", small)
    capture = read_capture(tmp_path, max_size=None)
    assert_same_views(capture, small)
    assert "missing-images" not in warnings_of(capture)
    save_images(tmp_path / "images", large[:2])
    assert len(read_capture(tmp_path, max_size=None).views) == 2, "a folder that is there is taken as it is"


def test_colmap_beside_is_preferred_for_its_points(tmp_path: Path) -> None:
    write_transforms(tmp_path, shots(3))
    write_colmap(tmp_path, shots(3), images=False)
    capture = read_capture(tmp_path, max_size=None)
    assert capture.format == "colmap"
    assert len(capture.points) == 30


def test_colmap_beside_with_fewer_views_is_not_mixed_in(tmp_path: Path) -> None:
    write_transforms(tmp_path, shots(4))
    write_colmap(tmp_path, shots(3), images=False)
    capture = read_capture(tmp_path, max_size=None)
    assert (capture.format, len(capture.views), len(capture.points)) == ("transforms", 4, 0)


# --- poses


def changed_pose(root: Path, change: Any) -> Path:
    """A capture of three frames of which the second pose went through `change`."""
    photographs = shots(3)
    listed = frames(photographs)
    matrix = np.array(listed[1]["transform_matrix"])
    listed[1]["transform_matrix"] = change(matrix).tolist()
    return write_transforms(root, photographs, {**intrinsics(photographs[0].camera), "frames": listed})


@pytest.mark.parametrize(("away", "told"), [((0.0, 400.0, 0.0), False), ((0.0, 0.0, 600.0), True)])
def test_a_capture_far_from_the_origin_for_its_size_is_told(
    tmp_path: Path, away: tuple[float, float, float], told: bool
) -> None:
    capture = read_capture(moved(tmp_path, away), max_size=None)  # its cameras are up to 0.3 from their middle
    assert ("far-from-origin" in warnings_of(capture)) == told


def test_a_georeferenced_capture_is_told_what_becomes_of_positions(tmp_path: Path) -> None:
    capture = read_capture(moved(tmp_path, (500_000.0, 4_000_000.0, 100.0)), max_size=None)
    (message,) = [warning.message for warning in capture.warnings if warning.name == "far-from-origin"]
    assert "lies 4,031,129 units from the origin and is 0.3 in radius" in message
    assert "steps of 0.25" in message


def moved(root: Path, away: tuple[float, float, float]) -> Path:
    """A capture whose cameras are `away` from where they were."""
    photographs = shots(3)
    listed = frames(photographs)
    for frame in listed:
        matrix = np.array(frame["transform_matrix"])
        matrix[:3, 3] += away
        frame["transform_matrix"] = matrix.tolist()
    return write_transforms(root, photographs, {**intrinsics(photographs[0].camera), "frames": listed})


def test_uniform_scale_in_the_axes_is_divided_out(tmp_path: Path) -> None:
    capture = read_capture(changed_pose(tmp_path, lambda m: m @ np.diag([3.0, 3.0, 3.0, 1.0])), max_size=None)
    np.testing.assert_allclose(capture.views[1].world_to_camera, shots(3)[1].world_to_camera, atol=1e-9)
    assert "reorthonormalised" not in warnings_of(capture)


def test_slightly_skewed_rotation_is_repaired_and_named(tmp_path: Path) -> None:
    def skew(matrix: np.ndarray) -> np.ndarray:
        matrix[0, 1] += 0.003
        return matrix

    capture = read_capture(changed_pose(tmp_path, skew), max_size=None)
    rotation = capture.views[1].world_to_camera[:3, :3]
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    (message,) = [warning.message for warning in capture.warnings if warning.name == "reorthonormalised"]
    assert "images/0002.png" in message


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (lambda m: m @ np.diag([1.0, 1.2, 1.0, 1.0]), "not orthonormal"),
        (lambda m: m @ np.diag([-1.0, 1.0, 1.0, 1.0]), "reflection"),
        (lambda m: m * np.diag([0.0, 0.0, 0.0, 1.0]), "not orthonormal"),
        (lambda m: np.where(np.arange(16).reshape(4, 4) == 7, np.nan, m), "NaN"),
        (lambda m: m[:2], "shape"),
        (lambda m: m * 1e200, "huge"),
        (lambda m: m + np.eye(4)[3][:, None] * 0.5, "last row"),
    ],
)
def test_unusable_pose_is_refused_and_its_frame_named(tmp_path: Path, change: Any, problem: str) -> None:
    with pytest.raises(InputError, match=f"images/0002.png.*{problem}|{problem}.*images/0002.png"):
        inspect_capture(changed_pose(tmp_path, change))


# --- damage


@pytest.mark.parametrize("part", [0.0, 0.2, 0.7, 0.99])
def test_cut_file_is_refused(tmp_path: Path, part: float) -> None:
    file = write_transforms(tmp_path, shots(3)) / "transforms.json"
    text = file.read_text()
    file.write_text(text[: int(len(text) * part)])
    with pytest.raises(InputError, match=r"transforms.json: not valid JSON"):
        inspect_capture(tmp_path)


@pytest.mark.parametrize(
    ("document", "problem"),
    [
        ([], "no list of frames"),
        ({"fl_x": 1.0}, "no list of frames"),
        ({"frames": []}, "no list of frames"),
        ({"frames": [1]}, "no list of frames"),
        ({"frames": [{"transform_matrix": []}]}, "no file_path"),
        ({"frames": [{"file_path": "images/0001.png"}]}, "transform_matrix"),
        ({"frames": [{"file_path": "images/0001.png", "transform_matrix": "x"}]}, "transform_matrix"),
        ({"frames": frames(shots(2))}, "no focal length"),
        ({"camera_angle_x": 0.0, "frames": frames(shots(2))}, "no focal length"),
        ({"fl_x": "wide", "frames": frames(shots(2))}, "fl_x is 'wide'"),
        ({"fl_x": 10**400, "frames": frames(shots(2))}, "fl_x is '1000"),
        ({"fl_x": 80.0, "frames": [{"file_path": "images/0001.png", "transform_matrix": [[10**400]]}]}, "not numbers"),
        ({"fl_x": -80.0, "frames": frames(shots(2))}, "focal length"),
        ({"fl_x": 80.0, "fl_y": 1.0, "frames": frames(shots(2))}, "differ too much"),
        ({"fl_x": 80.0, "w": 1e9, "h": 72, "frames": frames(shots(2))}, "size"),
        ({"fl_x": 80.0, "frames": frames(shots(2)) * 2}, "same image"),
        ({"fl_x": 80.0, "frames": frames(shots(1))}, "only one view"),
        ({"fl_x": 80.0, "frames": [f | {"motion_blur": [1, "x"]} for f in frames(shots(2))]}, "not two numbers"),
        ({"fl_x": 80.0, "frames": [f | {"motion_blur": [math.nan, 1]} for f in frames(shots(2))]}, "not two numbers"),
        ({"fl_x": 80.0, "distortion_params": 0.1, "frames": frames(shots(2))}, "distortion_params is not a list of k1"),
        ({"fl_x": 80.0, "distortion_params": [0.1] * 7, "frames": frames(shots(2))}, "distortion_params is not a list"),
        ({"fl_x": 80.0, "distortion_params": ["a"], "frames": frames(shots(2))}, "k1 is 'a'"),
        ({"fl_x": 80.0, "ply_file_path": 3, "frames": frames(shots(2))}, "ply_file_path"),
        ({"fl_x": 80.0, "ply_file_path": "../p.ply", "frames": frames(shots(2))}, "leads out of the capture folder"),
    ],
)
def test_unusable_file_is_refused_in_one_line(tmp_path: Path, document: Any, problem: str) -> None:
    write_transforms(tmp_path, shots(2))
    (tmp_path / "transforms.json").write_text(json.dumps(document))
    with pytest.raises(InputError, match=problem) as refused:
        inspect_capture(tmp_path)
    assert "\n" not in str(refused.value)


def test_pose_with_axes_of_opengl_looks_along_minus_z(tmp_path: Path) -> None:
    """An independent statement of the convention: the camera at the origin that looks along world -z, y up."""
    listed = [
        {"file_path": f"images/{shot.name}", "transform_matrix": pose}
        for shot, pose in zip(shots(2), [np.eye(4).tolist(), opengl_camera_to_world(np.eye(4))], strict=True)
    ]
    write_transforms(tmp_path, shots(2), {**intrinsics(pinhole()), "frames": listed})
    view = read_capture(tmp_path, max_size=None).views[0]
    np.testing.assert_allclose(view.world_to_camera @ [0.0, 1.0, -5.0, 1.0], [0.0, -1.0, 5.0, 1.0], atol=1e-12)
