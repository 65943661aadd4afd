"""What apps that scan and datasets put beside their photographs is no photograph."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cvdgs.core.capture.material import find_material, make_photographs
from cvdgs.core.runtime.protocol import Reporter

from ..capture.make_captures import save
from .films import wall

WALL = wall()[:64, :96]
DISTANCES = np.linspace(0.5, 5.0, 48 * 64, dtype=np.float32).reshape(48, 64)


@pytest.mark.parametrize(
    ("photograph", "beside"),
    [
        ("frame_00000.jpg", "depth_00000.png conf_00000.png"),
        ("frame_00000.jpg", "frame_00000.exr frame_00001.exr frame_00002.exr conf_00000.png conf_00001.png"),
        ("IMG_0001.jpg", "IMG_0001_depth.TIF"),
        ("results/frame000000.jpg", "results/depth000000.png"),
        ("frame-000000.color.png", "frame-000000.depth.png"),
        ("lowres_wide/1_1.5.png", "lowres_depth/1_1.5.png highres_depth/1_1.5.png confidence/1_1.5.png"),
    ],
    ids=["3D Scanner App", "3D Scanner App, keyframes", "CaptureSample", "Replica", "7-Scenes", "ARKitScenes"],
)
def test_depth_maps_among_photographs_are_none_and_are_counted(tmp_path: Path, photograph: str, beside: str) -> None:
    save(tmp_path / photograph, WALL)
    for name in beside.split():
        is_floating = name.lower().endswith((".exr", ".tif"))
        save(tmp_path / name, DISTANCES if is_floating else (DISTANCES * 1000.0).astype(np.uint16))
    material = find_material(tmp_path)
    assert (material.photographs, material.depths, material.copies) == ((photograph,), len(beside.split()), ())


@pytest.mark.parametrize(
    "names",
    [
        "depth_1.jpg depth_2.jpg room_1.jpg",
        "conf_room_1.png conf_room_2.png kitchen_1.png",
        "depth_1.png depth_2.png",
        "window_1.exr window_2.tif",
    ],
)
def test_photographs_that_are_called_like_depth_maps_or_are_of_floats_are_photographs(
    tmp_path: Path, names: str
) -> None:
    for number, name in enumerate(names.split()):
        picture = np.roll(WALL, number, axis=0)
        save(tmp_path / name, picture / np.float32(255.0) if name.endswith((".exr", ".tif")) else picture)
    assert sorted(find_material(tmp_path).photographs) == names.split()


def test_what_an_app_has_rendered_or_made_small_is_no_photograph_and_is_named(tmp_path: Path) -> None:
    polycam, scanner = tmp_path / "polycam", tmp_path / "scanner"
    for number in (1, 2):
        save(polycam / "keyframes" / "images" / f"{number}.jpg", WALL[number:])
        save(scanner / f"frame_0000{number}.jpg", WALL[number:])
    save(polycam / "thumbnail.jpg", WALL[:32, :32])
    (polycam / "polycam.mp4").touch()
    save(scanner / "thumb_00001.jpg", WALL[:32, :32])
    left_out = {polycam: "polycam.mp4, thumbnail.jpg", scanner: "thumb_00001.jpg"}
    for scan, named in left_out.items():
        material = find_material(scan)
        assert (len(material.photographs), material.videos) == (2, ())
        (warning,) = make_photographs(material, tmp_path / "unused", Reporter()).warnings
        assert warning.message.endswith(f"files that show photographs once more are left out: {named}")


def test_of_a_cameras_whole_card_the_photographs_and_clips_are_used(tmp_path: Path) -> None:
    used = ("DCIM/100MSDCF/DSC00001.JPG", "DCIM/100MSDCF/DSC00002.JPG", "PRIVATE/M4ROOT/CLIP/C0001.MP4")
    left_out = ("PRIVATE/M4ROOT/SUB/C0001S03.MP4", "PRIVATE/M4ROOT/THMBNL/C0001T01.JPG")
    for name in (*used, *left_out):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    material = find_material(tmp_path)
    assert (material.photographs, material.videos, material.copies) == (used[:2], used[2:], left_out)


def test_textures_of_a_mesh_beside_its_photographs_are_no_photographs_and_are_named(tmp_path: Path) -> None:
    for number, name in enumerate(("1.jpg", "2.jpg", "texture_2.jpg")):
        save(tmp_path / name, WALL[number:])
    textures = ("mesh/textures/a b.png", "mesh/texture_0.jpg", "mesh/texture_1.jpg", "mesh/texture_2.jpg")
    for number, name in enumerate(textures):
        save(tmp_path / name, np.roll(WALL, number, axis=1))
    lines = (
        "newmtl first",
        "Kd 1 1 1",
        "map_Kd texture_0.jpg",
        "map_Kd -s 1 1 1 texture_1.jpg",
        "map_Ks texture_2.jpg",
        "bump textures\\a b.png",
    )
    (tmp_path / "mesh" / "scan.mtl").write_text("\r\n".join(lines))
    material = find_material(tmp_path)
    assert material.photographs == ("1.jpg", "2.jpg", "texture_2.jpg")
    assert sorted(material.copies) == sorted(textures)


def test_photographs_and_videos_that_are_called_like_previews_of_none_are_used(tmp_path: Path) -> None:
    save(tmp_path / "thumb_1.jpg", WALL)
    save(tmp_path / "thumbnail.jpg", WALL[1:])
    (tmp_path / "polycam.mp4").touch()
    material = find_material(tmp_path)
    assert (material.photographs, material.videos) == (("thumb_1.jpg", "thumbnail.jpg"), ("polycam.mp4",))
