"""What lies in a folder becomes photographs that everything reads."""

from __future__ import annotations

import json
from pathlib import Path

import av
import numpy as np
import pytest
from PIL import Image

from cvdgs.core.capture.images import read_header
from cvdgs.core.capture.material import FRAMES_FILE, find_material, make_photographs, masks_of, unpacked
from cvdgs.core.capture.model import Capture, PinholeCamera, View
from cvdgs.core.capture.normalised import write_capture
from cvdgs.core.capture.reader import read_capture
from cvdgs.core.errors import InputError
from cvdgs.core.runs.report import SCHEMA
from cvdgs.core.runtime.protocol import Reporter

from .dng import write_dng
from .films import HEIGHT, RATE, WIDTH, wall, window, write_video
from .test_archive import write_zip
from .test_photographs import save
from .test_video_files import cut

WALL = wall()


def photograph(number: int = 0) -> np.ndarray:
    """(64, 96, 3), another one for every number."""
    return WALL[number : 64 + number, :96]


def test_plain_photographs_stay_where_they_are(tmp_path: Path) -> None:
    (tmp_path / "images").mkdir()
    (tmp_path / "masks").mkdir()
    for number, name in enumerate(("images/2.jpg", "images/10.jpg", "masks/2.png")):
        save(tmp_path / name, photograph(number))
    made = make_photographs(find_material(tmp_path), tmp_path / "out", Reporter())
    assert (made.folder, made.names) == (tmp_path / "images", ["2.jpg", "10.jpg"])
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("images", "masks"),
    [("scene/images", "scene/masks"), ("Images", "Masks"), ("a/b/Images/left", "a/b/MASKS/left"), ("c", "masks/c")],
)
@pytest.mark.parametrize("ending", [".jpg.png", ".png"])
def test_masks_in_any_folder_are_masks_and_no_photographs(tmp_path: Path, images: str, masks: str, ending: str) -> None:
    for number in (1, 2):
        for name in (f"{images}/{number}.jpg", f"{masks}/{number}{ending}"):
            (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
            save(tmp_path / name, photograph(number))
    material = find_material(tmp_path)
    assert material.photographs == (f"{images}/1.jpg", f"{images}/2.jpg")
    found = masks_of(material)
    assert found.unused == []
    assert found.files == {f"{images}/{n}.jpg": tmp_path / masks / f"{n}{ending}" for n in (1, 2)}


MASKS_AMONG = {
    "COLMAP": "1.jpg 2.jpg 1.jpg.png 2.jpg.png",
    "RealityScan": "images/1.JPG images/2.JPG images/1.mask.png images/2.JPG.mask.png",
    "Metashape": "images/a/1.jpg images/a/2.jpg images/a/1_mask.png images/a/2_mask.PNG",
    "instant-ngp": "images/1.jpg images/2.jpg images/dynamic_mask_1.png images/dynamic_mask_2.png",
}


@pytest.mark.parametrize("names", MASKS_AMONG.values(), ids=MASKS_AMONG.keys())
def test_masks_among_photographs_are_no_photographs_and_are_named(tmp_path: Path, names: str) -> None:
    make_files(tmp_path, names)
    material = find_material(tmp_path)
    assert material.photographs == tuple(names.split()[:2])
    found = masks_of(material)
    assert found.files == {}
    assert found.misplaced == names.split()[2:]


@pytest.mark.parametrize("mask", ["walk.mp4.png", "walk_mask.png", "mask/walk.png"])
def test_the_mask_of_a_video_beside_it_is_no_photograph_and_is_named(tmp_path: Path, mask: str) -> None:
    make_files(tmp_path, f"walk.mp4 {mask}")
    material = find_material(tmp_path)
    assert (material.photographs, material.videos) == ((), ("walk.mp4",))
    found = masks_of(material)
    assert found.files == {}
    assert [*found.misplaced, *(f"{folder.name}/walk.png" for folder in found.misnamed)] == [mask]


def test_a_mask_may_be_called_after_the_same_photograph_in_another_format(tmp_path: Path) -> None:
    make_files(tmp_path, "1.DNG 1.JPG 2.DNG 2.JPG masks/1.JPG.png masks/2.DNG.png masks/2.JPG.png")
    material = find_material(tmp_path)
    assert material.photographs == ("1.DNG", "2.DNG")
    found = masks_of(material)
    assert {name: path.name for name, path in found.files.items()} == {"1.DNG": "1.JPG.png", "2.DNG": "2.DNG.png"}
    assert found.unused == []


@pytest.mark.parametrize("folder", ["@eaDir/1.jpg", "a/@eaDir/1.jpg", "$RECYCLE.BIN/S-1-5-18", "#recycle"])
def test_deleted_photographs_and_small_copies_of_a_network_drive_are_no_photographs(
    tmp_path: Path, folder: str
) -> None:
    make_files(tmp_path, f"1.jpg 2.jpg {folder}/SYNOPHOTO_THUMB_XL.jpg {folder}/3.mp4")
    material = find_material(tmp_path)
    assert (material.photographs, material.videos) == (("1.jpg", "2.jpg"), ())


@pytest.mark.parametrize(
    "names",
    [
        "1.jpg 2.jpg mask/1.png mask/2.jpg.png",
        "photos/1.jpg photos/2.jpg mask/1.jpg mask/2.jpg",
        "photos/1.jpg photos/2.jpg photos/mask/1.png photos/mask/2.png",
        "a/images/b/1.jpg a/images/b/2.jpg a/mask/b/1.png a/mask/b/2.png",
    ],
)
def test_masks_in_a_folder_called_mask_are_no_photographs_and_their_folder_is_named(tmp_path: Path, names: str) -> None:
    make_files(tmp_path, names)
    material = find_material(tmp_path)
    assert material.photographs == tuple(names.split()[:2])
    found = masks_of(material)
    assert (found.files, found.misplaced) == ({}, [])
    assert found.misnamed == [(tmp_path / names.split()[2]).parents[names.count("/b/1.png")]]


def test_masks_in_a_folder_called_mask_in_upper_case_are_named(tmp_path: Path) -> None:
    make_files(tmp_path, "1.jpg 2.jpg Mask/1.png Mask/2.png")
    material = find_material(tmp_path)
    assert material.photographs == ("1.jpg", "2.jpg")
    assert masks_of(material).misplaced == ["Mask/1.png", "Mask/2.png"]


@pytest.mark.parametrize("scan", ["", "scan65/"])
def test_masks_of_neus_are_no_photographs_and_are_named(tmp_path: Path, scan: str) -> None:
    masks = [f"{scan}mask/{number:03d}.png" for number in range(2)]
    make_files(tmp_path, " ".join([f"{scan}image/000000.png {scan}image/000001.png", *masks]))
    material = find_material(tmp_path)
    assert material.photographs == (f"{scan}image/000000.png", f"{scan}image/000001.png")
    assert masks_of(material).misplaced == masks


@pytest.mark.parametrize("folder", ["images", "images/left", "photos"])
def test_masks_in_the_folder_of_their_photographs_are_used(tmp_path: Path, folder: str) -> None:
    make_files(tmp_path, f"{folder}/1.jpg {folder}/2.jpg {folder}/masks/1.png {folder}/masks/3.png")
    material = find_material(tmp_path)
    assert material.photographs == (f"{folder}/1.jpg", f"{folder}/2.jpg")
    found = masks_of(material)
    assert found.files == {f"{folder}/1.jpg": tmp_path / folder / "masks" / "1.png"}
    assert found.unused == ["3.png"]


@pytest.mark.parametrize(
    "names",
    [
        "1_mask.png 2.jpg 3.mask.png dynamic_mask_4.png 5.jpg.png",
        "mask/1.jpg mask/2.jpg room/3.jpg",
        "mask/1.jpg mask/2.jpg",
        "a/1.jpg b/1_mask.png",
    ],
)
def test_photographs_that_are_called_like_masks_of_none_are_photographs(tmp_path: Path, names: str) -> None:
    make_files(tmp_path, names)
    assert set(find_material(tmp_path).photographs) == set(names.split())


def test_photographs_of_a_mask_with_depth_maps_are_photographs(tmp_path: Path) -> None:
    make_files(tmp_path, "mask/1.jpg mask/2.jpg depth/1.png depth/2.png")
    assert find_material(tmp_path).photographs == ("mask/1.jpg", "mask/2.jpg")


def make_files(folder: Path, names: str) -> None:
    for name in names.split():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).touch()


def test_an_empty_folder_for_images_hides_no_photographs(tmp_path: Path) -> None:
    (tmp_path / "1.jpg").touch()
    for name in ("images", "rgb"):
        (tmp_path / name).mkdir()
    assert find_material(tmp_path).photographs == ("1.jpg",)
    (tmp_path / "rgb" / "2.jpg").touch()
    assert find_material(tmp_path).photographs == ("rgb/2.jpg",)


def test_a_mixed_folder_becomes_one_set_of_photographs(tmp_path: Path) -> None:
    mixed, out = tmp_path / "in", tmp_path / "out"
    mixed.mkdir()
    out.mkdir()
    Image.fromarray(WALL[:64, :96]).save(mixed / "img_1.JPG")
    save(mixed / "IMG_1.HEIC", WALL[100:164, :96])
    write_dng(mixed / "IMG_2.dng", np.full((64, 96, 3), 0.3))
    for name in ("walk.mp4", "walk.mov"):
        write_video(mixed / name, [window(WALL, 50 + 6 * step) for step in range(RATE * 2)])
    before = sorted(mixed.iterdir())
    made = make_photographs(find_material(mixed), out, Reporter())
    assert made.names[0] == "IMG_1.HEIC.jpg"  # IMG_1.jpg would be another one's where case does not count
    assert {"img_1.JPG", "IMG_2.jpg"} <= set(made.names)
    assert len(made.names) == len({name.lower() for name in made.names})
    assert all(read_header(out / name).orientation == 1 for name in made.names)
    assert sorted(mixed.iterdir()) == before
    frames = json.loads((out / FRAMES_FILE).read_text())["frames"]
    assert {frame["video"] for frame in frames} == {"walk.mp4", "walk.mov"}
    assert [frame["name"] for frame in frames] == made.names[3:]
    times = [frame["time"] for frame in frames if frame["video"] == "walk.mp4"]
    assert times == sorted(times)
    assert 0.0 <= times[0] < times[-1] < 2.0
    assert made.times == {frame["name"]: frame["time"] for frame in frames}


@pytest.mark.parametrize(
    ("names", "used"),
    [
        ("1.DNG 1.JPG 2.DNG 2.JPG", "1.DNG 2.DNG"),
        ("1.heic 1.jpg 2.heic 2.jpg 2.dng", "1.heic 2.heic"),
        ("1.DNG 1.JPG 2.DNG 2.JPG 3.JPG", "1.JPG 2.JPG 3.JPG"),
        ("1.DNG 1.JPG 2.JPG 3.DNG", "1.DNG 2.JPG 3.DNG"),
        ("1.png 1.jpg a/1.png b/1.jpg", "1.jpg a/1.png b/1.jpg"),
        ("1.exr 1.png", "1.png"),
        (
            "P1.RAW-01.COVER.jpg P1.RAW-02.ORIGINAL.dng P2.RAW-01.MP.COVER.jpg P2.RAW-02.ORIGINAL.dng P3.jpg",
            "P1.RAW-01.COVER.jpg P2.RAW-01.MP.COVER.jpg P3.jpg",
        ),
        ("P1.RAW-01.jpg P1.RAW-02.ORIGINAL.dng P2.jpg", "P1.RAW-01.jpg P2.jpg"),
        ("P1.MP.jpg P1.dng P2.MP.jpg", "P1.MP.jpg P2.MP.jpg"),
        ("P1.PORTRAIT-01.COVER.jpg P1.PORTRAIT-02.ORIGINAL.jpg P2.jpg", "P1.PORTRAIT-02.ORIGINAL.jpg P2.jpg"),
        ("P1.PORTRAIT.ORIGINAL.jpg P1.PORTRAIT.jpg P2.PORTRAIT.jpg", "P1.PORTRAIT.ORIGINAL.jpg P2.PORTRAIT.jpg"),
        ("IMG_0001.HEIC IMG_0002.HEIC IMG_E0002.HEIC IMG_E0003.JPG", "IMG_0001.HEIC IMG_0002.HEIC IMG_E0003.JPG"),
        ("IMG_1.jpg IMG_1-edited.jpg IMG_2-edited.jpg", "IMG_1.jpg IMG_2-edited.jpg"),
        ("PXL_1.jpg PXL_1~2.jpg PXL_2~2.jpg IMG_1.jpg IMG_1~2.jpg", "IMG_1.jpg IMG_1~2.jpg PXL_1.jpg PXL_2~2.jpg"),
        ("IMG_0001.JPG IMG_E0001.JPG a/IMG_E0001.JPG", "IMG_0001.JPG a/IMG_E0001.JPG"),
    ],
)
def test_a_photograph_in_several_formats_counts_once(tmp_path: Path, names: str, used: str) -> None:
    for name in names.split():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    material = find_material(tmp_path)
    assert sorted(material.photographs) == used.split()
    assert {*material.photographs, *material.copies} == {*names.split()}


@pytest.mark.parametrize(
    ("names", "used"),
    [
        ("a/images/1.JPG a/images_2/1.JPG a/images_8/image000.png", "a/images/1.JPG"),
        ("a/images/b/1.jpg a/images_4/b/1.jpg b/images_2/1.jpg", "a/images/b/1.jpg b/images_2/1.jpg"),
        ("a/images/1.jpg a/images_old/1.jpg", "a/images/1.jpg a/images_old/1.jpg"),
        (
            "k/images/1.jpg k/images/2.jpg k/corrected_images/1.jpg k/depth/1.png",
            "k/corrected_images/1.jpg k/images/2.jpg",
        ),
        ("images/1.jpg images/2.jpg corrected_images/2.jpg", "corrected_images/2.jpg images/1.jpg"),
    ],
)
def test_smaller_and_uncorrected_copies_in_folders_do_not_count(tmp_path: Path, names: str, used: str) -> None:
    for name in names.split():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    material = find_material(tmp_path)
    assert sorted(material.photographs) == used.split()
    assert bool(material.copies) == ("images_old" not in names)


def test_of_files_that_are_the_same_byte_for_byte_one_is_used_and_the_others_are_named(tmp_path: Path) -> None:
    folder = tmp_path / "in"
    for number, name in enumerate(("IMG_1.jpg", "IMG_2.jpg", "day 2/IMG_1.jpg")):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        save(folder / name, photograph(number))
    write_video(folder / "walk.mp4", [window(WALL, 50 + 6 * step) for step in range(RATE)])
    copies = {"IMG_1 (1).jpg": "IMG_1.jpg", "backup/IMG_2.jpg": "IMG_2.jpg", "walk - Copy.mp4": "walk.mp4"}
    (folder / "backup").mkdir()
    for copy, original in copies.items():
        (folder / copy).write_bytes((folder / original).read_bytes())
    material = find_material(folder)
    assert sorted(material.photographs) == ["IMG_1.jpg", "IMG_2.jpg", "day 2/IMG_1.jpg"]
    assert material.videos == ("walk.mp4",)
    (tmp_path / "out").mkdir()
    (warning,) = make_photographs(material, tmp_path / "out", Reporter()).warnings
    assert warning.message.endswith(f"files that show photographs once more are left out: {', '.join(copies)}")


def test_photographs_that_a_browser_on_windows_has_saved_are_used(tmp_path: Path) -> None:
    for number, name in enumerate(("1.jpg", "2.jfif", "3.JFIF")):
        Image.fromarray(photograph(number)).save(tmp_path / name, "JPEG")
    assert find_material(tmp_path).photographs == ("1.jpg", "2.jfif", "3.JFIF")
    assert read_header(tmp_path / "3.JFIF").upright_size == (96, 64)


def test_photographs_of_the_same_size_and_the_same_beginning_are_two(tmp_path: Path) -> None:
    first, second = np.zeros((2, 200, 200, 3), np.uint8)
    second[-1] = 255
    for name, picture in (("1.bmp", first), ("2.bmp", second)):
        Image.fromarray(picture).save(tmp_path / name)
    assert find_material(tmp_path).photographs == ("1.bmp", "2.bmp")


def test_the_videos_of_live_photos_are_not_used(tmp_path: Path) -> None:
    (tmp_path / "film").mkdir()
    for number, name in enumerate(("IMG_1", "IMG_2", "walk")):
        save(tmp_path / f"{name}.jpg", photograph(number))
    for name, seconds in (("IMG_1.MOV", 2), ("film/IMG_2.mov", 2), ("walk.mp4", 6)):
        write_video(tmp_path / name, [window(WALL, 50)] * (RATE * seconds))
    (tmp_path / "IMG_2.mp4").touch()
    material = find_material(tmp_path)
    assert material.photographs == ("IMG_1.jpg", "IMG_2.jpg", "walk.jpg")
    assert material.videos == ("IMG_2.mp4", "film/IMG_2.mov", "walk.mp4"), "one is damaged, elsewhere, or long"
    assert material.copies == ("IMG_1.MOV",)


def test_a_live_photo_alone_is_a_video(tmp_path: Path) -> None:
    save(tmp_path / "IMG_1.jpg", WALL[:64, :96])
    write_video(tmp_path / "IMG_1.mov", [window(WALL, 50)] * RATE)
    assert find_material(tmp_path).videos == ("IMG_1.mov",)


@pytest.mark.parametrize("kind", ["jpg", "dng"])
def test_photographs_that_are_left_out_are_named(tmp_path: Path, kind: str) -> None:
    (tmp_path / "in").mkdir()
    (tmp_path / "out").mkdir()
    for number in range(3):
        if kind == "dng":
            write_dng(tmp_path / "in" / f"{number}.dng", np.full((64, 96, 3), 0.3 + 0.1 * number))
        for ending in ("jpg", "png") if kind == "jpg" else ("jpg",):
            save(tmp_path / "in" / f"{number}.{ending}", photograph(number))
    made = make_photographs(find_material(tmp_path / "in"), tmp_path / "out", Reporter())
    assert list(made.originals.values()) == [f"{number}.{kind}" for number in range(3)]
    (warning,) = made.warnings
    assert warning.name == "copies"
    left_out = ", ".join(f"{number}.{'png' if kind == 'jpg' else 'jpg'}" for number in range(3))
    assert warning.message.endswith(f"files that show photographs once more are left out: {left_out}")


def test_photographs_in_a_folder_called_like_a_video_do_not_meet_its_frames(tmp_path: Path) -> None:
    mixed, out = tmp_path / "in", tmp_path / "out"
    (mixed / "Walk").mkdir(parents=True)
    out.mkdir()
    write_video(mixed / "walk.mp4", [window(WALL, 50 + 6 * step) for step in range(RATE * 2)])
    for number in range(RATE * 2):
        save(mixed / "Walk" / f"{number:06d}.jpg", photograph(number))
    made = make_photographs(find_material(mixed), out, Reporter())
    assert {name.split("/")[0] for name in made.times} == {"walk-frames"}
    assert all(read_header(out / name).width == WIDTH for name in made.times)
    assert read_header(out / "Walk" / "000000.jpg").width == 96


@pytest.mark.parametrize("out", ["", "out"])
def test_results_of_a_run_among_its_photographs_are_no_photographs(tmp_path: Path, out: str) -> None:
    made = ("capture/images/1.png", "renders/original/1.png", "turntable/original/1.png")
    for number, name in enumerate(("1.jpg", "2.jpg", *(f"{out}/{name}" for name in made))):
        (tmp_path / name.lstrip("/")).parent.mkdir(parents=True, exist_ok=True)
        save(tmp_path / name.lstrip("/"), photograph(number))
    assert len(find_material(tmp_path).photographs) > 2
    (tmp_path / out / "report.json").write_text(json.dumps({"schema": SCHEMA}))
    assert find_material(tmp_path).photographs == ("1.jpg", "2.jpg")
    assert find_material(tmp_path / out / "capture").photographs == ("images/1.png",), "if it is asked for itself"


def test_what_is_said_of_a_video_in_a_zip_names_no_temporary_folder(tmp_path: Path) -> None:
    frames = [window(WALL, 50 + 4 * step) for step in range(RATE * 6)]
    film = write_video(tmp_path / "walk.mp4", frames, container_options={"movflags": "faststart"})
    archive = write_zip(tmp_path / "walk.zip", {"films/walk.mp4": cut(film.read_bytes())})
    said: list[str] = []

    class Ears(Reporter):
        def status(self, stage: str, message: str) -> None:
            said.append(message)

    (tmp_path / "out").mkdir()
    with unpacked(archive) as (folder, _):
        make_photographs(find_material(folder), tmp_path / "out", Ears())
    assert any("walk.mp4: the video breaks off after" in message for message in said)
    assert not any(str(folder) in message for message in said)


@pytest.mark.parametrize(("way", "said"), [(0.0, "one of its frames shows"), (12.0, "2 of its frames show")])
def test_a_video_that_hardly_moves_is_refused(tmp_path: Path, way: float, said: str) -> None:
    frames = [window(WALL, 50 + way * step / RATE) for step in range(2 * RATE)]
    write_video(tmp_path / "still.mp4", frames)
    (tmp_path / "out").mkdir()
    with pytest.raises(InputError, match=rf"still\.mp4: the video hardly moves; only {said} something new - walk"):
        make_photographs(find_material(tmp_path), tmp_path / "out", Reporter())


def test_both_frames_of_a_video_of_two_are_taken(tmp_path: Path) -> None:
    write_video(tmp_path / "two.mp4", [window(WALL, 50), window(WALL, 250)], rate=1)
    (tmp_path / "out").mkdir()
    assert len(make_photographs(find_material(tmp_path), tmp_path / "out", Reporter()).names) == 2


@pytest.mark.parametrize(("transfer", "name"), [(2, "video-log"), (18, "video-hdr"), (1, None)])
def test_log_video_is_told_from_hdr_and_from_ordinary_video(tmp_path: Path, transfer: int, name: str | None) -> None:
    def configure(stream: av.VideoStream) -> None:
        context = stream.codec_context
        context.colorspace, context.color_primaries, context.color_trc = 9, 9, transfer

    write_video(tmp_path / "x.mp4", [window(WALL, 50), window(WALL, 80)], configure=configure)
    for number in range(2):
        save(tmp_path / f"{number}.jpg", photograph(number))
    (tmp_path / "out").mkdir()
    made = make_photographs(find_material(tmp_path), tmp_path / "out", Reporter())
    assert [warning.name for warning in made.warnings] == ([name] if name else [])


def test_frames_beside_their_video_are_told_from_photographs(tmp_path: Path) -> None:
    film = [window(WALL, 50 + 6 * step) for step in range(RATE * 2)]
    for folder in ("in/frames", "out", "again"):
        (tmp_path / folder).mkdir(parents=True)
    write_video(tmp_path / "in" / "walk.mp4", film)
    camera = Image.Exif()
    camera[0x0110] = "Acme One"
    Image.fromarray(film[0]).save(tmp_path / "in" / "1.jpg", exif=camera)
    save(tmp_path / "in" / "2.jpg", photograph())
    assert make_photographs(find_material(tmp_path / "in"), tmp_path / "out", Reporter()).warnings == []
    for number, frame in enumerate(film[:2]):
        save(tmp_path / "in" / "frames" / f"{number}.png", frame)
    (warning,) = make_photographs(find_material(tmp_path / "in"), tmp_path / "again", Reporter()).warnings
    assert warning.name == "video-frames"
    assert "2 photographs seem to be frames of a video beside them: frames/0.png, frames/1.png" in warning.message


def test_all_frames_of_a_video_have_its_mask_and_photographs_their_own(tmp_path: Path) -> None:
    for name in ("a.mp4", "b.mp4"):
        write_video(tmp_path / name, [window(WALL, 50 + 6 * step) for step in range(RATE * 2)])
    save(tmp_path / "one.jpg", WALL[100:164, :96])
    (tmp_path / "masks").mkdir()
    for name in ("a.mp4", "one", "other"):
        save(tmp_path / "masks" / f"{name}.png", np.full((HEIGHT, WIDTH, 3), 255, np.uint8))
    material = find_material(tmp_path)
    found = masks_of(material)
    assert {name: path.name for name, path in found.files.items()} == {"a.mp4": "a.mp4.png", "one.jpg": "one.png"}
    assert found.unused == ["other.png"]
    (tmp_path / "out").mkdir()
    made = make_photographs(material, tmp_path / "out", Reporter())
    assert list(made.originals) == made.names
    assert made.originals["one.jpg"] == "one.jpg"
    assert all(made.originals[name] == f"{name[0]}.mp4" for name in made.times)


def test_a_written_capture_keeps_the_times_of_frames(tmp_path: Path) -> None:
    image = WALL[:32, :48]
    camera = PinholeCamera(48, 32, 50.0, 50.0, 24.0, 16.0)
    views = tuple(
        View(key, tmp_path / key, camera, np.eye(4), image, time=time) for key, time in (("a", 1.25), ("b", None))
    )
    nothing = np.zeros((0, 3))
    write_capture(
        Capture(tmp_path, "sfm", views, nothing.astype(np.float32), nothing.astype(np.uint8)), tmp_path / "out"
    )
    first, second = json.loads((tmp_path / "out" / "transforms.json").read_text())["frames"]
    assert first["time"] == 1.25
    assert "time" not in second
    assert len(read_capture(tmp_path / "out", max_size=None).views) == 2
