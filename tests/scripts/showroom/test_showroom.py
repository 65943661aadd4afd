"""The demo capture and the script that makes it. Blender runs in a subprocess, so that nothing of it stays behind."""

from __future__ import annotations

import json
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import colorspacious
import numpy as np
import OpenImageIO as oiio
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cvdgs.core.bootstrap import ROOT
from cvdgs.core.capture.model import Capture, View
from cvdgs.core.capture.reader import read_capture
from cvdgs.core.demo import SHOWROOM
from cvdgs.scripts.showroom import cloth, weaves
from cvdgs.scripts.showroom.cameras import walk
from cvdgs.scripts.showroom.palette import palette
from cvdgs.scripts.showroom.settings import CameraSettings

SCRIPT = ROOT / "scripts" / "make_showroom.py"
SHIPPED_VIEWS = 40
HALF_LENGTH, HALF_WIDTH = 4.5, 3.0  # metres, of the room
SHIPPED_BYTES = 5_000_000
PROJECTION_PIXELS = 2e-4  # what single precision, in which Blender computes, leaves of 480 pixels
TINY = ("--views", "3", "--width", "64", "--height", "48", "--samples", "1", "--cloth-detail", "0.2", "--points", "90")


def make_showroom(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(SCRIPT), *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=280, check=False)


@pytest.fixture(scope="module")
def shipped() -> Capture:
    return read_capture(SHOWROOM, max_size=None)


@pytest.fixture(scope="module")
def depth_maps() -> dict[str, np.ndarray]:
    return read_depth_maps(SHOWROOM)


def read_depth_maps(capture: Path) -> dict[str, np.ndarray]:
    """(H, W) planar depth in metres by view name."""
    index = json.loads((capture / "depth" / "depth.json").read_text(encoding="utf-8"))
    return {
        Path(image).stem: read_grey16(capture / file) * index["metres_per_unit"]
        for image, file in index["frames"].items()
    }


def read_grey16(path: Path) -> np.ndarray:
    buffer = oiio.ImageBuf(str(path))
    return np.asarray(buffer.get_pixels(oiio.UINT16))[..., 0].astype(np.float64)


def unproject(view: View, depth: np.ndarray) -> np.ndarray:
    """(H * W, 3) world positions of the pixel centres."""
    y, x = np.mgrid[: depth.shape[0], : depth.shape[1]] + 0.5
    c = view.camera
    rays = np.stack([(x - c.cx) / c.fx, (y - c.cy) / c.fy, np.ones_like(x)], axis=-1).reshape(-1, 3)
    rotation, translation = view.world_to_camera[:3, :3], view.world_to_camera[:3, 3]
    return (rays * depth.reshape(-1, 1) - translation) @ rotation


def project(view: View, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N, 2) pixel positions and (N,) planar depths."""
    local = points @ view.world_to_camera[:3, :3].T + view.world_to_camera[:3, 3]
    c = view.camera
    return local[:, :2] / local[:, 2:] * [c.fx, c.fy] + [c.cx, c.cy], local[:, 2]


def seen_in_both(first: View, second: View, depths: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Flat pixel indices in `first` and in `second` of surface points that both views see."""
    position, distance = project(second, unproject(first, depths[first.source.stem]))
    column, row = np.floor(position).astype(int).T
    height, width = depths[second.source.stem].shape
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height) & (distance > 0)
    target = np.where(inside, row * width + column, 0)
    met = depths[second.source.stem].ravel()[target]
    visible = inside & (np.abs(met - distance) < 0.01 * distance)
    return np.flatnonzero(visible), target[visible]


# The shipped capture


def test_the_shipped_capture_is_complete(shipped: Capture) -> None:
    assert len(shipped.views) == SHIPPED_VIEWS
    assert {view.image.shape for view in shipped.views} == {(360, 480, 3)}
    assert 8_000 <= len(shipped.points) <= 10_000
    assert shipped.warnings == ()
    assert (SHOWROOM / "README.md").is_file()


def test_the_shipped_capture_is_small() -> None:
    assert sum(path.stat().st_size for path in SHOWROOM.rglob("*") if path.is_file()) <= SHIPPED_BYTES


def test_the_photographs_are_well_exposed(shipped: Capture) -> None:
    for view in shipped.views:
        assert 90 < view.image.mean() < 200
        assert (view.image == 255).all(axis=-1).mean() < 0.01


def test_depth_maps_have_no_holes(depth_maps: dict[str, np.ndarray]) -> None:
    assert all((depth > 0).all() for depth in depth_maps.values())


def test_depth_maps_agree_between_views(shipped: Capture, depth_maps: dict[str, np.ndarray]) -> None:
    views = [view for view in shipped.views if view.source.stem in depth_maps]
    assert len(views) == 6
    for first, second in pairwise(views):
        indices, _ = seen_in_both(first, second, depth_maps)
        assert len(indices) > 0.3 * first.image.shape[0] * first.image.shape[1]


def test_photographs_depth_and_cameras_belong_together(shipped: Capture, depth_maps: dict[str, np.ndarray]) -> None:
    views = [view for view in shipped.views if view.source.stem in depth_maps]
    for first, second in pairwise(views):
        here, there = seen_in_both(first, second, depth_maps)
        color = first.image.reshape(-1, 3)[here].astype(float)
        error = np.abs(color - second.image.reshape(-1, 3)[there]).mean()
        shifted = np.abs(color - np.roll(second.image, 4, axis=1).reshape(-1, 3)[there]).mean()
        assert error < 8.0
        assert error < 0.7 * shifted


def test_sparse_points_lie_on_the_surfaces(shipped: Capture, depth_maps: dict[str, np.ndarray]) -> None:
    view = next(view for view in shipped.views if view.source.stem in depth_maps)
    depth = depth_maps[view.source.stem]
    position, distance = project(view, shipped.points.astype(np.float64))
    column, row = np.floor(position).astype(int).T
    inside = (column >= 0) & (column < depth.shape[1]) & (row >= 0) & (row < depth.shape[0]) & (distance > 0)
    difference = distance[inside] - depth[row[inside], column[inside]]
    visible = np.abs(difference) < 0.02 * distance[inside]
    in_front = difference < -0.05

    assert visible.mean() > 0.5
    assert in_front.mean() < 0.05


# Colours


@pytest.mark.parametrize("name", ["tartan", "stripe", "herringbone", "jacquard"])
def test_a_deutan_confuses_the_colours_of_each_pattern(name: str) -> None:
    pair = getattr(palette("deutan"), name)
    colors = np.stack([pair.first, pair.second])
    seen = np.clip(colors @ colorspacious.machado_et_al_2009_matrix("deuteranomaly", 100).T, 0, 1)
    normal = colorspacious.cspace_convert(colors, "sRGB1-linear", "CIELab")
    simulated = colorspacious.cspace_convert(seen, "sRGB1-linear", "CIELab")

    assert np.linalg.norm(simulated[0] - simulated[1]) < 6.0
    assert np.linalg.norm(normal[0] - normal[1]) > 40.0
    assert abs(normal[0, 0] - normal[1, 0]) < 0.5


@pytest.mark.parametrize(("variant", "contrast"), [("protan", 40.0), ("tritan", 25.0)])
def test_the_other_showrooms_have_confusions_of_their_own(variant: str, contrast: float) -> None:
    colors = palette(variant)
    for pair in (colors.tartan, colors.stripe, colors.herringbone, colors.jacquard):
        assert pair.simulated < 6.0
        assert pair.normal > contrast
        assert pair.first.min() > 0


# Cloth and weaves


@settings(max_examples=20, deadline=None)
@given(over=st.integers(1, 4), under=st.integers(1, 4), seed=st.integers(0, 100))
def test_a_twill_shows_as_much_of_each_yarn_as_its_floats_say(over: int, under: int, seed: int) -> None:
    warp, weft = np.array([[0.4, 0.1, 0.1]]), np.array([[0.1, 0.1, 0.4]])
    albedo = weaves.weave(warp, weft, weaves.twill(over, under), yarn=0.01, seed=seed).albedo
    share = over / (over + under)

    assert np.allclose(albedo.mean(axis=(0, 1)), (share * warp + (1 - share) * weft)[0], rtol=0.15)


def test_a_weave_repeats_without_a_seam() -> None:
    colors = np.random.default_rng(0).uniform(0.1, 0.6, (12, 3))
    height = weaves.weave(colors, colors, weaves.herringbone(band=6), yarn=0.01, seed=0).height
    inner = np.abs(np.diff(height, axis=0)).max()

    assert np.abs(height[0] - height[-1]).max() <= inner
    assert np.abs(height[:, 0] - height[:, -1]).max() <= np.abs(np.diff(height, axis=1)).max()


def test_a_hanging_drape_keeps_the_length_of_its_cloth() -> None:
    width, fullness = 1.2, 1.5
    drape = cloth.hanging_drape(width, drop=1.6, fullness=fullness, pleats=6.0, seed=3, spacing=0.01)
    columns = round(width * fullness / 0.01)
    rows = drape.vertices.reshape(-1, columns, 3)
    length = np.linalg.norm(np.diff(rows, axis=1), axis=-1).sum(axis=1)

    assert np.allclose(length, width * fullness, rtol=0.07)  # steep pleats are cut off
    assert np.allclose(np.ptp(rows[..., 0], axis=1), width)
    assert rows[..., 2].max() <= 1e-9


def test_the_seam_of_a_cushion_cover_is_its_border() -> None:
    side, spacing = 0.4, 0.02
    cover = cloth.cushion_cover(side, spacing)
    seam = cloth.seam_length(side, spacing)

    assert np.allclose(np.abs(cover.vertices[:seam, :2]).max(axis=1), side / 2)
    assert np.abs(cover.vertices[seam:, :2]).max() < side / 2
    edges = np.sort(np.stack([cover.faces, np.roll(cover.faces, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    assert set(np.unique(edges, axis=0, return_counts=True)[1]) == {2}  # closed: every edge has two faces


# Blender


PROJECTION = """
import json, sys
sys.path.insert(0, sys.argv[1])
import bootstrap
bootstrap.load()
import bpy, mathutils, numpy as np
from bpy_extras.object_utils import world_to_camera_view
from cvdgs.scripts.showroom import photograph
from cvdgs.scripts.showroom.cameras import focal_pixels, rings
from cvdgs.scripts.showroom.settings import CameraSettings

settings = CameraSettings(views=6)
bpy.ops.wm.read_factory_settings(use_empty=True)
camera = photograph.set_up_camera(settings)
rng = np.random.default_rng(0)
worst = 0.0
for pose in rings(settings):
    photograph.place(camera, pose)
    local = np.append(rng.uniform([-1, -1, -6], [1, 1, -2], (50, 3)), np.ones((50, 1)), axis=1)
    for point, here in zip(local @ pose.camera_to_world.T, local):
        x, y, _ = world_to_camera_view(bpy.context.scene, camera, mathutils.Vector(point[:3]))
        blender = np.array([x * settings.width, (1 - y) * settings.height])
        centre = np.array([settings.width / 2, settings.height / 2])
        ours = centre + focal_pixels(settings) * np.array([-here[0], here[1]]) / here[2]
        worst = max(worst, float(np.abs(blender - ours).max()))
print("WORST", worst)
"""


def test_cameras_project_as_blender_does() -> None:
    command = [sys.executable, "-c", PROJECTION, str(ROOT / "core")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)

    assert "WORST" in done.stdout, done.stderr
    assert float(done.stdout.split("WORST")[1].split()[0]) < PROJECTION_PIXELS


def test_a_tiny_showroom_is_a_readable_capture(tmp_path: Path) -> None:
    out = tmp_path / "showroom"
    done = make_showroom("--out", str(out), "--depth-views", "1", *TINY)

    assert done.returncode == 0, done.stderr
    assert "left" in done.stderr  # progress with the time left
    capture = read_capture(out, max_size=None)
    assert [view.image.shape for view in capture.views] == [(48, 64, 3)] * 3
    assert len(capture.points) == 90
    held_out, *others = capture.views
    assert held_out.again is not None
    assert (held_out.again != held_out.image).any()  # the same picture with other noise
    assert np.abs(held_out.again.astype(int) - held_out.image).mean() < 30
    assert all(view.again is None for view in others)
    (depth,) = read_depth_maps(out).values()
    assert depth.min() > 1.0
    assert depth.max() < 10.0


def test_a_tiny_room_is_a_readable_capture_of_which_every_side_is_seen(tmp_path: Path) -> None:
    out = tmp_path / "room"
    done = make_showroom("--scene", "room", "--out", str(out), "--depth-views", "3", *TINY)

    assert done.returncode == 0, done.stderr
    capture = read_capture(out, max_size=None)
    assert [view.image.shape for view in capture.views] == [(48, 64, 3)] * 3
    assert capture.views[0].again is not None
    for depth in read_depth_maps(out).values():
        assert depth.min() > 0.2  # nobody walks through a wall or a rack
        assert depth.max() < np.hypot(np.hypot(9.0, 6.0), 2.9) + 1.0  # closed but for what is behind the windows
    photographs = np.stack([view.image for view in capture.views])
    assert 90 < photographs.mean() < 225  # neither a dark nor a burnt-out room


@pytest.mark.parametrize("views", [20, 60, 200])
def test_who_walks_round_the_room_stays_in_it_and_looks_everywhere(views: int) -> None:
    poses = walk(CameraSettings(views=views))
    eyes = np.stack([pose.camera_to_world[:3, 3] for pose in poses])
    ahead = np.stack([-pose.camera_to_world[:3, 2] for pose in poses])

    assert len({pose.name for pose in poses}) == views
    assert np.abs(eyes[:, 0]).max() < HALF_LENGTH - 1.0  # the racks stand closer to the walls
    assert np.abs(eyes[:, 1]).max() < HALF_WIDTH - 1.0
    headings = np.sort(np.rad2deg(np.arctan2(ahead[:, 1], ahead[:, 0])))
    assert np.diff(np.concatenate([headings, headings[:1] + 360])).max() < 45  # less than a wide lens sees


@given(st.integers(60, 300))
def test_what_a_held_out_view_of_the_room_sees_others_see_too(views: int) -> None:
    poses = walk(CameraSettings(views=views))
    places = np.stack([pose.camera_to_world[:3, 3] for pose in poses])
    ahead = np.stack([-pose.camera_to_world[:3, 2] for pose in poses])
    fitted = np.arange(views) % 8 != 0
    for index in range(0, views, 8):
        near = np.linalg.norm(places[fitted] - places[index], axis=1) < 1.0
        assert (near & (ahead[fitted] @ ahead[index] > np.cos(np.deg2rad(30)))).any()


@pytest.mark.slow
def test_the_same_seed_gives_the_same_photographs(tmp_path: Path) -> None:
    for name in ("first", "second"):
        assert make_showroom("--out", str(tmp_path / name), "--depth-views", "1", *TINY).returncode == 0
    files = sorted(path.relative_to(tmp_path / "first") for path in (tmp_path / "first").rglob("*.*"))

    assert files
    for file in files:
        assert (tmp_path / "first" / file).read_bytes() == (tmp_path / "second" / file).read_bytes(), file


@pytest.mark.parametrize(
    "arguments",
    [
        ("--views", "1"),
        ("--satin-roughness", "2"),
        ("--variant", "achromat"),
        ("--light", "nan"),
        ("--threads", "-1"),
        ("--threads", "5000"),
    ],
)
def test_unusable_arguments_are_refused_in_one_line(tmp_path: Path, arguments: tuple[str, str]) -> None:
    done = make_showroom("--out", str(tmp_path / "out"), *arguments)

    assert done.returncode == 2
    assert len(done.stderr.strip().splitlines()) == 1
    assert arguments[0] in done.stderr
    assert not (tmp_path / "out").exists()


def test_a_folder_with_other_files_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "letter.txt").write_text("mine", encoding="utf-8")
    done = make_showroom("--out", str(tmp_path), *TINY)

    assert done.returncode == 2
    assert [path.name for path in tmp_path.iterdir()] == ["letter.txt"]


def test_another_capture_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "images").mkdir()
    for name in ("transforms.json", "images/IMG_0001.jpg"):
        (tmp_path / name).write_text("mine", encoding="utf-8")
    done = make_showroom("--out", str(tmp_path), *TINY)

    assert done.returncode == 2
    assert (tmp_path / "transforms.json").read_text(encoding="utf-8") == "mine"
