"""Names that a camera file gives, keys, and folders that are no capture."""

from __future__ import annotations

import os
import re
import shutil
import unicodedata
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cvdgs.core.capture.files import (
    Spelling,
    list_images,
    make_keys,
    natural_key,
    resolve_inside,
)
from cvdgs.core.capture.points import write_point_cloud
from cvdgs.core.capture.reader import inspect_capture, read_capture
from cvdgs.core.capture.transforms import read_transforms
from cvdgs.core.errors import InputError
from cvdgs.core.settings import AUTO

from .make_captures import (
    frames,
    intrinsics,
    pinhole,
    save,
    save_images,
    shots,
    write_colmap,
    write_transforms,
)


def refused(path: Path, cameras: str = AUTO) -> str:
    """The message with which `path` is refused, after checking that it is one line."""
    with pytest.raises(InputError) as error:
        inspect_capture(path, cameras=cameras)
    assert "\n" not in str(error.value)
    return str(error.value)


def capture_with_name(root: Path, name: str) -> Path:
    """A capture whose second frame has the given name."""
    listed = frames(shots(3))
    listed[1]["file_path"] = name
    return write_transforms(root, shots(3), {**intrinsics(pinhole()), "frames": listed})


@pytest.mark.parametrize(
    "name", ["../secret.png", "images/../../secret.png", "..\\secret.png", "images/../../../../../../etc/passwd"]
)
def test_name_that_climbs_out_is_refused(tmp_path: Path, name: str) -> None:
    save(tmp_path / "secret.png", np.zeros((72, 96, 3), np.uint8))
    assert "leads out of the capture folder" in refused(capture_with_name(tmp_path / "capture", name))


@pytest.mark.parametrize("name", ["/etc/passwd", "C:\\secret.png", "C:secret.png", "\\\\server\\share\\x.png"])
def test_absolute_name_that_leads_elsewhere_is_refused(tmp_path: Path, name: str) -> None:
    assert "absolute path" in refused(capture_with_name(tmp_path, name))


def test_absolute_name_of_a_capture_beside_is_refused(tmp_path: Path) -> None:
    other = save(tmp_path / "capture2" / "secret.png", np.zeros((72, 96, 3), np.uint8))
    assert "absolute path" in refused(capture_with_name(tmp_path / "capture", str(other)))
    climbing = tmp_path / "capture" / ".." / "capture2" / "secret.png"
    assert "absolute path" in refused(capture_with_name(tmp_path / "capture", str(climbing)))


def test_absolute_name_of_a_link_out_of_the_folder_is_refused(tmp_path: Path) -> None:
    outside = save(tmp_path / "secret.png", np.zeros((72, 96, 3), np.uint8))
    root = capture_with_name(tmp_path / "capture", str(tmp_path / "capture" / "images" / "link.png"))
    (root / "images" / "link.png").symlink_to(outside)
    assert "leads out of the capture folder" in refused(root)


def test_absolute_names_give_the_same_views_as_relative_ones(tmp_path: Path) -> None:
    root, listed = tmp_path / "capture", frames(shots(3))
    for frame in listed[1:]:
        frame["file_path"] = str(root / frame["file_path"])
    document = {**intrinsics(pinhole()), "ply_file_path": str(root / "points.ply"), "frames": listed}
    write_transforms(root, shots(3), document)
    write_point_cloud(root / "points.ply", np.ones((5, 3), np.float32), np.zeros((5, 3), np.uint8))
    (tmp_path / "link").symlink_to(root)
    for folder in (root, tmp_path / "link"):
        capture = read_capture(folder, max_size=None)
        assert [view.key for view in capture.views] == ["0001", "0002", "0003"]
        assert len(capture.points) == 5


def test_link_out_of_the_folder_is_refused(tmp_path: Path) -> None:
    outside = save(tmp_path / "secret.png", np.zeros((72, 96, 3), np.uint8))
    root = capture_with_name(tmp_path / "capture", "images/link.png")
    (root / "images" / "link.png").symlink_to(outside)
    assert "leads out of the capture folder" in refused(root)


def test_link_within_the_folder_is_followed(tmp_path: Path) -> None:
    root = capture_with_name(tmp_path, "images/link.png")
    (root / "images" / "link.png").symlink_to(root / "images" / "0002.png")
    assert len(read_capture(root, max_size=None).views) == 3


def test_cycle_of_links_is_refused(tmp_path: Path) -> None:
    root = capture_with_name(tmp_path, "images/a.png")
    (root / "images" / "a.png").symlink_to(root / "images" / "b.png")
    (root / "images" / "b.png").symlink_to(root / "images" / "a.png")
    assert "images/a.png" in refused(root)


def test_fifo_and_folder_are_refused(tmp_path: Path) -> None:
    root = capture_with_name(tmp_path, "images/pipe.png")
    os.mkfifo(root / "images" / "pipe.png")
    assert "not a regular file" in refused(root)
    (root / "images" / "pipe.png").unlink()
    (root / "images" / "pipe.png").mkdir()
    assert "not a regular file" in refused(root)


def test_camera_file_that_is_a_fifo_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "transforms.json")
    assert "not a regular file" in refused(tmp_path)


def test_image_folder_that_links_out_of_the_capture_is_refused(tmp_path: Path) -> None:
    root = write_colmap(tmp_path / "capture", shots(3))
    (root / "images").rename(tmp_path / "elsewhere")
    (root / "images").symlink_to(tmp_path / "elsewhere")
    assert "leads out of the capture folder" in refused(root)


@pytest.mark.parametrize("name", ["", "   ", "a\0b.png"])
def test_unusable_name_is_refused(tmp_path: Path, name: str) -> None:
    refused(capture_with_name(tmp_path, name))


def test_newline_in_a_name_stays_in_one_line(tmp_path: Path) -> None:
    root = write_transforms(tmp_path, shots(3, pattern="a\n{}.png"))
    assert [view.key for view in read_capture(root, max_size=None).views] == ["a_1", "a_2", "a_3"]
    save(root / "images" / "a\n2.png", np.zeros((4, 4, 3), np.uint8))
    assert "a\\n2.png" in refused(root)


def test_name_with_backslashes_is_a_path(tmp_path: Path) -> None:
    assert inspect_capture(capture_with_name(tmp_path, "images\\0002.png")).views == 3


def test_name_too_long_for_the_file_system_is_refused(tmp_path: Path) -> None:
    refused(capture_with_name(tmp_path, "x" * 5000))


@given(st.text(max_size=40))
def test_no_name_resolves_to_a_path_outside(name: str) -> None:
    root = Path(__file__).parent
    try:
        path = resolve_inside(root, name, where="file")
    except InputError:
        return
    assert path.resolve().is_relative_to(root.resolve())


# --- names in another case


def test_names_in_another_case_than_the_disks_are_found(tmp_path: Path) -> None:
    photographs = shots(3, pattern="Cam/img_{}.png")
    listed = frames(photographs)
    listed[2]["file_path"] = listed[2]["file_path"].removesuffix(".png")  # as in the NeRF synthetic layout
    write_transforms(tmp_path / "transforms", photographs, {**intrinsics(pinhole()), "frames": listed}, images=False)
    write_colmap(tmp_path / "colmap", photographs, images=False)
    for root in (tmp_path / "transforms", tmp_path / "colmap"):
        save_images(root / "images", shots(3, pattern="cam/IMG_{}.PNG"))
        capture = read_capture(root, max_size=None)
        assert [view.source.name for view in capture.views] == ["IMG_1.PNG", "IMG_2.PNG", "IMG_3.PNG"]
        assert not {warning.name for warning in capture.warnings} & {"missing-images", "unregistered"}


def test_names_in_another_form_of_unicode_than_the_disks_are_found(tmp_path: Path) -> None:
    """An umlaut of one character or of two; a Mac's copies of a camera file and of the photographs may differ in it."""
    photographs = shots(3, pattern="Küche {:d}.png")
    write_transforms(tmp_path / "nerf", photographs)
    write_colmap(tmp_path / "colmap", photographs)
    for capture in ("nerf", "colmap"):
        for file in (tmp_path / capture / "images").iterdir():
            file.rename(file.with_name(unicodedata.normalize("NFD", file.name)))
        found = inspect_capture(tmp_path / capture)
        assert (found.views, [w.name for w in found.warnings if w.name == "unregistered"]) == (3, [])


def test_another_image_whose_name_differs_in_its_case_alone_is_not_taken(tmp_path: Path) -> None:
    photographs = [*shots(2), *shots(2, pattern="p{}.png"), *shots(1, pattern="P{}.png")]
    write_colmap(tmp_path, photographs)
    if len(list((tmp_path / "images").iterdir())) < len(photographs):
        pytest.skip("this file system knows no case")
    (tmp_path / "images" / "P1.png").unlink()  # p1.png is there, and of another camera
    (tmp_path / "images" / "p2.png").rename(tmp_path / "images" / "P2.png")
    shutil.copy(tmp_path / "images" / "P2.png", tmp_path / "images" / "p2.PNG")  # either could be meant
    capture = read_capture(tmp_path, max_size=None)
    assert [view.source.name for view in capture.views] == ["0001.png", "0002.png", "p1.png"]


def test_another_extension_is_not_another_spelling(tmp_path: Path) -> None:
    write_colmap(tmp_path, shots(4))
    (tmp_path / "images" / "0002.png").rename(tmp_path / "images" / "0002.jpg")
    assert inspect_capture(tmp_path).views == 3


def test_link_out_of_the_folder_is_refused_in_another_case_too(tmp_path: Path) -> None:
    outside = save(tmp_path / "secret.png", np.zeros((72, 96, 3), np.uint8))
    root = capture_with_name(tmp_path / "capture", "images/link.png")
    (root / "images" / "LINK.png").symlink_to(outside)
    assert "leads out of the capture folder" in refused(root)


def test_thousands_of_missing_names_take_one_listing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    listed: list[Path] = []
    monkeypatch.setattr(os, "listdir", lambda folder: listed.append(folder) or ["A.PNG"])
    names = [f"{number}.png" for number in range(1000)]
    spelling = Spelling(names)
    assert [spelling.find(tmp_path, name) for name in names] == names
    assert listed == [tmp_path]


# --- keys


@given(st.lists(st.text(min_size=1, max_size=30), unique=True, max_size=20))
def test_keys_are_safe_and_unique_without_regard_to_case(names: list[str]) -> None:
    keys = make_keys(names)
    assert len({key.lower() for key in keys}) == len(names)
    for key in keys:
        letters = "".join(c for c in key if not unicodedata.category(c).startswith("M"))
        assert re.fullmatch(r"[\w.-]*", letters)
        assert not key.startswith(".")
        assert len(key.encode()) <= 140


@given(st.lists(st.text(min_size=1, max_size=30), unique=True, max_size=20))
def test_key_of_a_key_is_itself(names: list[str]) -> None:
    keys = make_keys(names)
    assert make_keys([f"images/{key}.png" for key in keys]) == keys


@pytest.mark.parametrize(
    ("names", "keys"),
    [
        (["images/cam1/0001.jpg", "images/cam2/0001.jpg"], ["cam1_0001", "cam2_0001"]),
        (["./train/r_0", "./train/r_1"], ["r_0", "r_1"]),
        (["a.jpg", "a.png", "A.tif"], ["a_jpg", "a_png", "A_tif"]),
        (["con.png", "x y/z.png"], ["_con", "x_y_z"]),
        ([".png"], ["png"]),
        (["日本.png", "Ma\u0308rz {1}.png", "हिन्दी/१.png"], ["日本", "M\u00e4rz_1_", "हिन्दी_१"]),
        (["写" * 60 + ".png", "com\u00b9.png", "\u202egnp.jpg"], ["写" * 40, "_com\u00b9", "_gnp"]),
    ],
)
def test_keys_are_readable(names: list[str], keys: list[str]) -> None:
    assert make_keys(names) == keys


@given(st.lists(st.text()))
def test_natural_order_does_not_depend_on_the_order_given(names: list[str]) -> None:
    backwards = names[::-1]
    assert sorted(names, key=natural_key) == sorted(backwards, key=natural_key)


def test_numbers_are_ordered_by_value() -> None:
    assert sorted(["10.jpg", "2.jpg", "a.jpg", "1.jpg"], key=natural_key) == ["1.jpg", "2.jpg", "10.jpg", "a.jpg"]


# --- what scripts/enhance.py has made


def enhanced_into(folder: Path, names: tuple[str, ...]) -> None:
    """What scripts/enhance.py leaves in `folder`."""
    folder.mkdir(exist_ok=True)
    rows = [f"{name}.jpg,{name}.png" for name in names]
    (folder / "metrics.csv").write_text("\n".join(["file,output", *rows, "mean,"]) + "\n")
    (folder / "sheet.html").write_text("")
    for name in names:
        (folder / f"{name}.png").write_text("")


@pytest.fixture
def photographed(tmp_path: Path) -> Path:
    """A folder with three photographs."""
    for name in ("a.jpg", "b.jpg", "c.png"):
        (tmp_path / name).write_text("")
    return tmp_path


def test_enhanced_photographs_in_a_folder_below_are_no_further_photographs(photographed: Path) -> None:
    enhanced_into(photographed / "friendly", ("a", "b", "c"))
    (photographed / "friendly" / "later.jpg").write_text("")
    assert list_images(photographed) == ["a.jpg", "b.jpg", "c.png", "friendly/later.jpg"]


def test_enhanced_photographs_beside_the_originals_are_no_further_photographs(photographed: Path) -> None:
    enhanced_into(photographed, ("a", "b"))
    assert list_images(photographed) == ["a.jpg", "b.jpg", "c.png"]


def test_a_folder_of_enhanced_photographs_alone_can_be_a_capture(tmp_path: Path) -> None:
    enhanced_into(tmp_path / "friendly", ("a", "b"))
    (tmp_path / "friendly" / "failed.enhance.log").write_text("")  # of a later attempt
    assert list_images(tmp_path / "friendly") == ["a.png", "b.png"]


# --- what is no capture


def test_a_folder_that_cannot_be_listed_is_not_an_empty_one(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        list_images(tmp_path / "gone")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_photographs_that_may_not_be_read_are_not_called_missing(tmp_path: Path) -> None:
    save_images(tmp_path / "images", shots(3))
    (tmp_path / "images").chmod(0)
    assert "Permission denied" in refused(tmp_path)


def test_missing_folder_is_named(tmp_path: Path) -> None:
    assert "no such file or folder" in refused(tmp_path / "absent")
    assert "no such file or folder" in refused(tmp_path / ("a" * 300))


def test_empty_folder_says_what_to_give(tmp_path: Path) -> None:
    assert "no photographs" in refused(tmp_path)


def test_photographs_of_a_format_that_is_not_read_are_named(tmp_path: Path) -> None:
    for name in ("IMG_0002.psd", "IMG_0001.RAF", "IMG_0003.NRW", "notes.txt"):
        (tmp_path / name).write_text("")
    message = refused(tmp_path)
    assert "only IMG_0001.RAF, IMG_0002.psd, IMG_0003.NRW" in message
    assert "as JPEG, PNG or TIFF" in message


@pytest.mark.parametrize(
    ("names", "remedy"),
    [
        ("Photos-001.zip Photos-002.zip", "give the zip itself, or unpack it"),
        ("shop.7z", "unpack it, and give the folder"),
    ],
)
def test_a_folder_with_nothing_but_archives_says_so(tmp_path: Path, names: str, remedy: str) -> None:
    for name in names.split():
        (tmp_path / name).write_text("")
    assert f"no photographs that can be read, only {', '.join(names.split())} - {remedy}" in refused(tmp_path)


def test_a_sequence_of_splats_is_told_from_a_capture(tmp_path: Path) -> None:
    for number in range(5):
        (tmp_path / f"frame_{number}.ply").write_text("")
    message = refused(tmp_path)
    assert "only frame_0.ply, frame_1.ply, frame_2.ply and 2 more, and sequences of splats cannot be shown" in message
    assert "give the photographs or the video that they were made from" in message


def test_another_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "x.docx").write_text("")
    assert "not a capture" in refused(tmp_path / "x.docx")


def test_fifo_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.json")
    assert "not a capture" in refused(tmp_path / "pipe.json")


def test_photographs_without_cameras_are_refused_where_given_ones_are_wanted(tmp_path: Path) -> None:
    save_images(tmp_path / "images", shots(3))
    message = refused(tmp_path, "given")
    assert "3 photographs but no cameras" in message
    assert "--cameras given" in message
    assert inspect_capture(tmp_path).format == "sfm"


@pytest.mark.parametrize("at", ["", "images"])
def test_a_camera_file_from_elsewhere_is_for_the_photographs_of_the_capture(tmp_path: Path, at: str) -> None:
    (tmp_path / "photos").mkdir()
    cameras = write_transforms(tmp_path / "solved", shots(3)) / "transforms.json"
    (tmp_path / "solved" / "images").rename(tmp_path / "photos" / "images")
    found = inspect_capture(tmp_path / "photos" / at, cameras=str(cameras))
    assert (found.format, found.views) == ("transforms", 3)
    assert "no such file" in refused(tmp_path / "photos", str(tmp_path / "gone.json"))


def test_photographs_beside_the_given_folder_of_images_are_refused(tmp_path: Path) -> None:
    photographs = shots(3)
    listed = [*frames(photographs[:2], "Pictures/"), *frames(photographs[2:], "Documents/")]
    document = {**intrinsics(photographs[0].camera), "frames": listed}
    cameras = write_transforms(tmp_path, photographs, document, images=False) / "transforms.json"
    for name in ("Pictures", "Documents"):
        save_images(tmp_path / name, photographs)
    assert "'Documents/0003.png' leads out of the capture" in refused(tmp_path / "Pictures", str(cameras))


@pytest.mark.parametrize(("folder", "is_read"), [("masks", True), ("Documents", False)])
def test_masks_may_lie_beside_the_given_folder_of_images_but_nowhere_else(tmp_path: Path, folder, is_read) -> None:
    photographs = shots(2)
    listed = [frame | {"mask_path": f"{folder}/{frame['file_path'][7:]}"} for frame in frames(photographs, "images/")]
    document = {**intrinsics(photographs[0].camera), "frames": listed}
    cameras = write_transforms(tmp_path, photographs, document, images=False) / "transforms.json"
    save_images(tmp_path / "images", photographs)
    save_images(tmp_path / folder, photographs)
    if is_read:
        views = read_transforms(cameras, folder=tmp_path / "images").views
        assert [view.mask for view in views] == [tmp_path / "masks" / view.path.name for view in views]
    else:
        assert "leads out of the capture" in refused(tmp_path / "images", str(cameras))


def test_a_colmap_model_from_elsewhere_is_for_the_photographs_of_the_capture(tmp_path: Path) -> None:
    write_colmap(tmp_path / "solved", shots(3))
    (tmp_path / "photos").mkdir()
    (tmp_path / "solved" / "images").rename(tmp_path / "photos" / "images")
    found = inspect_capture(tmp_path / "photos", cameras=str(tmp_path / "solved"))
    assert (found.format, found.views) == ("colmap", 3)


def test_given_cameras_are_left_aside_where_others_are_to_be_estimated(tmp_path: Path) -> None:
    root = write_transforms(tmp_path, shots(3))
    assert inspect_capture(root).format == "transforms"
    assert inspect_capture(root, cameras="estimate").format == "sfm"


# What else RealityScan writes stands before the rotation.
XMP = b"<x:xmpmeta><rdf:Description " + b"xcr:CalibrationPrior='initial' " * 40 + b"><xcr:Rotation>1 0 0 0 1 0 0 0 1"


@pytest.mark.parametrize(
    ("program", "name", "content", "how"),
    [
        ("OpenSfM", "opensfm/reconstruction.json", b"[{}]", "opensfm export_colmap"),
        ("Bundler", "bundle/bundle.out", b"# Bundle file v0.3\n2 10\n", "export a COLMAP model"),
        ("LLFF", "poses_bounds.npy", b"\x93NUMPY not to be loaded", "COLMAP model that they were made from"),
        ("Meshroom", "MeshroomCache/StructureFromMotion/0f3a/cameras.sfm", b"{}", "aliceVision_exportColmap"),
        ("OpenMVG", "reconstruction/sfm_data.json", b"{}", "openMVG_main_openMVG2Colmap"),
        ("RealityScan", "images/1.xmp", XMP, "Registration, COLMAP"),
        ("RealityScan", "poses.csv", b"#name,x,y,alt,heading,pitch,roll,f\n1.jpg,0,0,0,0,0,0,26\n", "Export Reg"),
        ("Metashape", "cameras.xml", b'<?xml version="1.0"?>\n<document version="2.0">\n <chunk>', "Export Cameras"),
    ],
)
def test_cameras_of_a_program_that_are_not_read_are_named(
    tmp_path: Path, program: str, name: str, content: bytes, how: str
) -> None:
    save_images(tmp_path / "images", shots(3))
    (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / name).write_bytes(content)
    message = refused(tmp_path)
    assert f"3 photographs, and cameras of {program} ({name})" in message
    assert how in message
    assert "--cameras estimate" in message
    assert inspect_capture(tmp_path, cameras="estimate").format == "sfm"


def test_other_files_are_not_taken_for_cameras(tmp_path: Path) -> None:
    save_images(tmp_path / "images", shots(3))
    (tmp_path / "nohup.out").write_text("done\n")
    (tmp_path / "lens.xml").write_text("<lens/>")
    (tmp_path / "images" / "1.xmp").write_text("<x:xmpmeta><rdf:Description crs:Exposure2012='0.5'/></x:xmpmeta>")
    (tmp_path / "sizes.csv").write_text("name,x,y\n")
    (tmp_path / "reconstruction.json").mkdir()
    os.mkfifo(tmp_path / "pipe.out")
    assert "no cameras (COLMAP model or transforms.json)" in refused(tmp_path, "given")


def test_one_photograph_is_too_few_for_sfm(tmp_path: Path) -> None:
    save_images(tmp_path, shots(1))
    with pytest.raises(InputError, match="only one photograph - "):
        inspect_capture(tmp_path, cameras="estimate")


def test_copies_of_one_photograph_are_too_few_and_the_refusal_counts_them(tmp_path: Path) -> None:
    save_images(tmp_path, shots(1))
    (photograph,) = tmp_path.iterdir()
    for number in (1, 2):
        shutil.copy(photograph, tmp_path / f"{photograph.stem} ({number}){photograph.suffix}")
    with pytest.raises(InputError, match="only one photograph, and 2 more of it - "):
        inspect_capture(tmp_path, cameras="estimate")
