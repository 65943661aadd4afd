"""Gaussians know their run wherever they are taken: appended, linked, or in a file that is saved elsewhere."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import bpy
import pytest

from cvdgs.core.runs.layout import BLEND_FILE
from cvdgs.core.runtime.protocol import Reporter
from cvdgs.cvdgs_addon.results import show_run
from cvdgs.cvdgs_addon.scene.alignment import add_marks
from cvdgs.cvdgs_addon.scene.convert import ConversionOptions, convert
from cvdgs.cvdgs_addon.scene.finished_run import RUN_PROPERTY, read_run
from cvdgs.cvdgs_addon.scene.origin import run_of
from cvdgs.cvdgs_addon.scene.ruler import add_ruler, measure
from cvdgs.cvdgs_addon.scene.splat_nodes import Input
from cvdgs.cvdgs_addon.scene.splats import get_input, is_splats, layer_names
from cvdgs.ui.display import CVDGS_PT_display

from .layouts import drawn
from .scenes import synthetic_run


@pytest.fixture
def runs(addon, tmp_path: Path) -> tuple[Path, Path]:
    """Two runs, each with a scene; that of the second one is open."""
    folders = tmp_path / "shop", tmp_path / "window"
    for folder in folders:
        synthetic_run(folder, 20)
        (folder / "report.json").write_text(json.dumps({"capture": {"metres_per_unit": None}, "layers": {}}))
        convert(folder, reporter=Reporter(), options=ConversionOptions(stills=False))
    open_scene(folders[1])
    return folders


def open_scene(folder: Path) -> None:
    bpy.ops.wm.open_mainfile(filepath=str(folder / "scene.blend"))


def bring(folder: Path, *, link: bool) -> bpy.types.Object:
    """The Gaussians of a run's scene, in the open scene with all that is in their collection."""
    with bpy.data.libraries.load(str(folder / "scene.blend"), link=link) as (stored, wanted):
        wanted.collections = list(stored.collections)
    for collection in wanted.collections:
        if not any(collection.name in other.children for other in wanted.collections):
            bpy.context.scene.collection.children.link(collection)
    return next(found for collection in wanted.collections for found in collection.all_objects if is_splats(found))


def own_splats() -> bpy.types.Object:
    return next(found for found in bpy.context.scene.objects if is_splats(found))


@pytest.mark.parametrize("link", [False, True])
def test_gaussians_of_another_file_keep_their_run(runs, link):
    shop, window = runs
    own = own_splats()
    brought = bring(shop, link=link)
    assert (run_of(brought), run_of(own)) == (str(shop), str(window))


@pytest.mark.parametrize("link", [False, True])
def test_gaussians_of_another_file_are_changed_only_where_the_open_one_keeps_it(runs, link):
    brought = bring(runs[0], link=link)
    bpy.context.scene.cvdgs.display.target = brought
    changing = ("edit_points", "select_color", "remove_floaters", "recolor_selected", "relight", "add_crop_box")
    assert {getattr(bpy.ops.cvdgs, name).poll() for name in changing} == {not link}
    assert ("not saved" in " ".join(drawn(CVDGS_PT_display).texts)) == link
    assert bpy.ops.cvdgs.show_form(form="POINTS") == {"FINISHED"}


def test_linked_gaussians_can_be_changed_once_they_are_local(runs):
    brought = bring(runs[0], link=True)
    bpy.context.scene.cvdgs.display.target = brought
    brought.select_set(True)
    bpy.ops.object.make_local(type="SELECT_OBDATA")
    assert bpy.ops.cvdgs.add_crop_box() == {"FINISHED"}


def test_marks_of_linked_gaussians_are_in_a_collection_of_the_open_scene(runs):
    brought, scene = bring(runs[0], link=True), bpy.context.scene
    made = add_marks(brought, own_splats())
    assert [found.users_collection[0].library for found in made] == [None] * len(made)
    assert all(mark.name in scene.objects for mark in made)


def test_a_length_is_told_to_the_run_of_the_gaussians_that_were_measured(runs):
    shop, window = runs
    empty = bring(shop, link=False).parent
    add_ruler(empty)
    assert measure(empty, 2.0) == [shop]
    assert read_run(shop).metres_per_unit is not None
    assert read_run(window).metres_per_unit is None


def test_a_scene_that_is_saved_elsewhere_keeps_its_run(runs, tmp_path):
    (tmp_path / "films").mkdir()
    file = str(tmp_path / "films" / "film.blend")
    bpy.ops.wm.save_as_mainfile(filepath=file)
    bpy.ops.wm.open_mainfile(filepath=file)
    splats = own_splats()
    assert run_of(splats) == str(runs[1])
    assert show_run(str(runs[1]), bpy.context.scene) == splats, "no second copy"


def test_a_run_is_moved_with_its_scene_also_after_a_copy_was_saved_elsewhere(runs, tmp_path):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "copy.blend"), copy=True)
    bpy.ops.wm.save_mainfile()
    moved = tmp_path / "moved"
    shutil.move(runs[1], moved)
    open_scene(moved)
    assert run_of(own_splats()) == str(moved)


def test_a_copy_in_the_folder_of_the_run_leaves_the_open_scene_its_run(runs, tmp_path):
    window = runs[1]
    (tmp_path / "films").mkdir()
    film = str(tmp_path / "films" / "film.blend")
    bpy.ops.wm.save_as_mainfile(filepath=film)
    bpy.ops.wm.save_as_mainfile(filepath=str(window / "copy.blend"), copy=True)
    assert run_of(own_splats()) == str(window)
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.open_mainfile(filepath=film)
    assert run_of(own_splats()) == str(window)
    bpy.ops.wm.open_mainfile(filepath=str(window / "copy.blend"))
    assert own_splats()[RUN_PROPERTY] == "//", "the copy is moved with the run"


def test_a_copy_of_a_scene_that_was_never_saved_leaves_it_its_run(addon, run_folder, tmp_path):
    splats = show_run(str(run_folder), bpy.context.scene)
    bpy.ops.wm.save_as_mainfile(filepath=str(run_folder / "copy.blend"), copy=True)
    assert run_of(splats) == str(run_folder)


@pytest.mark.parametrize("beside", [False, True])
def test_a_scene_that_could_not_be_saved_elsewhere_keeps_its_run(runs, tmp_path, beside):
    """Also one that was to leave its run's folder."""
    window = runs[1]
    if not beside:
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "film.blend"))
    before = own_splats()[RUN_PROPERTY]
    in_the_way = (tmp_path if beside else window) / "taken.blend"
    in_the_way.mkdir()
    with pytest.raises(RuntimeError, match="is a directory"):
        bpy.ops.wm.save_as_mainfile(filepath=str(in_the_way))
    assert own_splats()[RUN_PROPERTY] == before
    assert run_of(own_splats()) == str(window)


def test_nothing_is_beside_a_file_that_was_never_saved(addon):
    splats = bpy.data.objects.new("Gaussians", None)
    splats[RUN_PROPERTY] = "//"
    assert run_of(splats) == ""


@pytest.fixture
def showroom(addon, tmp_path: Path) -> Path:
    """A scene with lamps among its Gaussians is open; the file of another run, whose view transform is Raw."""
    library = synthetic_run(tmp_path / "shop", 20)
    convert(library, reporter=Reporter(), options=ConversionOptions(stills=False))
    bpy.ops.wm.read_homefile(use_empty=True)
    show_run(str(synthetic_run(tmp_path / "showroom", 20)), bpy.context.scene)
    bpy.context.scene.cvdgs.display.colors = "SCENE_LINEAR"
    bpy.ops.cvdgs.set_up_render()
    return library / BLEND_FILE


def shown_as_light() -> dict[str, bool]:
    """By name of the scene's Gaussians."""
    found = filter(is_splats, bpy.context.scene.objects)
    return {splats.name: bool(get_input(splats, Input.SCENE_LINEAR)) for splats in found}


@pytest.mark.parametrize("link", [False, True])
def test_gaussians_from_another_file_have_the_right_colours_among_lamps(showroom, tmp_path, link):
    bring_in = bpy.ops.wm.link if link else bpy.ops.wm.append
    bring_in(directory=f"{showroom}/Collection/", filename="shop", instance_collections=False)
    assert shown_as_light() == {"showroom Gaussians": True, "shop Gaussians": True}
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "showroom.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "showroom.blend"))
    assert shown_as_light() == {"showroom Gaussians": True, "shop Gaussians": True}


def test_gaussians_that_are_linked_as_an_instance_have_the_right_colours_among_lamps(showroom, tmp_path):
    bpy.ops.wm.link(directory=f"{showroom}/Collection/", filename="shop", instance_collections=True)
    assert get_input(bpy.data.objects["shop Gaussians"], Input.SCENE_LINEAR)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "showroom.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "showroom.blend"))
    assert get_input(bpy.data.objects["shop Gaussians"], Input.SCENE_LINEAR)


def test_the_panel_says_how_gaussians_that_are_linked_as_an_instance_can_be_used(showroom):
    bpy.ops.wm.read_homefile(use_empty=True)
    assert "Start a run" in " ".join(drawn(CVDGS_PT_display).texts)
    bpy.ops.wm.link(directory=f"{showroom}/Collection/", filename="shop", instance_collections=True)
    assert "Object > Library Override > Make" in " ".join(drawn(CVDGS_PT_display).texts)
    (instance,) = bpy.context.scene.objects
    bpy.context.view_layer.objects.active = instance
    instance.select_set(True)
    bpy.ops.object.make_override_library()
    assert bpy.ops.cvdgs.show_layer(layer="tritan-0.5") == {"FINISHED"}


def test_a_run_that_was_moved_is_loaded_into_the_gaussians_that_are_there(addon, tmp_path):
    before, after = synthetic_run(tmp_path / "shop", 20), tmp_path / "archive"
    scene = bpy.context.scene
    splats = show_run(str(before), scene)
    (before / "splats.tritan-0.5.ply").rename(before / "splats.protan-1.0.ply")
    shutil.move(before, after)
    assert show_run(str(after), scene) == splats
    assert run_of(splats) == str(after)
    assert layer_names(splats) == ["original", "deutan-1.0", "tritan-0.5", "protan-1.0"]
    copy = shutil.copytree(after, tmp_path / "copy")
    assert show_run(str(copy), scene) != splats, "both runs are there"
    assert run_of(splats) == str(after)
