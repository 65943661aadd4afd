"""A capture gets its true size from a length that is known; its run's files and exports then have it, too."""

from __future__ import annotations

import errno
import json
from pathlib import Path

import bpy
import mathutils
import numpy as np
import pytest

from cvdgs.core.errors import InputError
from cvdgs.core.runs.layout import CAPTURE_FOLDER
from cvdgs.core.runs.measured import note_metres
from cvdgs.core.runtime import process
from cvdgs.core.splats.io.layers import world_of_run
from cvdgs.cvdgs_addon.background import State
from cvdgs.cvdgs_addon.report_pages import JOB, start_writing_pages
from cvdgs.cvdgs_addon.results import show_run
from cvdgs.cvdgs_addon.scene import ruler
from cvdgs.cvdgs_addon.scene.cameras import is_capture_camera
from cvdgs.cvdgs_addon.scene.convert import load_run
from cvdgs.cvdgs_addon.scene.finished_run import read_run
from cvdgs.cvdgs_addon.scene.placement import found_of
from cvdgs.cvdgs_addon.scene.ruler import add_ruler, ends_of, measure
from cvdgs.cvdgs_addon.scene.splats import is_splats
from cvdgs.ui.capture import CVDGS_PT_import_capture

from .interpreters import REFUSING
from .layouts import drawn
from .scenes import synthetic_run
from .test_neighbours import in_scene
from .waiting import finished


@pytest.fixture
def run(addon, tmp_path: Path) -> Path:
    folder = synthetic_run(tmp_path / "shop")
    if not (folder / "report.json").is_file():
        (folder / "report.json").write_text(json.dumps({"capture": {"up": [0, 0, 1], "metres_per_unit": None}}))
    return folder


@pytest.fixture
def empty(run: Path) -> bpy.types.Object:
    bpy.context.scene.cvdgs.capture.folder = ""
    return show_run(str(run), bpy.context.scene).parent


def test_the_ends_of_a_ruler_come_to_be_as_far_apart_as_was_measured(run: Path, empty: bpy.types.Object) -> None:
    splats = next(child for child in empty.children if child.type != "CAMERA" and "cvdgs_run" in child)
    before = in_scene(splats)
    assert bpy.ops.cvdgs.add_ruler() == {"FINISHED"}
    assert bpy.ops.cvdgs.add_ruler() == {"FINISHED"}  # it has one already
    ends = add_ruler(empty)
    assert len([child for child in empty.children if "cvdgs_ruler" in child]) == 2
    for end, index in zip(ends, (3, 50), strict=True):
        end.matrix_world = mathutils.Matrix.Translation(before[index].tolist())
    camera = next(child for child in empty.children if is_capture_camera(child))
    reach = camera.data.clip_end
    assert bpy.ops.cvdgs.measure(length=2.4) == {"FINISHED"}
    after = in_scene(splats)
    assert np.linalg.norm(after[3] - after[50]) == pytest.approx(2.4, rel=1e-4)
    ratio = 2.4 / np.linalg.norm(before[3] - before[50])
    np.testing.assert_allclose(after[3] + after[50], before[3] + before[50], atol=1e-3)  # resized around its middle
    assert camera.data.clip_end == pytest.approx(reach * ratio, rel=1e-4)
    unit = found_of(empty).metres_per_unit
    assert unit == pytest.approx(max(empty.matrix_world.to_scale()), rel=1e-6)
    assert read_run(run).metres_per_unit == pytest.approx(unit)
    assert world_of_run(run / "splats.ply")[1] == pytest.approx(unit)
    bpy.ops.cvdgs.place_capture(up="Z")  # and it keeps its size when it is placed anew
    again = in_scene(splats)
    assert np.linalg.norm(again[3] - again[50]) == pytest.approx(2.4, rel=1e-4)


def test_of_two_runs_the_panels_own_is_measured_unless_what_is_active_belongs_to_another(
    tmp_path: Path, empty: bpy.types.Object
) -> None:
    shown = show_run(str(synthetic_run(tmp_path / "window")), bpy.context.scene)
    assert bpy.ops.cvdgs.add_ruler() == {"FINISHED"}
    assert (len(ends_of(shown.parent)), len(ends_of(empty))) == (2, 0)
    bpy.context.view_layer.objects.active = active = next(child for child in empty.children if is_splats(child))
    active.hide_set(True)  # as "Hide Others" does, which leaves it active
    assert bpy.ops.cvdgs.add_ruler() == {"FINISHED"}
    assert not ends_of(empty)
    active.hide_set(False)
    assert bpy.ops.cvdgs.add_ruler() == {"FINISHED"}
    assert len(ends_of(empty)) == 2


def test_undo_leaves_the_run_as_it_was_told_and_who_measures_is_told_so(run: Path, empty, capfd) -> None:
    name = empty.name
    add_ruler(empty)
    bpy.ops.ed.undo_push(message="ruler")
    assert bpy.ops.cvdgs.measure(length=2.4) == {"FINISHED"}
    bpy.ops.ed.undo_push(message="measured")
    bpy.ops.ed.undo()
    assert found_of(bpy.data.objects[name]).metres_per_unit is None
    assert read_run(run).metres_per_unit is not None
    assert "Undo does not reach the run: set the right length to correct it" in capfd.readouterr().out


@pytest.mark.parametrize(("system", "metres_of_unit"), [("METRIC", 0.01), ("IMPERIAL", 0.01), ("NONE", 1.0)])
def test_lengths_are_those_that_blender_shows(run: Path, empty: bpy.types.Object, system: str, metres_of_unit) -> None:
    scene = bpy.context.scene
    scene.unit_settings.system, scene.unit_settings.scale_length = system, 0.01  # Blender heeds no scale without units
    first, second = (end.matrix_world.translation for end in add_ruler(empty))
    bpy.context.view_layer.update()
    in_capture = (second - first).length / max(empty.matrix_world.to_scale())
    assert bpy.ops.cvdgs.measure(length=2.4 / metres_of_unit) == {"FINISHED"}  # what a field stores for 2.4 m
    assert (second - first).length * metres_of_unit == pytest.approx(2.4, rel=1e-4)
    assert read_run(run).metres_per_unit == pytest.approx(2.4 / in_capture, rel=1e-4)
    scale = list(empty.matrix_world.to_scale())
    bpy.ops.cvdgs.place_capture()
    bpy.context.view_layer.update()
    assert list(empty.matrix_world.to_scale()) == pytest.approx(scale, rel=1e-4)
    again = load_run(read_run(run), scene).empty
    bpy.context.view_layer.update()
    assert list(again.matrix_world.to_scale()) == pytest.approx(scale, rel=1e-4)


def test_a_mirrored_capture_gets_its_true_size(run: Path, empty: bpy.types.Object) -> None:
    empty.scale.x = -empty.scale.x
    add_ruler(empty)
    measure(empty, 0.5)
    first, second = (end.matrix_world.translation for end in ends_of(empty).values())
    assert (second - first).length == pytest.approx(0.5)
    assert found_of(empty).metres_per_unit == pytest.approx(abs(empty.scale.y))


def test_without_a_ruler_or_with_one_of_no_length_nothing_is_measured(empty: bpy.types.Object) -> None:
    assert not bpy.ops.cvdgs.measure.poll()
    with pytest.raises(InputError, match="no ruler"):
        measure(empty, 1.0)
    first, second = add_ruler(empty)
    assert bpy.ops.cvdgs.measure.poll()
    second.location = first.location
    with pytest.raises(InputError, match="no length"):
        measure(empty, 1.0)
    assert {"cvdgs.add_ruler", "cvdgs.measure"} <= set(drawn(CVDGS_PT_import_capture).operators)


@pytest.fixture
def page_worker(worker, monkeypatch):
    """As `worker`, where Blender's Python cannot write pages itself."""
    monkeypatch.setattr(process, "_has_modules", lambda *_: False)
    return worker


def test_the_report_page_of_a_run_says_what_was_measured_later(run: Path, empty: bpy.types.Object, page_worker) -> None:
    (run / "report.html").write_text("as it was")
    page_worker("""
        open(request["folder"] + "/report.html", "w").write(open(request["folder"] + "/report.json").read())
        emit("result")
        """)
    for end, place in zip(add_ruler(empty), ((0.0, 0.0, 0.0), (0.5, 0.0, 0.0)), strict=True):
        end.matrix_world = mathutils.Matrix.Translation(place)
    assert bpy.ops.cvdgs.measure(length=2.0) == {"FINISHED"}
    assert json.loads((run / "report.html").read_text())["capture"]["metres_per_unit"] == read_run(run).metres_per_unit
    start_writing_pages([run])
    assert finished(JOB).state is State.DONE


def test_a_page_that_cannot_be_written_leaves_the_scene_measured(
    run: Path, empty: bpy.types.Object, page_worker
) -> None:
    (run / "report.html").write_text("as it was")
    page_worker(REFUSING)
    add_ruler(empty)
    assert bpy.ops.cvdgs.measure(length=2.0) == {"FINISHED"}
    assert read_run(run).metres_per_unit == found_of(empty).metres_per_unit


def test_a_folder_without_a_run_is_told_nothing_and_damaged_files_are_named(run: Path, tmp_path: Path) -> None:
    assert not note_metres(tmp_path, 2.0)
    (run / CAPTURE_FOLDER / "transforms.json").write_text("[]")
    with pytest.raises(InputError, match="not the files of a run"):
        note_metres(run, 2.0)


def test_a_run_that_cannot_be_told_leaves_the_scene_as_it_is(run: Path, empty: bpy.types.Object) -> None:
    add_ruler(empty)
    before = empty.matrix_world.copy()
    (run / CAPTURE_FOLDER / "transforms.json").write_text("[]")
    with pytest.raises(InputError, match="not the files of a run"):
        measure(empty, 2.4)
    bpy.context.view_layer.update()
    assert empty.matrix_world == before


def test_a_run_on_a_read_only_share_is_refused_in_one_line(run: Path, empty: bpy.types.Object, monkeypatch) -> None:
    def read_only(*_: object) -> bool:
        raise OSError(errno.EROFS, "Read-only file system")

    monkeypatch.setattr(ruler, "note_metres", read_only)
    add_ruler(empty)
    before = empty.matrix_world.copy()
    with pytest.raises(InputError, match=f"{run}: cannot be written .*Read-only.* - allow writing"):
        measure(empty, 2.4)
    assert empty.matrix_world == before
