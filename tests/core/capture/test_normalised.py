"""The normalised form is read back as it was written."""

from __future__ import annotations

import json
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from plyfile import PlyData
from scipy.spatial.transform import Rotation

from cvdgs.core.capture.model import Capture, PinholeCamera, View
from cvdgs.core.capture.normalised import write_capture
from cvdgs.core.capture.reader import read_capture

from .make_captures import shots, with_model, write_colmap

finite = st.floats(-1e4, 1e4, allow_subnormal=False)
focal = st.floats(1.0, 1e5)


@st.composite
def views(draw: st.DrawFn, key: str) -> View:
    width, height = draw(st.integers(16, 40)), draw(st.integers(16, 40))
    fx, squeeze = draw(focal), draw(st.floats(0.2, 5.0))
    camera = PinholeCamera(width, height, fx, fx * squeeze, draw(finite), draw(finite))
    generator = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    pose = np.eye(4)
    pose[:3, :3] = Rotation.random(random_state=generator.integers(2**31)).as_matrix()
    pose[:3, 3] = draw(st.tuples(finite, finite, finite))
    image = generator.integers(0, 256, (height, width, 3)).astype(np.uint8)
    alpha = None
    if draw(st.booleans()):
        alpha = generator.integers(0, 255, (height, width)).astype(np.uint8)
    smear = draw(st.none() | st.tuples(finite, finite).map(np.array))
    return View(key, Path(key), camera, pose, image, alpha, smear=smear)


@st.composite
def captures(draw: st.DrawFn) -> Capture:
    keys = draw(st.lists(st.from_regex(r"\A[a-z0-9_]{1,12}\Z"), min_size=2, max_size=4, unique=True))
    count = draw(st.integers(0, 20))
    generator = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    points = generator.normal(0, 100, (count, 3)).astype(np.float32)
    colors = generator.integers(0, 256, (count, 3)).astype(np.uint8)
    return Capture(Path("x"), "colmap", tuple(draw(views(key)) for key in keys), points, colors)


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(captures())
def test_written_capture_reads_back(capture: Capture) -> None:
    with tempfile.TemporaryDirectory() as folder:
        write_capture(capture, folder)
        back = read_capture(folder, max_size=None)
    expected = {view.key: view for view in capture.views}
    keys = [view.key for view in back.views]
    assert len(keys) == len(expected)
    for view in back.views:
        original = expected[view.key]
        assert view.camera == original.camera
        scale = max(1.0, float(np.abs(original.world_to_camera[:3, 3]).max()))
        np.testing.assert_allclose(view.world_to_camera, original.world_to_camera, atol=1e-9 * scale, rtol=0)
        np.testing.assert_array_equal(view.image, original.image)
        if original.alpha is None:
            assert view.alpha is None
        else:
            np.testing.assert_array_equal(view.alpha, original.alpha)
        if original.smear is None:
            assert view.smear is None
        else:
            np.testing.assert_array_equal(view.smear, original.smear)
    np.testing.assert_array_equal(back.points, capture.points)
    np.testing.assert_array_equal(back.point_colors, capture.point_colors)


@pytest.mark.parametrize(
    "names",
    [
        ["IMG.jpg", "IMG (1).jpg", "IMG (2).jpg"],
        ["cam/1.jpg", "camB/1.jpg", "cam2/1.jpg"],
        ["10.jpg", "9.jpg", "a.b.jpg"],
    ],
)
def test_views_have_the_same_order_when_they_are_read_back(tmp_path: Path, names: list[str]) -> None:
    taken = [replace(shot, name=name) for shot, name in zip(shots(3), names, strict=True)]
    first = read_capture(write_colmap(tmp_path / "given", taken), max_size=None)
    write_capture(first, tmp_path / "written")
    back = read_capture(tmp_path / "written", max_size=None)
    assert [view.key for view in back.views] == [view.key for view in first.views]


def test_undistorted_capture_is_a_fixed_point(tmp_path: Path) -> None:
    photographs = shots(3, with_model("OPENCV", [0.06, -0.08, -0.004, 0.003]))
    capture = read_capture(write_colmap(tmp_path / "in", photographs), max_size=64)
    write_capture(capture, tmp_path / "out")
    back = read_capture(tmp_path / "out", max_size=64)
    for view, original in zip(back.views, capture.views, strict=True):
        assert (view.key, view.camera) == (original.key, original.camera)
        np.testing.assert_array_equal(view.image, original.image)


def test_points_are_a_standard_ply(tmp_path: Path) -> None:
    capture = read_capture(write_colmap(tmp_path / "in", shots(3)), max_size=None)
    write_capture(capture, tmp_path / "out")
    vertices = PlyData.read(str(tmp_path / "out" / "points.ply"))["vertex"]
    np.testing.assert_array_equal(np.stack([vertices[axis] for axis in "xyz"], 1), capture.points)
    np.testing.assert_array_equal(vertices["red"], capture.point_colors[:, 0])


def test_camera_file_is_nerfstudio_s(tmp_path: Path) -> None:
    capture = read_capture(write_colmap(tmp_path / "in", shots(2)), max_size=None)
    write_capture(capture, tmp_path / "out")
    document = json.loads((tmp_path / "out" / "transforms.json").read_text())
    assert document["ply_file_path"] == "points.ply"
    first = document["frames"][0]
    assert first["file_path"] == "images/0001.png"
    assert (first["w"], first["h"], first["fl_x"], first["fl_y"], first["cx"], first["cy"]) == (96, 72, 80, 80, 48, 36)
    center = np.array(first["transform_matrix"])[:3, 3]
    np.testing.assert_allclose(center, capture.views[0].center, atol=1e-12)


def test_without_points_none_are_written(tmp_path: Path) -> None:
    capture = read_capture(write_colmap(tmp_path / "in", shots(2)), max_size=None)
    bare = Capture(
        capture.source, capture.format, capture.views, np.zeros((0, 3), np.float32), np.zeros((0, 3), np.uint8)
    )
    write_capture(bare, tmp_path / "out")
    assert not (tmp_path / "out" / "points.ply").exists()
    assert len(read_capture(tmp_path / "out", max_size=None).points) == 0


def test_unwritable_folder_is_an_os_error(tmp_path: Path) -> None:
    capture = read_capture(write_colmap(tmp_path / "in", shots(2)), max_size=None)
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match="file"):
        write_capture(capture, tmp_path / "file" / "out")
