"""Export: what is shown is what is written, and other programs' files stand where the objects do."""

from __future__ import annotations

import json
import re
import signal
import sys

import addon_utils
import bpy
import mathutils
import numpy as np
import pytest

from cvdgs.core.runtime.protocol import Reporter
from cvdgs.core.splats.harmonics import basis
from cvdgs.core.splats.io.files import read_layers
from cvdgs.core.splats.io.ply import read_ply
from cvdgs.cvdgs_addon.export import (
    proposed_cube_name,
    proposed_folder,
    proposed_name,
    read_gaussians,
)
from cvdgs.cvdgs_addon.results import show_run
from cvdgs.cvdgs_addon.scene import splats as splat_objects
from cvdgs.cvdgs_addon.scene.convert import ConversionOptions, convert
from cvdgs.cvdgs_addon.scene.crop import add_crop_box
from cvdgs.cvdgs_addon.scene.splat_nodes import Input
from cvdgs.cvdgs_addon.shown import shown_run

from . import ewa
from .scenes import CAMERA, cloud, drawn_points, look_at, opencv, synthetic_run
from .test_splats import apply_transform

POSE = opencv(look_at((3.0, -2.0, 1.5)))


def picture(gaussians) -> np.ndarray:
    return ewa.render(gaussians, gaussians.base_colors, CAMERA, POSE)


def with_degree(gaussians, degree: int):
    rest = np.random.default_rng(3).normal(0.0, 0.1, (len(gaussians), (degree + 1) ** 2 - 1, 3))
    return type(gaussians)(
        gaussians.means,
        gaussians.log_scales,
        gaussians.quaternions,
        gaussians.opacity_logits,
        np.concatenate([gaussians.sh, rest], axis=1).astype(np.float32),
    )


@pytest.mark.parametrize("degree", [0, 2])
def test_an_object_gives_back_the_gaussians_that_it_was_made_of(scene, degree):
    gaussians = with_degree(cloud(50), degree)
    exported = read_gaussians(splat_objects.add_gaussians(gaussians, {}, scene.collection), "original", 1.0)
    assert not exported.lost_view_dependence
    for name in ("means", "log_scales", "opacity_logits", "sh"):
        np.testing.assert_allclose(getattr(exported.gaussians, name), getattr(gaussians, name), atol=2e-5)
    np.testing.assert_allclose(picture(exported.gaussians), picture(gaussians), atol=1e-5)


@pytest.mark.parametrize("enhanced", [0.0, 0.25, 1.0])
def test_colours_are_blended_as_the_slider_says(scene, enhanced):
    gaussians, random = cloud(50), np.random.default_rng(1)
    layer = random.uniform(0.0, 1.0, (50, 3)).astype(np.float32)
    added = splat_objects.add_gaussians(gaussians, {"deutan-1.0": layer}, scene.collection)
    exported = read_gaussians(added, "deutan-1.0", enhanced).gaussians
    expected = (1.0 - enhanced) * gaussians.base_colors + enhanced * layer
    np.testing.assert_allclose(exported.base_colors, expected, atol=1e-6)


def test_scene_axes_are_where_the_object_stands(scene):
    gaussians = cloud(60)
    added = splat_objects.add_gaussians(gaussians, {}, scene.collection)
    matrix = mathutils.Matrix.LocRotScale((0.3, -0.2, 0.1), mathutils.Euler((0.4, 0.2, -0.9)), (1.3, 0.8, 1.1))
    added.matrix_world = matrix
    bpy.context.view_layer.update()
    exported = read_gaussians(added, "original", 1.0, axes=added.matrix_world).gaussians
    moved = np.array(matrix)
    np.testing.assert_allclose(exported.means, gaussians.means @ moved[:3, :3].T + moved[:3, 3], atol=1e-5)
    # The covariance of an ellipsoid after a linear map, by definition.
    for found, given in zip(covariances(exported), covariances(gaussians), strict=True):
        np.testing.assert_allclose(found, moved[:3, :3] @ given @ moved[:3, :3].T, atol=1e-6)


def test_a_transform_that_was_applied_counts(scene):
    gaussians = cloud(60)
    moved = splat_objects.add_gaussians(gaussians, {}, scene.collection)
    applied = splat_objects.add_gaussians(gaussians, {}, scene.collection)
    for added in (moved, applied):
        added.matrix_world = mathutils.Matrix.LocRotScale((0.2, 0, 0.1), mathutils.Euler((0.1, 0.8, 0.3)), (1, 2, 1.5))
    bpy.context.view_layer.update()
    apply_transform(applied)
    pictures = [picture(read_gaussians(added, "original", 1.0, axes=added.matrix_world).gaussians)
                for added in (moved, applied)]  # fmt: skip
    np.testing.assert_allclose(pictures[1], pictures[0], atol=1e-4)


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_view_dependent_colours_turn_with_the_object(scene, degree):
    gaussians = with_degree(cloud(20), degree)
    added = splat_objects.add_gaussians(gaussians, {}, scene.collection)
    added.rotation_euler, added.scale = (0.5, -0.8, 2.1), (1.7, 1.7, 1.7)
    bpy.context.view_layer.update()
    exported = read_gaussians(added, "original", 1.0, axes=added.matrix_world)
    assert not exported.lost_view_dependence
    turn = np.array(added.matrix_world.to_3x3()) / 1.7
    directions = np.random.default_rng(4).standard_normal((9, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    before = np.einsum("dk,nkc->dnc", basis(directions, degree), gaussians.sh)
    after = np.einsum("dk,nkc->dnc", basis(directions @ turn.T, degree), exported.gaussians.sh)
    np.testing.assert_allclose(after, before, atol=1e-5)


def test_view_dependent_terms_of_a_stretched_object_are_left_out_and_that_is_said(scene):
    added = splat_objects.add_gaussians(with_degree(cloud(20), 1), {}, scene.collection)
    added.scale.z = 0.5
    bpy.context.view_layer.update()
    assert read_gaussians(added, "original", 1.0, axes=added.matrix_world).lost_view_dependence
    assert not read_gaussians(added, "original", 1.0).lost_view_dependence


def test_deleted_gaussians_are_gone(addon, run_folder, tmp_path):
    splats = show_run(str(run_folder), bpy.context.scene)
    bpy.context.view_layer.objects.active = splats
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="DESELECT")
    bpy.ops.object.mode_set(mode="OBJECT")
    for vertex in splats.data.vertices[:100]:
        vertex.select = True
    bpy.ops.object.mode_set(mode="EDIT")
    with pytest.raises(RuntimeError, match="leave Edit Mode"):
        bpy.ops.cvdgs.export_gaussians(filepath=str(tmp_path / "kept.ply"))
    bpy.ops.mesh.delete(type="VERT")
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.ops.cvdgs.export_gaussians(filepath=str(tmp_path / "kept.ply"))
    assert len(read_ply(tmp_path / "kept.ply")) == 300


@pytest.mark.filterwarnings("ignore:.*blend relative")  # Blender expects that nobody resolves them
def test_paths_beside_the_blend_file_are_understood(addon, run_folder, tmp_path):
    show_run(str(run_folder), bpy.context.scene)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    bpy.ops.cvdgs.export_gaussians(filepath="//kept.ply")
    bpy.ops.cvdgs.export_web_page(filepath="//kept.html")
    assert (tmp_path / "kept.ply").is_file()
    assert (tmp_path / "kept.html").is_file()


def test_a_web_page_holds_all_layers_as_they_are_now(addon, run_folder, tmp_path):
    splats = show_run(str(run_folder), bpy.context.scene)
    add_crop_box(splats).matrix_basis = mathutils.Matrix.Diagonal((0.7, 0.5, 0.9, 1.0))
    bpy.context.view_layer.update()
    left = len(read_gaussians(splats, "original", 1.0).gaussians)
    bpy.ops.cvdgs.export_web_page(filepath=str(tmp_path / "scene.html"))
    text = (tmp_path / "scene.html").read_text(encoding="utf-8")
    scene = json.loads(re.search('id="scene">(.*?)</script>', text)[1])
    assert 0 < scene["count"] == left < 400
    assert [layer["name"] for layer in scene["layers"]] == ["original", "deutan-1.0", "tritan-0.5"]


def test_a_gltf_file_holds_all_layers_upright_as_they_stand_in_the_scene(addon, run_folder, tmp_path):
    splats = show_run(str(run_folder), bpy.context.scene)
    splats.location.z += 3.0
    bpy.context.view_layer.update()
    bpy.ops.cvdgs.export_layers(filepath=str(tmp_path / "scene.glb"))
    layers = read_layers([tmp_path / "scene.glb"])
    assert list(layers) == ["original", "deutan-1.0", "tritan-0.5"]
    stands = read_gaussians(splats, "deutan-1.0", 1.0, axes=splats.matrix_world).gaussians
    np.testing.assert_allclose(layers["deutan-1.0"].means, stands.means, atol=1e-5)
    data = (tmp_path / "scene.glb").read_bytes()
    nodes = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])["nodes"]
    (turned,) = {tuple(node["rotation"]) for node in nodes if "rotation" in node}
    up = mathutils.Quaternion((turned[3], *turned[:3])) @ mathutils.Vector((0.0, 0.0, 1.0))
    np.testing.assert_allclose(up, (0.0, 1.0, 0.0), atol=1e-6)  # glTF's +Y is up
    np.testing.assert_allclose(layers["deutan-1.0"].base_colors, stands.base_colors, atol=1e-5)


def test_blenders_own_reader_puts_the_points_of_a_gltf_file_where_the_gaussians_stand(addon, run_folder, tmp_path):
    splats = show_run(str(run_folder), bpy.context.scene)
    splats.rotation_euler.z += 0.7
    bpy.context.view_layer.update()
    stands = read_gaussians(splats, "original", 1.0, axes=splats.matrix_world).gaussians.means
    bpy.ops.cvdgs.export_layers(filepath=str(tmp_path / "scene.glb"))
    before = set(bpy.data.objects)
    addon_utils.enable("io_scene_gltf2")
    bpy.ops.import_scene.gltf(filepath=str(tmp_path / "scene.glb"))
    bpy.context.view_layer.update()
    imported = {made.name: made for made in set(bpy.data.objects) - before if made.type == "MESH"}
    assert set(imported) == {"original", "deutan-1.0", "tritan-0.5"}
    points = [imported["original"].matrix_world @ vertex.co for vertex in imported["original"].data.vertices]
    np.testing.assert_allclose(np.array(points), stands, atol=1e-4)


def test_an_ending_that_cannot_hold_layers_is_refused_and_nothing_written(addon, run_folder, tmp_path):
    show_run(str(run_folder), bpy.context.scene)
    with pytest.raises(RuntimeError, match=r"write \.glb"):
        bpy.ops.cvdgs.export_layers(filepath=str(tmp_path / "scene.spz"))
    assert not (tmp_path / "scene.spz").exists()


def test_what_the_crop_box_hides_is_not_exported(scene):
    added = splat_objects.add_gaussians(cloud(200), {}, scene.collection)
    box = add_crop_box(added)
    box.matrix_basis = mathutils.Matrix.LocRotScale((0.4, 0.0, 0.0), mathutils.Euler((0.0, 0.0, 0.6)), (0.7, 0.5, 0.9))
    bpy.context.view_layer.update()
    local = (cloud(200).means - (0.4, 0.0, 0.0)) @ np.array(box.matrix_basis.to_3x3().normalized()) / (0.7, 0.5, 0.9)
    inside = (np.abs(local) <= 1.0).all(axis=1)
    assert 0 < inside.sum() < 200
    np.testing.assert_allclose(read_gaussians(added, "original", 1.0).gaussians.means, cloud(200).means[inside])


def test_budget_and_crop_box_leave_what_the_viewport_draws(scene):
    """What a copy as native splats holds."""
    gaussians = cloud(200)
    gaussians.opacity_logits[:] = 2.0  # all of them would be seen
    added = splat_objects.add_gaussians(gaussians, {}, scene.collection)
    add_crop_box(added).matrix_basis = mathutils.Matrix.Diagonal((0.7, 0.5, 0.9, 1.0))
    splat_objects.set_input(added, Input.BUDGET, 120)
    splat_objects.set_input(added, Input.AS_POINTS, True)
    bpy.context.view_layer.update()
    left = read_gaussians(added, "original", 1.0, as_in_viewport=True).gaussians.means
    assert 0 < len(left) < min(120, len(read_gaussians(added, "original", 1.0).gaussians))
    np.testing.assert_allclose(left, drawn_points(added)[0], atol=1e-6)


def test_the_shown_layer_is_exported(addon, run_folder, tmp_path):
    splats = show_run(str(run_folder), bpy.context.scene)
    splat_objects.show_layer(splats, "tritan-0.5")
    bpy.ops.cvdgs.export_gaussians(filepath=str(tmp_path / "tritan.ply"))
    expected = read_ply(run_folder / "splats.tritan-0.5.ply")
    np.testing.assert_allclose(read_ply(tmp_path / "tritan.ply").base_colors, expected.base_colors, atol=1e-6)


def test_a_format_that_is_not_known_is_refused(addon, run_folder, tmp_path):
    show_run(str(run_folder), bpy.context.scene)
    with pytest.raises(RuntimeError, match="is not a format for Gaussians"):
        bpy.ops.cvdgs.export_gaussians(filepath=str(tmp_path / "scene.obj"))


def test_the_lut_of_the_shown_layer_is_copied(addon, run_folder, tmp_path):
    (run_folder / "layer.tritan-0.5.cube").write_text("LUT_3D_SIZE 2\n")
    splat_objects.show_layer(show_run(str(run_folder), bpy.context.scene), "tritan-0.5")
    bpy.ops.cvdgs.export_cube(filepath=str(tmp_path / "mine.cube"))
    assert (tmp_path / "mine.cube").read_text() == "LUT_3D_SIZE 2\n"
    splat_objects.show_layer(bpy.context.scene.objects["run Gaussians"], "deutan-1.0")
    with pytest.raises(RuntimeError, match="there is no such LUT"):
        bpy.ops.cvdgs.export_cube(filepath=str(tmp_path / "mine.cube"))


@pytest.mark.skipif(sys.platform == "win32", reason="no such limit there")
def test_a_lut_for_which_there_is_no_room_leaves_the_earlier_file(addon, run_folder, tmp_path):
    import resource

    (run_folder / "layer.tritan-0.5.cube").write_text("LUT_3D_SIZE 2\n" * 1000)
    splat_objects.show_layer(show_run(str(run_folder), bpy.context.scene), "tritan-0.5")
    (tmp_path / "mine.cube").write_text("earlier")
    before, handler = resource.getrlimit(resource.RLIMIT_FSIZE), signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, before[1]))
    try:
        with pytest.raises(RuntimeError, match=r"cannot be written \(File too large\)"):
            bpy.ops.cvdgs.export_cube(filepath=str(tmp_path / "mine.cube"))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)
    assert (tmp_path / "mine.cube").read_text() == "earlier"


def test_the_original_colours_have_no_lut(addon, run_folder):
    splat_objects.show_layer(show_run(str(run_folder), bpy.context.scene), "original")
    assert not bpy.ops.cvdgs.export_cube.poll()


@pytest.mark.parametrize(
    ("enhanced", "name"),
    [
        (1.0, "my photos CVD tritan-0.5"),
        (0.4, "my photos CVD tritan-0.5 at 40 percent"),
        (0.0, "my photos CVD original"),
    ],
)
def test_files_are_named_after_run_layer_and_how_far_it_is_shown(addon, run_folder, enhanced, name):
    folder = run_folder.rename(run_folder.parent / "my photos CVD")
    splats = show_run(str(folder), bpy.context.scene)
    splat_objects.show_layer(splats, "tritan-0.5", enhanced)
    assert proposed_name(splats) == name
    assert proposed_cube_name(splats) == "my photos CVD tritan-0.5"


def test_files_go_beside_the_run_until_the_scene_has_a_place(addon, run_folder, tmp_path):
    splats = show_run(str(run_folder), bpy.context.scene)
    assert proposed_folder(splats) == str(run_folder.parent)
    (tmp_path / "project").mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "project" / "shop.blend"))
    assert proposed_folder(splats) == str(tmp_path / "project")


def test_files_come_from_the_run_whose_gaussians_are_shown(addon, run_folder, tmp_path):
    other = synthetic_run(tmp_path / "other")
    for folder in (run_folder, other):
        (folder / "layer.deutan-1.0.cube").write_text(f"TITLE {folder.name}\n")
        show_run(str(folder), bpy.context.scene)
    assert shown_run(bpy.context) == str(other)  # the newest
    bpy.context.scene.cvdgs.display.target = bpy.context.scene.objects["run Gaussians"]
    splat_objects.show_layer(bpy.context.scene.objects["run Gaussians"], "deutan-1.0")
    bpy.ops.cvdgs.export_cube(filepath=str(tmp_path / "mine.cube"))
    assert (tmp_path / "mine.cube").read_text() == "TITLE run\n"


def test_gaussians_that_were_deleted_are_shown_no_more(addon, run_folder):
    splats = show_run(str(run_folder), bpy.context.scene)
    for collection in splats.users_collection:
        collection.objects.unlink(splats)
    assert not bpy.ops.cvdgs.export_gaussians.poll()


def test_a_runs_own_scene_knows_its_run_wherever_it_is_moved(addon, run_folder):
    convert(run_folder, reporter=Reporter(), options=ConversionOptions(stills=False))
    moved = run_folder.rename(run_folder.parent / "moved")
    bpy.ops.wm.open_mainfile(filepath=str(moved / "scene.blend"))
    assert shown_run(bpy.context) == str(moved)
    show_run(str(moved), bpy.context.scene)  # takes the Gaussians that are there
    assert sum(splat_objects.is_splats(candidate) for candidate in bpy.context.scene.objects) == 1


def test_without_gaussians_the_operators_say_what_is_missing(addon):
    for operator in (bpy.ops.cvdgs.export_gaussians, bpy.ops.cvdgs.export_cube):
        assert not operator.poll()


def covariances(gaussians) -> np.ndarray:
    axes = ewa.rotation_matrices(gaussians.quaternions) * np.exp(gaussians.log_scales.astype(np.float64))[:, None]
    return axes @ axes.transpose(0, 2, 1)
