"""A capture in the scene: cameras, photographs and sparse points, upright, of sensible size, adjustable."""

from __future__ import annotations

import json
from pathlib import Path

import bpy
import numpy as np
import pytest

from cvdgs.core.capture.folder import read_capture_folder, read_points
from cvdgs.core.errors import InputError
from cvdgs.cvdgs_addon import importing
from cvdgs.cvdgs_addon.scene import cameras
from cvdgs.cvdgs_addon.scene.camera_view import views_3d
from cvdgs.cvdgs_addon.scene.import_capture import ImportOptions, capture_of, import_capture, place_again
from cvdgs.cvdgs_addon.scene.placement import Placing, Up
from cvdgs.ui.capture import CVDGS_PT_import_capture

from .layouts import drawn
from .scenes import CAMERA, opencv, ring_view
from .test_cameras import points_in_view, project
from .waiting import finished

TOLERANCE = 1e-4  # pixels
COPYING = """
source = request["capture"]
emit("status", stage="capture", message="reading")
shutil.copytree(os.path.join(source, "prepared"), request["folder"], dirs_exist_ok=True)
emit("result", views=5, points=20)
"""


def write_png(path: Path) -> None:
    image = bpy.data.images.new("photograph", CAMERA.width, CAMERA.height)
    image.filepath_raw, image.file_format = str(path), "PNG"
    image.save()
    bpy.data.images.remove(image)


def write_points(path: Path, positions: np.ndarray, colors: np.ndarray) -> None:
    table = np.empty(len(positions), [("p", "<f4", 3), ("c", "u1", 3)])
    table["p"], table["c"] = positions, colors
    names = [("float", "x"), ("float", "y"), ("float", "z"), ("uchar", "red"), ("uchar", "green"), ("uchar", "blue")]
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(positions)}"]
    header += [f"property {kind} {name}" for kind, name in names] + ["end_header", ""]
    path.write_bytes("\n".join(header).encode() + table.tobytes())


@pytest.fixture
def capture(scene, run_folder) -> Path:
    """The capture of a run, with photographs and points."""
    folder = run_folder / "capture"
    for index in range(5):
        write_png(folder / "images" / f"view{index}.png")
    random = np.random.default_rng(0)
    write_points(folder / "points.ply", random.normal(0.0, 0.3, (200, 3)), random.integers(0, 256, (200, 3)))
    return folder


def test_cameras_lie_in_a_collection_of_their_own_small_and_without_lines_to_the_empty(capture):
    (view,) = views_3d()
    view.overlay.show_relationship_lines = True
    added = import_capture(capture, bpy.context.scene)
    collections = {camera.users_collection for camera in added.cameras.values()}
    assert [collection.name for (collection,) in collections] == ["Cameras"]
    assert not view.overlay.show_relationship_lines
    bpy.context.view_layer.update()
    distance = np.linalg.norm(added.cameras["view0"].matrix_world.translation)
    assert all(camera.data.display_size < 0.05 * distance for camera in added.cameras.values())


def test_cameras_project_as_the_photographs_do(scene, capture):
    added = import_capture(capture, scene)
    bpy.context.view_layer.update()
    for view in read_capture_folder(capture).views:
        camera = added.cameras[view.key]
        points = points_in_view(view.camera, view.camera_to_world)
        expected = project(view.camera, opencv(view.camera_to_world), points)
        found = project(cameras.camera_intrinsics(camera), opencv(cameras.camera_to_world(camera)), points)
        assert np.abs(found - expected).max() < TOLERANCE


def test_photographs_stand_behind_their_cameras(scene, capture):
    added = import_capture(capture, scene)
    for key, camera in added.cameras.items():
        (background,) = camera.data.background_images
        assert Path(bpy.path.abspath(background.image.filepath)) == capture / "images" / f"{key}.png"
        assert camera.data.show_background_images
        assert tuple(background.image.size) == (CAMERA.width, CAMERA.height)
    without = import_capture(capture, scene, ImportOptions(images=False, points=False))
    assert not any(len(camera.data.background_images) for camera in without.cameras.values())
    assert without.points is None


def test_sparse_points_become_a_point_cloud_in_their_colours(scene, capture):
    added = import_capture(capture, scene)
    positions, colors = read_points(capture)
    geometry = added.points.evaluated_get(bpy.context.evaluated_depsgraph_get()).evaluated_geometry()
    cloud = geometry.pointcloud
    found = np.empty(len(cloud.points) * 3, np.float32)
    cloud.points.foreach_get("co", found)
    np.testing.assert_allclose(found.reshape(-1, 3), positions)
    rgba = np.empty(len(cloud.points) * 4, np.float32)
    cloud.attributes["drawn_color"].data.foreach_get("color", rgba)
    np.testing.assert_allclose(rgba.reshape(-1, 4)[:, :3], colors, atol=1e-6)


def test_sparse_points_show_light_where_the_view_transform_wants_it(scene, capture):
    scene.view_settings.view_transform = "Standard"
    added = import_capture(capture, scene)
    _, colors = read_points(capture)
    geometry = added.points.evaluated_get(bpy.context.evaluated_depsgraph_get()).evaluated_geometry()
    rgba = np.empty(len(geometry.pointcloud.points) * 4, np.float32)
    geometry.pointcloud.attributes["drawn_color"].data.foreach_get("color", rgba)
    light = np.where(colors <= 0.04045, colors / 12.92, ((colors + 0.055) / 1.055) ** 2.4)
    np.testing.assert_allclose(rgba.reshape(-1, 4)[:, :3], light, atol=1e-5)


@pytest.mark.parametrize("axis", [up for up in Up if up is not Up.AUTO])
def test_any_axis_can_be_up_and_any_distance_the_scale(scene, capture, axis):
    added = import_capture(capture, scene)
    before = {key: camera.data.clip_start for key, camera in added.cameras.items()}
    place_again(added.empty, Placing(axis, 12.0))
    matrix = np.array(added.empty.matrix_basis)
    direction = np.eye(3)["XYZ".index(axis.value[-1])] * (-1.0 if axis.value[0] == "-" else 1.0)
    up = matrix[:3, :3] @ direction
    np.testing.assert_allclose(up / np.linalg.norm(up), (0.0, 0.0, 1.0), atol=1e-5)
    places = np.stack([matrix @ cameras.camera_to_world(camera) for camera in added.cameras.values()])[:, :3, 3]
    assert np.median(np.linalg.norm(places, axis=1)) == pytest.approx(12.0, rel=0.02)
    scale = np.linalg.norm(matrix[:3, 0])
    for key, camera in added.cameras.items():
        assert camera.data.clip_start == pytest.approx(before[key] * scale, rel=1e-4)


def test_placing_automatically_again_undoes_what_was_chosen(scene, capture):
    added = import_capture(capture, scene)
    before = np.array(added.empty.matrix_basis)
    place_again(added.empty, Placing(Up.NEGATIVE_X, 50.0))
    place_again(added.empty, Placing())
    np.testing.assert_allclose(np.array(added.empty.matrix_basis), before, atol=1e-5)


def test_without_points_the_subject_is_where_the_cameras_look(scene, capture):
    (capture / "points.ply").unlink()
    added = import_capture(capture, scene, ImportOptions(placing=Placing(Up.Z, 7.0)))
    places = np.array(added.empty.matrix_basis) @ np.stack([ring_view(2.0 * np.pi * i / 5) for i in range(5)])
    np.testing.assert_allclose(np.linalg.norm(places[:, :3, 3], axis=1), 7.0, rtol=1e-4)


def test_damaged_points_are_refused_in_one_line(scene, capture):
    data = (capture / "points.ply").read_bytes()
    (capture / "points.ply").write_bytes(data[:-30])
    with pytest.raises(InputError, match="2 of 200 points are missing"):
        import_capture(capture, scene)
    (capture / "points.ply").write_bytes(b"ply\nformat ascii 1.0\nend_header\n")
    with pytest.raises(InputError, match="not the points that a worker writes"):
        import_capture(capture, scene)


# ------------------------------------------------------------------------------------------- operators and the worker


def test_a_run_is_imported_at_once(addon, capture):
    assert bpy.ops.cvdgs.import_capture(directory=str(capture.parent)) == {"FINISHED"}
    scene = bpy.context.scene
    assert scene.camera.name == "view0"
    assert (scene.render.resolution_x, scene.render.resolution_y) == (CAMERA.width, CAMERA.height)
    assert capture_of(scene.camera) is not None
    bpy.ops.cvdgs.look_through(step=-1)
    assert scene.camera.name == "view4"
    bpy.ops.cvdgs.place_capture(up="-Y", distance=4.0)


def test_the_panel_offers_to_import_and_to_place(addon):
    assert {"cvdgs.import_capture", "cvdgs.place_capture", "cvdgs.look_through"} <= set(
        drawn(CVDGS_PT_import_capture).operators
    )


@pytest.fixture
def foreign(capture, tmp_path) -> Path:
    """A capture that a worker has to prepare: the stand-in for one copies what is in ``prepared``."""
    folder = tmp_path / "photos"
    folder.mkdir()
    capture.rename(folder / "prepared")
    return folder


def test_other_captures_are_prepared_by_a_worker_beside_them(addon, worker, foreign):
    worker(COPYING)
    bpy.context.scene.cvdgs.capture.folder = str(foreign)
    assert bpy.ops.cvdgs.import_capture() == {"FINISHED"}
    assert (foreign.parent / "photos Undistorted" / "transforms.json").is_file()
    (background,) = bpy.context.scene.camera.data.background_images
    assert "photos Undistorted" in background.image.filepath


def test_a_folder_of_the_users_own_beside_the_capture_is_not_replaced(addon, worker, foreign):
    worker(COPYING)
    own = foreign.parent / "photos Undistorted" / "images" / "IMG_1.jpg"
    own.parent.mkdir(parents=True)
    own.write_text("mine")
    with pytest.raises(InputError, match="was not made by an earlier run"):
        importing.import_now(bpy.context.scene, importing.ImportRequest(str(foreign)))
    assert own.read_text() == "mine"
    own.unlink()
    own.parent.rmdir()
    for _ in range(2):
        importing.import_now(bpy.context.scene, importing.ImportRequest(str(foreign)))


def test_a_worker_prepares_in_the_background_and_can_be_cancelled(addon, worker, foreign):
    scene, request = bpy.context.scene, importing.ImportRequest(str(foreign))
    worker("emit('status', stage='capture', message='reading'); time.sleep(30)")
    importing.start_import(scene, request)
    assert not bpy.ops.cvdgs.import_capture.poll()
    assert "cvdgs.cancel_job" in drawn(CVDGS_PT_import_capture).operators
    bpy.ops.cvdgs.cancel_job(job=importing.JOB)
    finished(importing.JOB)
    assert not (foreign.parent / "photos Undistorted").exists()
    worker(COPYING)
    importing.start_import(scene, request)
    finished(importing.JOB)
    assert sum(cameras.is_capture_camera(candidate) for candidate in scene.objects) == 5


def test_points_whose_colours_have_16_bits_are_left_to_the_worker(capture):
    assert importing.ready_folder(str(capture)) == capture
    header = b"ply\nformat ascii 1.0\nelement vertex 1\n"
    header += b"".join(b"property float %c\n" % axis for axis in b"xyz")
    header += b"".join(b"property ushort %s\n" % channel for channel in (b"red", b"green", b"blue"))
    (capture / "points.ply").write_bytes(header + b"end_header\n0 0 1 65535 0 0\n")
    assert importing.ready_folder(str(capture)) is None


def test_a_wrong_folder_is_refused_with_what_to_do(addon, tmp_path):
    with pytest.raises(RuntimeError, match="no such file or folder"):
        bpy.ops.cvdgs.import_capture(directory=str(tmp_path / "nowhere"))
    assert not bpy.ops.cvdgs.place_capture.poll()
    assert not bpy.ops.cvdgs.look_through.poll()


def test_the_real_worker_prepares_the_demo(addon, tmp_path):
    demo = Path(importing.__file__).resolve().parents[1] / "core" / "demo" / "showroom"
    folder = tmp_path / "demo"
    folder.mkdir()
    document = json.loads((demo / "transforms.json").read_text())
    document["frames"] = document["frames"][:3]
    for frame in document["frames"]:
        source = demo / frame["file_path"]
        (folder / frame["file_path"]).parent.mkdir(exist_ok=True)
        (folder / frame["file_path"]).write_bytes(source.read_bytes())
        frame["k1"] = 0.01
    document.pop("ply_file_path", None)
    (folder / "transforms.json").write_text(json.dumps(document))
    assert importing.ready_folder(str(folder)) is None
    assert bpy.ops.cvdgs.import_capture(directory=str(folder)) == {"FINISHED"}
    assert len([candidate for candidate in bpy.context.scene.objects if cameras.is_capture_camera(candidate)]) == 3
