"""COLMAP models in every layout."""

from __future__ import annotations

import re
import shutil
import struct
from pathlib import Path

import numpy as np
import pycolmap
import pytest

from cvdgs.core.capture.colmap import find_colmap
from cvdgs.core.capture.colmap_files import read_model
from cvdgs.core.capture.reader import inspect_capture, read_cameras, read_capture
from cvdgs.core.errors import InputError
from cvdgs.core.runtime.protocol import Reporter

from .make_captures import (
    PlanePoints,
    frames,
    intrinsics,
    pinhole,
    reconstruction,
    save,
    save_images,
    shots,
    turned,
    warnings_of,
    with_model,
    write_colmap,
    write_transforms,
)


@pytest.mark.parametrize("text", [False, True], ids=["binary", "text"])
@pytest.mark.parametrize("old", [False, True], ids=["with-rigs", "without-rigs"])
@pytest.mark.parametrize("model_folder", ["sparse/0", "sparse", "colmap/sparse/0", "."])
def test_every_layout_gives_the_same_capture(tmp_path: Path, text: bool, old: bool, model_folder: str) -> None:
    photographs = shots(3)
    capture = read_capture(
        write_colmap(tmp_path, photographs, model_folder=model_folder, text=text, old=old), max_size=None
    )
    assert capture.format == "colmap"
    assert [view.key for view in capture.views] == ["0001", "0002", "0003"]
    for view, shot in zip(capture.views, photographs, strict=True):
        np.testing.assert_allclose(view.world_to_camera, shot.world_to_camera, atol=1e-12)
        assert (view.camera.fx, view.camera.fy, view.camera.cx, view.camera.cy) == (80.0, 80.0, 48.0, 36.0)
        np.testing.assert_array_equal(view.image, shot.render())
    order = np.lexsort(capture.points.T)
    expected = PlanePoints()
    np.testing.assert_allclose(capture.points[order], expected.positions[np.lexsort(expected.positions.T)], atol=1e-6)
    np.testing.assert_array_equal(capture.point_colors[order], expected.colors[np.lexsort(expected.positions.T)])
    assert warnings_of(capture) == ["few-views"]


@pytest.mark.parametrize(
    ("model_folder", "image_folder"),
    [
        ("colmap_sparse/0", "images"),
        ("dense/0/sparse", "dense/0/images"),
        ("distorted/sparse/0", "input"),
        ("sparse/0", "Photos"),
        ("scene/sparse/0", "scene/Photos"),
        ("scene/sparse/0", "scene/images_2"),
        ("data/scene/colmap/sparse/0", "data/scene/images"),
    ],
)
def test_models_and_photographs_of_other_programs_are_found(
    tmp_path: Path, model_folder: str, image_folder: str
) -> None:
    photographs = shots(3)
    write_colmap(tmp_path, photographs, model_folder=model_folder, images=False)
    save_images(tmp_path / image_folder, photographs)
    save_images(tmp_path / "masks", photographs)
    capture = read_capture(tmp_path, max_size=None)
    assert capture.format == "colmap"
    assert [view.source.parent for view in capture.views] == [(tmp_path / image_folder).resolve()] * 3


def test_undistorted_photographs_belong_to_the_model_beside_them(tmp_path: Path) -> None:
    photographs = shots(3)
    write_colmap(tmp_path, photographs, model_folder="dense/sparse", images=False)
    save_images(tmp_path / "dense" / "images", photographs)
    save_images(tmp_path / "images", photographs)
    capture = read_capture(tmp_path, max_size=None)
    assert capture.views[0].source.resolve().is_relative_to(tmp_path.resolve() / "dense")


@pytest.mark.parametrize("model", ["OPENCV", "OPENCV_FISHEYE", "PINHOLE"])
def test_undistorted_photographs_are_not_undistorted_once_more(tmp_path: Path, model: str) -> None:
    """A ScanNet++ scene of which these alone were downloaded."""
    lens = pinhole() if model == "PINHOLE" else with_model(model, [0.1, 0.05, 0.0, 0.0])
    write_colmap(tmp_path, shots(3, lens), model_folder="dslr/colmap", text=True, images=False)
    save_images(tmp_path / "dslr" / "resized_undistorted_images", shots(3))
    for given in (tmp_path, tmp_path / "dslr"):
        if model == "PINHOLE":
            assert inspect_capture(given).views == 3
        else:
            with pytest.raises(InputError, match=r"have distortion, but the photographs \(resized_undistorted_images"):
                inspect_capture(given)
    save_images(tmp_path / "dslr" / "resized_images", shots(3, lens))
    assert inspect_capture(tmp_path).views == 3
    cameras = {**intrinsics(pinhole()), "frames": frames(shots(3), "")}
    write_transforms(tmp_path, shots(3), cameras, name="transforms_undistorted.json", images=False)
    undistorted, file = tmp_path / "dslr" / "resized_undistorted_images", tmp_path / "transforms_undistorted.json"
    assert inspect_capture(undistorted, cameras=str(file)).views == 3


def test_models_behind_links_are_not_looked_for(tmp_path: Path) -> None:
    photographs = shots(3)
    write_colmap(tmp_path / "elsewhere", photographs, model_folder="model", images=False)
    save_images(tmp_path / "capture" / "images", photographs)
    (tmp_path / "capture" / "linked").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(InputError, match="photographs but no cameras"):
        read_capture(tmp_path / "capture", max_size=None, cameras="given")


def test_of_captures_side_by_side_none_is_taken(tmp_path: Path) -> None:
    for name, focal in (("monday", 80.0), ("tuesday", 90.0)):
        write_colmap(tmp_path / name, shots(3, pinhole(focal=focal)))
    with pytest.raises(InputError) as error:
        inspect_capture(tmp_path)
    assert "2 captures with cameras are in it: monday, tuesday - give the folder of one of them" in str(error.value)
    assert inspect_capture(tmp_path, cameras="estimate").views == 6


@pytest.mark.parametrize("text", [False, True], ids=["binary", "text"])
def test_a_model_without_a_file_of_points_has_none(tmp_path: Path, text: bool) -> None:
    root = write_colmap(tmp_path, shots(3), text=text)
    next(root.rglob("points3D.*")).unlink()
    capture = read_capture(root, max_size=None)
    assert (len(capture.views), capture.points.shape, capture.point_colors.shape) == (3, (0, 3), (0, 3))
    assert "no-points" in warnings_of(capture)


def test_text_is_read_where_the_binary_form_alone_lacks_points(tmp_path: Path) -> None:
    write_colmap(tmp_path, shots(3), text=True)
    write_colmap(tmp_path, shots(3))
    next(tmp_path.rglob("points3D.bin")).unlink()
    assert inspect_capture(tmp_path).points == 30


def test_something_else_in_the_place_of_the_points_is_refused(tmp_path: Path) -> None:
    root = write_colmap(tmp_path, shots(3))
    file = next(root.rglob("points3D.bin"))
    file.unlink()
    file.mkdir()
    with pytest.raises(InputError, match=r"points3D\.bin"):
        inspect_capture(root)


def test_the_missing_file_of_a_binary_model_is_named(tmp_path: Path) -> None:
    root = write_colmap(tmp_path, shots(3))
    next(root.rglob("images.bin")).unlink()
    with pytest.raises(InputError, match=r"images\.bin is missing"):
        read_capture(root, max_size=None)


def test_points_lie_where_the_views_show_their_colours(tmp_path: Path) -> None:
    capture = read_capture(write_colmap(tmp_path, shots(3)), max_size=None)
    view = capture.views[1]
    local = capture.points @ view.world_to_camera[:3, :3].T + view.world_to_camera[:3, 3]
    u = view.camera.fx * local[:, 0] / local[:, 2] + view.camera.cx
    v = view.camera.fy * local[:, 1] / local[:, 2] + view.camera.cy
    seen = (u > 1) & (v > 1) & (u < view.camera.width - 1) & (v < view.camera.height - 1)
    assert seen.sum() > 10
    colors = view.image[v[seen].astype(int), u[seen].astype(int)].astype(int)
    assert np.abs(colors - capture.point_colors[seen]).mean() < 3.0


def test_images_of_a_rig_have_the_poses_that_colmap_gives_them(tmp_path: Path) -> None:
    model = pycolmap.Reconstruction()
    rig = pycolmap.Rig(rig_id=1)
    offset = pycolmap.Rigid3d(np.column_stack([turned(20.0), [0.5, -0.2, 0.1]]))
    for number in (1, 2):
        camera = pinhole(camera_id=number)
        model.add_camera(camera)
        rig.add_ref_sensor(camera.sensor_id) if number == 1 else rig.add_sensor(camera.sensor_id, offset)
    model.add_rig(rig)
    for frame_number, shot in enumerate(shots(2), start=1):
        frame = pycolmap.Frame(frame_id=frame_number, rig_id=1)
        images = [
            pycolmap.Image(name=f"{number}/{shot.name}", camera_id=number, image_id=10 * frame_number + number)
            for number in (1, 2)
        ]
        for image in images:
            frame.add_data_id(image.data_id)
            image.frame_id = frame_number
        frame.rig_from_world = pycolmap.Rigid3d(shot.world_to_camera[:3])
        model.add_frame(frame)
        for image in images:
            model.add_image(image)
        model.register_frame(frame_number)
    model.write_binary(str(tmp_path))
    expected = {image.name: image.cam_from_world().matrix() for image in model.images.values()}
    read = {image.name: image.world_to_camera for image in read_model(tmp_path).images}
    assert read.keys() == expected.keys()
    assert len(read) == 4
    for name, pose in read.items():
        np.testing.assert_allclose(pose, expected[name], atol=1e-12)


def test_the_models_own_folder_is_accepted(tmp_path: Path) -> None:
    write_colmap(tmp_path, shots(3))
    assert len(read_capture(tmp_path / "sparse" / "0", max_size=None).views) == 3


def test_binary_is_preferred_to_text(tmp_path: Path) -> None:
    write_colmap(tmp_path, shots(3))
    (tmp_path / "sparse" / "0" / "cameras.txt").write_text("1 PINHOLE 96 72 999 999 48 36\n")
    assert read_capture(tmp_path, max_size=None).views[0].camera.fx == 80.0


def test_subfolders_and_several_cameras(tmp_path: Path) -> None:
    left, right = pinhole(camera_id=1), pinhole(72, 96, focal=60.0, camera_id=2)
    photographs = shots(2, left, "cam1/{:04d}.png") + shots(2, right, "cam2/{:04d}.png")
    capture = read_capture(write_colmap(tmp_path, photographs), max_size=None)
    assert [view.key for view in capture.views] == ["cam1_0001", "cam1_0002", "cam2_0001", "cam2_0002"]
    assert [(view.camera.width, view.camera.fx) for view in capture.views] == [(96, 80.0)] * 2 + [(72, 60.0)] * 2
    assert "mixed-sizes" in warnings_of(capture)


def test_of_many_sizes_the_most_frequent_are_told_and_the_others_counted(tmp_path: Path) -> None:
    cameras = [pinhole(60 + 2 * number, 72, camera_id=number + 1) for number in range(5)]
    photographs = [shot for n, camera in enumerate(cameras) for shot in shots(2, camera, f"cam{n}/{{:04d}}.png")]
    [told] = [
        w.message
        for w in read_capture(write_colmap(tmp_path, photographs), max_size=None).warnings
        if w.name == "mixed-sizes"
    ]
    assert told.count(" (2)") == 3
    assert told.endswith(" and 2 more")


def test_views_are_in_natural_order(tmp_path: Path) -> None:
    photographs = shots(11, pattern="p{}.png")
    capture = read_capture(write_colmap(tmp_path, photographs), max_size=32)
    assert [view.key for view in capture.views] == [f"p{i}" for i in range(1, 12)]


def test_images_beside_the_model_are_found(tmp_path: Path) -> None:
    capture = read_capture(write_colmap(tmp_path, shots(3), image_folder="input"), max_size=None)
    assert capture.views[0].source == tmp_path / "input" / "0001.png"


def test_downscaled_images_rescale_the_camera(tmp_path: Path) -> None:
    small = [shot.__class__(shot.name, pinhole(48, 36, 40.0), shot.world_to_camera) for shot in shots(3)]
    write_colmap(tmp_path, shots(3), images=False)
    save_images(tmp_path / "images_2", small)
    camera = read_capture(tmp_path, max_size=None).views[0].camera
    assert (camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy) == (48, 36, 40.0, 40.0, 24.0, 18.0)


def test_largest_of_several_models_is_used(tmp_path: Path) -> None:
    write_colmap(tmp_path, shots(2), model_folder="sparse/0", images=False)
    write_colmap(tmp_path, shots(4), model_folder="sparse/1")
    capture = read_capture(tmp_path, max_size=None)
    assert len(capture.views) == 4
    assert "several-models" in warnings_of(capture)


def test_missing_images_are_left_out_and_listed(tmp_path: Path) -> None:
    write_colmap(tmp_path, shots(4))
    (tmp_path / "images" / "0002.png").unlink()
    capture = read_capture(tmp_path, max_size=None)
    assert [view.key for view in capture.views] == ["0001", "0003", "0004"]
    (message,) = [warning.message for warning in capture.warnings if warning.name == "missing-images"]
    assert "1 of 4" in message
    assert "0002.png" in message


def test_photographs_without_a_camera_are_counted(tmp_path: Path) -> None:
    write_colmap(tmp_path, shots(3))
    save(tmp_path / "images" / "extra.png", np.zeros((72, 96, 3), np.uint8))
    (message,) = [w.message for w in read_capture(tmp_path, max_size=None).warnings if w.name == "unregistered"]
    assert "extra.png" in message


def test_masks_beside_photographs_in_the_capture_folder_itself_are_no_photographs_without_a_camera(
    tmp_path: Path,
) -> None:
    write_colmap(tmp_path, shots(3), image_folder=".")
    mask = np.full((72, 96, 3), 255, np.uint8)
    mask[:, :48] = 0
    save(tmp_path / "masks" / "0001.png", mask)
    capture = read_capture(tmp_path, max_size=None)
    assert "unregistered" not in warnings_of(capture)
    assert [view.mask is not None for view in capture.views] == [True, False, False]


@pytest.mark.parametrize("keep", [0, 1])
def test_fewer_than_two_images_are_refused(tmp_path: Path, keep: int) -> None:
    write_colmap(tmp_path, shots(3))
    for path in sorted((tmp_path / "images").iterdir())[keep:]:
        path.unlink()
    with pytest.raises(InputError, match="at least two"):
        read_capture(tmp_path, max_size=None)


@pytest.mark.parametrize("name", ["cameras", "images", "points3D"])
@pytest.mark.parametrize("part", [0.0, 0.1, 0.5, 0.9, 0.999])
def test_cut_binary_file_is_refused_by_name(tmp_path: Path, name: str, part: float) -> None:
    write_colmap(tmp_path, shots(3))
    file = tmp_path / "sparse" / "0" / f"{name}.bin"
    data = file.read_bytes()
    file.write_bytes(data[: int(len(data) * part)])
    with pytest.raises(InputError, match=f"{name}.bin: the file is cut short"):
        inspect_capture(tmp_path)


@pytest.mark.parametrize("name", ["cameras", "images", "points3D"])
def test_count_beyond_the_file_is_refused_at_once(tmp_path: Path, name: str) -> None:
    write_colmap(tmp_path, shots(3))
    file = tmp_path / "sparse" / "0" / f"{name}.bin"
    file.write_bytes(struct.pack("<Q", 2**62) + file.read_bytes()[8:])
    with pytest.raises(InputError, match="cut short"):
        inspect_capture(tmp_path)


@pytest.mark.parametrize("name", ["cameras", "images", "points3D"])
@pytest.mark.parametrize("part", [0.3, 0.6, 0.97])
def test_cut_text_file_is_refused(tmp_path: Path, name: str, part: float) -> None:
    write_colmap(tmp_path, shots(3), text=True)
    file = tmp_path / "sparse" / "0" / f"{name}.txt"
    text = file.read_text()
    header = text.rindex("\n#") if "\n#" in text else 0
    file.write_text(text[: header + int((len(text) - header) * part)])
    with pytest.raises(InputError, match=r"cut short|damaged"):
        inspect_capture(tmp_path)


@pytest.mark.parametrize("text", [False, True], ids=["binary", "text"])
@pytest.mark.parametrize("length", [0, 1])
def test_points_of_programs_that_write_no_tracks_are_kept(tmp_path: Path, text: bool, length: int) -> None:
    write_colmap(tmp_path, shots(3), text=text)
    with_tracks = inspect_capture(tmp_path).points
    rewrite_points(tmp_path / "sparse" / "0", text, [length] * with_tracks)
    assert inspect_capture(tmp_path).points == with_tracks


@pytest.mark.parametrize("text", [False, True], ids=["binary", "text"])
def test_beside_longer_tracks_a_point_of_one_view_is_left_out(tmp_path: Path, text: bool) -> None:
    write_colmap(tmp_path, shots(3), text=text)
    rewrite_points(tmp_path / "sparse" / "0", text, [2, 1, 0, 3])
    np.testing.assert_array_equal(read_model(tmp_path / "sparse" / "0").points[:, 0], [0, 2, 3])


@pytest.mark.parametrize("text", [False, True], ids=["binary", "text"])
def test_many_points_are_read_with_progress_and_few_without(tmp_path: Path, text: bool) -> None:
    class Listener(Reporter):
        def __init__(self) -> None:
            self.heard: list[float] = []

        def progress(self, stage: str, fraction: float, message: str = "") -> None:
            self.heard.append(fraction)

    write_colmap(tmp_path, shots(3), text=text)
    few, many = Listener(), Listener()
    inspect_capture(tmp_path, reporter=few)
    assert few.heard == []
    rewrite_points(tmp_path / "sparse" / "0", text, [2] * 150_000)
    assert inspect_capture(tmp_path, reporter=many).points == 150_000
    assert many.heard == sorted(many.heard)
    assert len(many.heard) >= 2
    assert 0.0 < many.heard[0] <= many.heard[-1] <= 1.0


def rewrite_points(model: Path, text: bool, track_lengths: list[int]) -> None:
    """Replace the points by grey ones on the x axis at 0, 1, ..., whose tracks name so many images."""
    if text:
        lines = [f"{i} {i} 0 0 9 9 9 0.5" + " 1 0" * length for i, length in enumerate(track_lengths)]
        (model / "points3D.txt").write_text("\n".join(lines) + "\n")
        return
    records = [
        struct.pack("<Q3d3BdQ", i, i, 0, 0, 9, 9, 9, 0.5, length) + bytes(8 * length)
        for i, length in enumerate(track_lengths)
    ]
    (model / "points3D.bin").write_bytes(struct.pack("<Q", len(records)) + b"".join(records))


@pytest.mark.parametrize("name", ["cameras", "images", "points3D"])
def test_text_with_a_mark_of_windows_editors_is_read(tmp_path: Path, name: str) -> None:
    write_colmap(tmp_path, shots(3), text=True)
    file = tmp_path / "sparse" / "0" / f"{name}.txt"
    expected = inspect_capture(tmp_path)
    file.write_bytes(b"\xef\xbb\xbf" + file.read_bytes().replace(b"\n", b"\r\n"))
    assert inspect_capture(tmp_path) == expected


def test_a_comment_that_counts_too_few_does_not_make_a_text_file_damaged(tmp_path: Path) -> None:
    write_colmap(tmp_path, shots(3), text=True)
    file = tmp_path / "sparse" / "0" / "images.txt"
    file.write_text(re.sub(r"Number of images: \d+", "Number of images: 0", file.read_text()))
    assert inspect_capture(tmp_path).views == 3


def test_missing_model_file_is_named(tmp_path: Path) -> None:
    write_colmap(tmp_path, shots(3))
    (tmp_path / "sparse" / "0" / "cameras.bin").unlink()
    with pytest.raises(InputError, match=r"cameras.bin is missing"):
        inspect_capture(tmp_path)


@pytest.mark.parametrize("place", ["", "sparse/0", "a/b/c"])
@pytest.mark.parametrize("text", ["0001.png\n0002.png\n", "# my images\n1 0001.png\n", ""])
def test_a_list_of_photographs_called_like_colmaps_is_no_model(tmp_path: Path, place: str, text: str) -> None:
    save_images(tmp_path, shots(3))
    (tmp_path / place).mkdir(parents=True, exist_ok=True)
    (tmp_path / place / "images.txt").write_text(text)
    assert find_colmap(tmp_path) is None
    assert read_cameras(tmp_path) is None


@pytest.mark.parametrize(
    ("place", "kept"), [("sparse/0", slice(4)), ("sparse/0", slice(4, None)), ("a/b/c", slice(None))]
)
def test_a_text_model_without_its_cameras_is_refused(tmp_path: Path, place: str, kept: slice) -> None:
    """COLMAP's header of four lines is enough to know it, and so is an entry."""
    write_colmap(tmp_path, shots(3), model_folder=place, text=True)
    (tmp_path / place / "cameras.txt").unlink()
    images = tmp_path / place / "images.txt"
    images.write_text("".join(images.read_text().splitlines(keepends=True)[kept]))
    with pytest.raises(InputError, match=r"cameras.txt is missing - .*, or add --cameras estimate"):
        inspect_capture(tmp_path)


def test_image_of_an_absent_camera_is_refused(tmp_path: Path) -> None:
    write_colmap(tmp_path, shots(3), text=True, old=True)
    cameras = tmp_path / "sparse" / "0" / "cameras.txt"
    cameras.write_text(cameras.read_text().replace("\n1 PINHOLE", "\n7 PINHOLE"))
    with pytest.raises(InputError, match="damaged"):
        inspect_capture(tmp_path)


def test_two_images_of_one_name_are_refused(tmp_path: Path) -> None:
    write_colmap(tmp_path, [*shots(3), shots(1)[0]])
    with pytest.raises(InputError, match=r"same name: 0001\.png"):
        inspect_capture(tmp_path)


@pytest.mark.parametrize(
    ("text", "model", "stored"), [(True, "FISHEYE624", b" FISHEYE624 "), (False, "624", struct.pack("<i", 624))]
)
def test_unknown_camera_model_is_named_beside_those_that_are_known(
    tmp_path: Path, text: bool, model: str, stored: bytes
) -> None:
    write_colmap(tmp_path, shots(3), text=text)
    file = tmp_path / "sparse" / "0" / ("cameras.txt" if text else "cameras.bin")
    data = file.read_bytes()
    # In a binary file the model's number follows the count and the camera's number.
    file.write_bytes(data.replace(b" PINHOLE ", stored) if text else data[:12] + stored + data[16:])
    with pytest.raises(InputError, match=rf"camera model {model} is unknown - export it as one of .*PINHOLE, .*OPENCV"):
        inspect_capture(tmp_path)


def test_full_panorama_is_refused(tmp_path: Path) -> None:
    write_colmap(tmp_path, shots(3), text=True)
    (tmp_path / "sparse" / "0" / "cameras.txt").write_text("1 EQUIRECTANGULAR 96 72 96 72\n")
    with pytest.raises(InputError, match="panorama"):
        inspect_capture(tmp_path)


@pytest.mark.parametrize("focal", ["nan", "0", "-80", "inf"])
def test_unusable_focal_length_is_refused(tmp_path: Path, focal: str) -> None:
    write_colmap(tmp_path, shots(3), text=True)
    (tmp_path / "sparse" / "0" / "cameras.txt").write_text(f"1 SIMPLE_PINHOLE 96 72 {focal} 48 36\n")
    with pytest.raises(InputError, match=r"focal length|VerifyParams"):
        inspect_capture(tmp_path)


def test_model_without_registered_images_is_refused(tmp_path: Path) -> None:
    (tmp_path / "sparse").mkdir()
    reconstruction([]).write_binary(str(tmp_path / "sparse"))
    save_images(tmp_path / "images", shots(2))
    with pytest.raises(InputError, match="no registered image"):
        inspect_capture(tmp_path)


@pytest.mark.parametrize("name", ["../../0001.png", "/etc/hostname", "sub/../../../x.png", "C:\\x.png"])
def test_name_that_leaves_the_folder_is_refused(tmp_path: Path, name: str) -> None:
    photographs = shots(3)
    write_colmap(tmp_path, photographs, images=True)
    photographs[1].name = name
    shutil.rmtree(tmp_path / "sparse")
    write_colmap(tmp_path, photographs, images=False)
    with pytest.raises(InputError, match=r"leads out of the capture folder|absolute path"):
        inspect_capture(tmp_path)
