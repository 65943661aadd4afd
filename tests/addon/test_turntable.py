"""The turntable: where its camera is in every frame, and what its pictures show."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
import pytest

from cvdgs.core.capture.model import PinholeCamera
from cvdgs.core.errors import InputError
from cvdgs.cvdgs_addon.results import show_run
from cvdgs.cvdgs_addon.scene.cameras import SENSOR_WIDTH, add_camera, is_capture_camera
from cvdgs.cvdgs_addon.scene.render_settings import Display, Engine, set_display
from cvdgs.cvdgs_addon.scene.splats import add_gaussians, show_layer
from cvdgs.cvdgs_addon.scene.stills import render_picture
from cvdgs.cvdgs_addon.scene.turntable import (
    Turntable,
    _way_around,
    add_turntable,
    remove_turntable,
    render_turntable,
    rendering_changes,
    turntable_of,
)
from cvdgs.ui.turntable import CVDGS_PT_turntable

from . import ewa
from .layouts import drawn
from .scenes import CAMERA, CLIP, cloud, opencv, read_png, ring_view
from .test_display import all_settings

LENS = 40.0
CENTER_DEGREES = 1.0  # as seen by the cameras: how far the axis is from the middle of the photographs' ring
SMALL = Turntable(frames=4, radius=3.5, height=0.3, focal_length=LENS, width=64, height_pixels=48)


def camera_poses(scene: bpy.types.Scene, camera: bpy.types.Object, frames: int) -> np.ndarray:
    """(F, 4, 4) camera-to-world matrices of the frames 1 to F."""
    poses = []
    for frame in range(1, frames + 1):
        scene.frame_set(frame)
        poses.append(np.array(camera.matrix_world))
    return np.stack(poses)


@pytest.fixture
def splats(scene):
    return add_gaussians(cloud(300), {}, scene.collection)


def test_the_camera_goes_around_once_and_looks_at_the_subject(scene, splats):
    camera = add_turntable(scene, splats, Turntable(frames=8, radius=4.0, height=0.5))
    poses = camera_poses(scene, camera, 8)
    center = np.array(camera.parent.location)
    offsets = poses[:, :3, 3] - center
    np.testing.assert_allclose(np.linalg.norm(offsets[:, :2], axis=1), 4.0, rtol=1e-5)
    np.testing.assert_allclose(offsets[:, 2], 2.0, rtol=1e-5)
    steps = np.diff(np.unwrap(np.arctan2(offsets[:, 1], offsets[:, 0])))
    np.testing.assert_allclose(steps, 2.0 * math.pi / 8, rtol=1e-4)
    towards = -poses[:, :3, 2]
    np.testing.assert_allclose(towards, -offsets / np.linalg.norm(offsets, axis=1, keepdims=True), atol=1e-5)
    assert (poses[:, 2, 1] > 0.5).all(), "upright"


def test_without_numbers_the_photographs_are_followed(addon, run_folder):
    scene = bpy.context.scene
    shown = show_run(str(run_folder), scene)
    bpy.context.view_layer.update()
    photographs = [candidate for candidate in scene.objects if is_capture_camera(candidate)]
    camera = add_turntable(scene, shown, Turntable(frames=4, arc=360.0))
    scene.frame_set(1)
    center = np.array(camera.parent.location)
    usual = np.median([np.linalg.norm(np.array(item.matrix_world.translation - camera.parent.location)[:2])
                       for item in photographs])  # fmt: skip
    offset = np.array(camera.matrix_world.translation) - center
    assert np.linalg.norm(offset[:2]) == pytest.approx(usual, rel=1e-4)
    heights = [item.matrix_world.translation.z for item in photographs]
    assert camera.matrix_world.translation.z == pytest.approx(np.median(heights), rel=1e-4)
    assert camera.data.lens == pytest.approx(np.median([item.data.lens for item in photographs]), rel=1e-5)
    first = np.array(photographs[0].matrix_world.translation) - center
    assert math.atan2(offset[1], offset[0]) == pytest.approx(math.atan2(first[1], first[0]), abs=1e-4)


def photographs_at(scene, *degrees: float) -> bpy.types.Object:
    """Gaussians of a capture whose photographs were taken from these angles around them."""
    splats, capture = add_gaussians(cloud(300), {}, scene.collection), bpy.data.objects.new("capture", None)
    scene.collection.objects.link(capture)
    splats.parent = capture
    for number, angle in enumerate(np.radians(degrees)):
        add_camera(f"photograph {number}", CAMERA, ring_view(angle), CLIP, scene.collection).parent = capture
    return splats


def angles_around(scene, camera: bpy.types.Object, frames: int) -> np.ndarray:
    """(F,) degrees around the axis, without jumps."""
    offsets = camera_poses(scene, camera, frames)[:, :3, 3] - np.array(camera.parent.location)
    return np.degrees(np.unwrap(np.arctan2(offsets[:, 1], offsets[:, 0])))


def test_what_was_photographed_from_above_alone_is_seen_from_there(scene):
    splats = photographs_at(scene, *np.linspace(0.0, 330.0, 12))
    for photograph in filter(is_capture_camera, scene.objects):
        x, y, _ = photograph.location
        photograph.location = (0.1 * x, 0.1 * y, 4.0)
    camera = add_turntable(scene, splats, Turntable(frames=4))
    scene.frame_set(2)
    assert camera.matrix_world.translation.z == pytest.approx(4.0, rel=1e-4)


def test_without_photographs_the_camera_looks_slightly_down(scene, splats):
    camera = add_turntable(scene, splats, Turntable(frames=4, radius=4.0))
    assert camera.location.z == pytest.approx(1.0)


@pytest.mark.parametrize("around", [range(0, 360, 30), (10, 100, 190, 280)])
def test_a_subject_photographed_from_all_sides_is_gone_around(scene, around):
    splats = photographs_at(scene, *around)
    camera = add_turntable(scene, splats, Turntable(frames=8))
    angles = angles_around(scene, camera, 8)
    np.testing.assert_allclose(np.diff(angles), 45.0, rtol=1e-3)


@pytest.mark.parametrize("front", [-90.0, 0.0, 175.0])
def test_a_subject_photographed_from_the_front_is_not_shown_from_behind(scene, front):
    splats = photographs_at(scene, *(front + np.linspace(-50.0, 50.0, 11)))
    camera = add_turntable(scene, splats, Turntable(frames=8))
    swing = (angles_around(scene, camera, 8) - front + 180.0) % 360.0 - 180.0
    np.testing.assert_allclose(swing, 50.0 * np.sin(np.radians(45.0 * np.arange(8))), atol=CENTER_DEGREES)


def test_mirrored_gaussians_are_seen_from_as_far_away(scene, splats):
    def place() -> list[float]:
        camera = add_turntable(scene, splats, Turntable())
        return [*camera.location, camera.data.clip_start, camera.data.clip_end]

    plain = place()
    remove_turntable(scene)
    splats.scale.x = -1.0
    assert place() == pytest.approx(plain)


def test_an_arc_can_be_asked_for(scene):
    splats = photographs_at(scene, *np.linspace(-50.0, 50.0, 11))
    swinging = angles_around(scene, add_turntable(scene, splats, Turntable(frames=4, arc=60.0)), 4)
    np.testing.assert_allclose(swinging, [0.0, 30.0, 0.0, -30.0], atol=CENTER_DEGREES)
    around = angles_around(scene, add_turntable(scene, splats, Turntable(frames=4, arc=360.0)), 4)
    np.testing.assert_allclose(np.diff(around), 90.0, rtol=1e-3)


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_the_way_around_is_told_in_numbers_that_blender_stores(kind):
    """numpy 2, in Blender 5.1 and later, keeps single precision where numpy 1 made Python's numbers of it."""
    angles = np.radians(np.linspace(-50.0, 50.0, 11))
    places = np.stack([np.cos(angles), np.sin(angles), np.zeros(11)], axis=1).astype(kind)
    start, swing = _way_around(places, 0.0)
    assert type(start) is type(swing) is float
    assert (start, swing) == pytest.approx((0.0, math.radians(50.0)), abs=1e-5)


def test_adding_again_makes_no_second_turntable(scene, splats):
    add_turntable(scene, splats, Turntable(frames=4))
    add_turntable(scene, splats, Turntable(frames=8))
    assert sum("cvdgs_turntable" in candidate for candidate in scene.objects) == 1
    remove_turntable(scene)
    assert turntable_of(scene) is None
    assert not [candidate for candidate in bpy.data.objects if "Turntable" in candidate.name]


@pytest.mark.parametrize("deleted", ["by a script", "with X"])
def test_a_turntable_without_its_camera_is_replaced(scene, splats, deleted):
    camera = add_turntable(scene, splats, Turntable(frames=4))
    if deleted == "with X":
        with bpy.context.temp_override(selected_objects=[camera], active_object=camera, object=camera):
            bpy.ops.object.delete()
    else:
        bpy.data.objects.remove(camera)
    assert turntable_of(scene) is None
    again = add_turntable(scene, splats, Turntable(frames=8))
    assert turntable_of(scene) == again
    assert [found for found in scene.objects if "cvdgs_turntable" in found] == [again.parent]


def test_a_turntable_is_found_beside_an_empty_that_lost_its_camera(scene, splats):
    camera = add_turntable(scene, splats, Turntable(frames=4))
    rig, left = camera.parent, bpy.data.objects.new("Turntable", None)
    left["cvdgs_turntable"] = True
    scene.collection.objects.unlink(rig)
    for empty in (left, rig):  # the older one comes first
        scene.collection.objects.link(empty)
    assert turntable_of(scene) == camera
    remove_turntable(scene)
    assert not [found for found in scene.objects if "cvdgs_turntable" in found]


def test_what_an_artist_set_by_hand_stays_when_the_turntable_is_brought_up_to_date(scene, splats):
    settings = Turntable(frames=4, radius=4.0, height=0.5)
    camera = scene.camera = add_turntable(scene, splats, settings)
    scene.timeline_markers.new("turn", frame=1).camera = camera
    camera.name, camera.data.dof.use_dof, camera.data.lens = "Hero", True, 85.0
    camera.location.z, camera.parent.location.x = 1.0, 0.25
    again = add_turntable(scene, splats, replace(settings, frames=8, arc=60.0))
    assert again == camera == scene.camera == scene.timeline_markers["turn"].camera
    assert (camera.name, camera.data.dof.use_dof, camera.data.lens) == ("Hero", True, 85.0)
    assert (camera.location.z, camera.parent.location.x) == (1.0, 0.25)
    assert len(camera.parent.animation_data.drivers) == 1
    angles = angles_around(scene, camera, 8)
    assert np.ptp(angles) == pytest.approx(60.0, abs=CENTER_DEGREES), "what was asked for anew"


def test_what_the_settings_or_the_gaussians_ask_for_anew_is_changed(scene, splats):
    settings = Turntable(frames=4, radius=4.0, height=0.5, focal_length=35.0)
    camera = add_turntable(scene, splats, settings)
    camera.location.z = 1.0
    add_turntable(scene, splats, replace(settings, radius=5.0))
    assert tuple(camera.location) == (5.0, 0.0, 2.5)
    assert camera.data.lens == 35.0
    add_turntable(scene, splats, replace(settings, radius=5.0, focal_length=50.0))
    assert camera.data.lens == 50.0
    before = camera.parent.location.x
    splats.location.x = 3.0
    add_turntable(scene, splats, replace(settings, radius=5.0, focal_length=50.0))
    assert camera.parent.location.x == pytest.approx(before + 3.0, abs=1e-5)


def test_a_turntable_of_an_earlier_release_is_placed_as_the_settings_say(scene, splats):
    camera = add_turntable(scene, splats, Turntable(frames=4, radius=4.0))
    for what in ("center", "place", "lens", "clip"):
        del camera.parent[f"asked_{what}"]
    camera.location.z = 3.0
    assert add_turntable(scene, splats, Turntable(frames=4, radius=4.0, height=0.5)) == camera
    assert tuple(camera.location) == (4.0, 0.0, 2.0)


def test_a_scene_keeps_looking_through_the_camera_that_it_has(scene, splats):
    scene.camera = artists = add_camera("artist's", CAMERA, ring_view(0.0), CLIP, scene.collection)
    add_turntable(scene, splats, Turntable(frames=4))
    add_turntable(scene, splats, Turntable(frames=8))
    assert scene.camera == artists


def test_a_camera_that_shares_the_turntables_lens_stays(scene, splats):
    shared = bpy.data.objects.new("artist's", add_turntable(scene, splats, Turntable(frames=4)).data)
    scene.collection.objects.link(shared)
    remove_turntable(scene)
    assert "artist's" in scene.objects


def test_the_pictures_are_the_rasterisers_from_all_around(scene, splats, tmp_path):
    gaussians = cloud(300)
    camera = add_turntable(scene, splats, SMALL)
    before = all_settings(scene)
    told = render_turntable(scene, SMALL, tmp_path / "turn", wait=True)
    assert any("Filepath" in line for line in told)
    assert all_settings(scene) == before
    assert list(rendering_changes(scene)) == []
    paths = sorted((tmp_path / "turn").iterdir())
    assert [path.name for path in paths] == ["0001.png", "0002.png", "0003.png", "0004.png"]
    focal = LENS / SENSOR_WIDTH * 64
    intrinsics = PinholeCamera(64, 48, focal, focal, 32.0, 24.0)
    for path, pose in zip(paths, camera_poses(scene, camera, 4), strict=True):
        expected = ewa.render(gaussians, gaussians.base_colors, intrinsics, opencv(pose))
        assert ewa.psnr(read_png(path), expected) > 45.0


def test_every_layer_can_be_turned_around(scene, tmp_path):
    gaussians = cloud(100)
    added = add_gaussians(gaussians, {"deutan-1.0": 1.0 - gaussians.base_colors}, scene.collection)
    add_turntable(scene, added, SMALL)
    pictures = []
    for layer in ("original", "deutan-1.0"):
        show_layer(added, layer)
        render_turntable(scene, Turntable(**{**vars(SMALL), "frames": 2}), tmp_path / layer, wait=True)
        pictures.append(read_png(tmp_path / layer / "0001.png"))
    assert np.abs(pictures[0] - pictures[1]).max() > 0.3


def test_pictures_go_into_the_folder_of_exactly_that_name(scene, splats, tmp_path):
    name = "{wip} {blend_name} {{done}} take {2"
    scene.camera = add_turntable(scene, splats, SMALL)
    render_turntable(scene, Turntable(**{**vars(SMALL), "frames": 1}), tmp_path / name / "turn", wait=True)
    render_picture(scene, tmp_path / name / "still.png")
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert sorted(path.name for path in (tmp_path / name).rglob("*.png")) == ["0001.png", "still.png"]


def test_the_scenes_own_engine_and_settings_can_be_kept(scene, splats, tmp_path):
    set_display(scene, Display.PHOTO)
    scene.render.engine = "BLENDER_WORKBENCH"
    add_turntable(scene, splats, SMALL)
    settings = Turntable(**{**vars(SMALL), "frames": 2, "engine": None})
    told = render_turntable(scene, settings, tmp_path, wait=True)
    assert not any("Engine" in line for line in told)
    assert scene.render.engine == "BLENDER_WORKBENCH"
    assert (tmp_path / "0002.png").is_file()


def test_markers_bind_no_other_camera_while_the_turntable_renders(scene, splats, tmp_path):
    add_turntable(scene, splats, SMALL)
    other = bpy.data.objects.new("Other", bpy.data.cameras.new("Other"))
    for frame in (1, 3, 5):
        scene.timeline_markers.new("cut", frame=frame).camera = other
    rendered = []

    def look(rendering: bpy.types.Scene, *_: object) -> None:
        rendered.append(rendering.camera)
        if len(scene.timeline_markers) > 2:
            scene.timeline_markers.remove(scene.timeline_markers[-1])

    bpy.app.handlers.render_post.append(look)
    try:
        render_turntable(scene, SMALL, tmp_path, wait=True)
    finally:
        bpy.app.handlers.render_post.remove(look)
    assert set(rendered) == {turntable_of(scene)}
    assert [marker.camera for marker in scene.timeline_markers] == [other, other]  # the third was deleted meanwhile
    assert not any(rendering_changes(scene))


def test_neither_the_video_sequencer_nor_time_stretching_changes_the_pictures(scene, splats, tmp_path):
    add_turntable(scene, splats, SMALL)
    render_turntable(scene, SMALL, tmp_path / "alone", wait=True)
    editor = scene.sequence_editor_create()
    strips = editor.strips if hasattr(editor, "strips") else editor.sequences
    length = {"length": 9} if bpy.app.version >= (5, 0) else {"frame_end": 10}
    strips.new_effect("Blue", "COLOR", channel=1, frame_start=1, **length)
    scene.render.frame_map_old, scene.render.frame_map_new = 100, 50
    render_turntable(scene, SMALL, tmp_path / "cut", wait=True)
    for name in ("0002.png", "0004.png"):
        np.testing.assert_array_equal(read_png(tmp_path / "cut" / name), read_png(tmp_path / "alone" / name))
    assert (scene.render.use_sequencer, scene.render.frame_map_new) == (True, 50)


def test_what_stands_in_the_way_is_told(scene, splats, tmp_path):
    with pytest.raises(InputError, match="no turntable - add one first"):
        render_turntable(scene, SMALL, tmp_path, wait=True)
    add_turntable(scene, splats, SMALL)
    (tmp_path / "file").write_text("")
    before = all_settings(scene)
    with pytest.raises(InputError, match="cannot be written to"):
        render_turntable(scene, SMALL, tmp_path / "file", wait=True)
    assert all_settings(scene) == before


@pytest.mark.parametrize("wait", [False, True])
def test_a_render_that_fails_leaves_the_settings_as_they_were(scene, splats, tmp_path, wait):
    add_turntable(scene, splats, SMALL)
    (tmp_path / "0001.png").mkdir()  # in the way of the first picture
    before = all_settings(scene)
    with pytest.raises(RuntimeError):
        render_turntable(scene, SMALL, tmp_path, wait=wait)
    assert all_settings(scene) == before
    assert not any(rendering_changes(scene))


def test_a_file_that_was_saved_while_it_rendered_opens_with_its_own_settings(addon, run_folder, tmp_path):
    scene = bpy.context.scene
    add_turntable(scene, show_run(str(run_folder), scene), SMALL)
    before = all_settings(scene)

    def save(*_: object) -> None:
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "saved.blend"))

    bpy.app.handlers.render_write.append(save)
    try:
        render_turntable(scene, SMALL, tmp_path / "turn", wait=True)
    finally:
        bpy.app.handlers.render_write.remove(save)
    assert all_settings(scene) == before
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "saved.blend"))
    assert all_settings(bpy.context.scene) == before
    assert not any(rendering_changes(bpy.context.scene))


def test_the_operators_and_the_panel(addon, run_folder, tmp_path):
    scene = bpy.context.scene
    assert any("first" in text for text in drawn(CVDGS_PT_turntable).texts)
    assert not bpy.ops.cvdgs.add_turntable.poll()
    show_run(str(run_folder), scene)
    assert not bpy.ops.cvdgs.render_turntable.poll()
    chosen = scene.cvdgs.turntable
    chosen.frames, chosen.width, chosen.height_pixels, chosen.engine = 2, 32, 24, Engine.CYCLES.value
    bpy.ops.cvdgs.add_turntable()
    assert "Update Turntable" in drawn(CVDGS_PT_turntable).texts
    assert not any("also show" in text for text in drawn(CVDGS_PT_turntable).texts)
    bpy.ops.mesh.primitive_cube_add()
    assert any("also show Cube" in text for text in drawn(CVDGS_PT_turntable).texts)
    bpy.data.objects["Cube"].hide_render = True
    assert not any("also show" in text for text in drawn(CVDGS_PT_turntable).texts)
    with pytest.raises(RuntimeError, match="save the file, or choose another folder"):
        bpy.ops.cvdgs.render_turntable()
    chosen.folder = str(tmp_path / "turn")
    assert bpy.ops.cvdgs.render_turntable("EXEC_DEFAULT", True) == {"FINISHED"}
    assert "CVDGS_OT_render_turntable" not in bpy.context.window_manager.operators, "Shift+R would wait for all images"
    assert len(list(Path(chosen.folder).glob("*.png"))) == 2
    bpy.ops.cvdgs.remove_turntable()
    assert turntable_of(scene) is None


def test_the_photographs_decide_the_height_until_one_is_chosen(addon, run_folder):
    scene = bpy.context.scene
    shown = show_run(str(run_folder), scene)
    place = add_turntable(scene, shown, Turntable()).location.copy()
    scene.cvdgs.turntable.height = 0.5
    bpy.ops.cvdgs.add_turntable()
    assert turntable_of(scene).location == place
    assert "height" not in drawn(CVDGS_PT_turntable).properties
    scene.cvdgs.turntable.has_height = True
    assert "height" in drawn(CVDGS_PT_turntable).properties
    bpy.ops.cvdgs.add_turntable()
    assert turntable_of(scene).location.z == pytest.approx(0.5 * place.x)


def test_a_turntable_that_cannot_be_made_anew_stays(addon, run_folder):
    show_run(str(run_folder), bpy.context.scene)
    bpy.ops.cvdgs.add_turntable()
    camera = bpy.context.scene.camera = turntable_of(bpy.context.scene)
    bpy.ops.cvdgs.edit_points()
    with pytest.raises(RuntimeError, match="leave Edit Mode"):
        bpy.ops.cvdgs.add_turntable()
    assert bpy.context.scene.camera == turntable_of(bpy.context.scene) == camera


def test_while_blender_renders_the_turntable_stays_as_it_is(addon, run_folder, monkeypatch):
    show_run(str(run_folder), bpy.context.scene)
    bpy.ops.cvdgs.add_turntable()
    called = (bpy.ops.cvdgs.add_turntable, bpy.ops.cvdgs.render_turntable, bpy.ops.cvdgs.remove_turntable)
    assert all(operator.poll() for operator in called)
    monkeypatch.setattr("cvdgs.operators.turntable.is_rendering", lambda: True)  # tests have no render window
    for operator in called:
        assert not operator.poll()
        with pytest.raises(RuntimeError, match="Blender is rendering"):
            operator()
