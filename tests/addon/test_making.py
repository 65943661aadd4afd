"""The button: a run in the background, its progress, its end, and what it leaves in the scene."""

from __future__ import annotations

import json
import os
import shutil
import signal
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
import pytest

from cvdgs.core.errors import InputError
from cvdgs.core.pipeline.continuation import describe_run
from cvdgs.core.settings import Settings
from cvdgs.core.splats.io.ply import read_ply, write_ply
from cvdgs.cvdgs_addon import making
from cvdgs.cvdgs_addon.activity import ACTIVITY
from cvdgs.cvdgs_addon.background import State
from cvdgs.cvdgs_addon.results import show_run
from cvdgs.cvdgs_addon.scene.origin import run_of
from cvdgs.cvdgs_addon.scene.splats import is_splats, layer_names
from cvdgs.ui.run import CVDGS_PT_run

from .interpreters import (
    CRASHING,
    INSPECTING,
    REFUSING,
    REPORT,
    SLEEPING,
    finishing,
    report_with,
)
from .layouts import drawn
from .waiting import finished, until


def splats_in(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    return [candidate for candidate in scene.objects if is_splats(candidate)]


def press() -> None:
    """As a click does; without a window, Blender does not invoke operators."""
    making.start_run(bpy.context.scene)


def test_a_run_ends_with_its_layer_in_the_scene(capture, worker, run_folder, tmp_path):
    worker(finishing(run_folder))
    press()
    job = finished(making.JOB)
    assert (job.state, job.problem, job.warnings) == (State.DONE, "", ["24 views only"])
    (splats,) = splats_in(capture)
    out = str(tmp_path / "photos CVD")
    assert run_of(splats) == out
    assert layer_names(splats) == ["original", "deutan-1.0", "tritan-0.5"]
    assert json.loads(Path(out, "report.json").read_text())["layers"].keys() == {"deutan-1.0"}


def test_blender_goes_on_while_the_worker_runs(capture, worker):
    worker(SLEEPING)
    press()
    job = ACTIVITY.job(making.JOB)
    until(lambda: job.progress.message == "loading")
    for _ in range(50):
        ACTIVITY.look()
    assert job.is_running  # nothing has waited for it: it sleeps
    assert not bpy.ops.cvdgs.make_cvd_friendly.poll()


def test_shift_r_repeats_nothing_that_goes_on_in_the_background(capture, worker, run_folder):
    """It would wait for the end, and Blender with it."""
    worker(INSPECTING)
    assert bpy.ops.cvdgs.inspect_capture("EXEC_DEFAULT", True) == {"FINISHED"}
    worker(finishing(run_folder))
    assert bpy.ops.cvdgs.make_cvd_friendly("EXEC_DEFAULT", True) == {"FINISHED"}
    assert bpy.context.window_manager.operators.keys() == []


def test_a_cancelled_run_ends_soon_and_leaves_nothing(capture, worker, tmp_path):
    worker(SLEEPING)
    press()
    job = ACTIVITY.job(making.JOB)
    until(lambda: job.progress.message == "loading")
    assert bpy.ops.cvdgs.cancel_job() == {"FINISHED"}
    assert job.is_running  # the window does not wait for the end
    finished(making.JOB)
    assert job.state is State.CANCELLED
    assert splats_in(capture) == []
    assert not (tmp_path / "photos CVD").exists()
    assert bpy.ops.cvdgs.make_cvd_friendly.poll()


def test_a_worker_that_crashes_is_a_message(capture, worker, tmp_path):
    worker(CRASHING)
    press()
    job = finished(making.JOB)
    assert job.state is State.FAILED
    assert f"ended by signal {int(signal.SIGSEGV)}" in job.problem
    assert str(tmp_path / "photos CVD" / "failed.run.log") in job.problem


def test_what_the_worker_refuses_is_a_message(capture, worker):
    worker(REFUSING)
    press()
    assert finished(making.JOB).problem == "photos: no cameras - leave out --cameras given to estimate them"


@pytest.mark.parametrize("event", ["new file", "other file", "add-on"])
def test_closing_ends_the_worker(capture, worker, tmp_path, event):
    other, process = tmp_path / "other.blend", tmp_path / "process"
    bpy.ops.wm.save_as_mainfile(filepath=str(other), copy=True)
    worker(f'open({str(process)!r}, "w").write(str(os.getpid())); emit("status", stage="start", message="loading")\n'
           "time.sleep(60)")  # fmt: skip
    press()
    job = ACTIVITY.job(making.JOB)
    until(lambda: job.progress.message == "loading")
    if event == "new file":
        bpy.ops.wm.read_homefile(use_empty=True)
    elif event == "other file":
        bpy.ops.wm.open_mainfile(filepath=str(other))
    else:
        ACTIVITY.unregister()
        ACTIVITY.register()
    assert job.state is State.CANCELLED
    with pytest.raises(ProcessLookupError):
        os.kill(int(process.read_text()), 0)
    assert not (tmp_path / "photos CVD").exists()


@pytest.mark.parametrize("content", [None, b"not of Blender"])
def test_a_file_that_cannot_be_opened_leaves_the_run_going(capture, worker, tmp_path, content):
    worker(SLEEPING)
    press()
    job = ACTIVITY.job(making.JOB)
    until(lambda: job.progress.message == "loading")
    recent = tmp_path / "recent.blend"
    if content is not None:
        recent.write_bytes(content)
    with pytest.raises(RuntimeError, match=r"recent\.blend"):
        bpy.ops.wm.open_mainfile(filepath=str(recent))
    assert bpy.context.scene == capture
    assert ACTIVITY.running(making.JOB) is job
    assert not job.is_cancelling


def test_a_second_layer_is_added_to_the_run_that_is_there(capture, worker, run_folder, tmp_path):
    later = tmp_path / "later"
    shutil.copytree(run_folder, later)
    (run_folder / "splats.tritan-0.5.ply").unlink()
    worker(finishing(run_folder))
    press()
    finished(making.JOB)
    (splats,) = splats_in(capture)
    splats.location.x = 2.0

    capture.cvdgs.viewer.cvd, capture.cvdgs.viewer.severity = "tritan", 0.5
    assert making.adds_to_run(capture)
    assert making.run_settings(capture).resume
    worker(finishing(later, report_with("deutan-1.0", "tritan-0.5")))
    press()
    assert finished(making.JOB).problem == ""
    assert splats_in(capture) == [splats]
    assert layer_names(splats) == ["original", "deutan-1.0", "tritan-0.5"]
    assert splats.location.x == 2.0


def test_a_layer_that_is_there_is_not_made_twice(capture, worker, run_folder):
    worker(finishing(run_folder))
    press()
    finished(making.JOB)
    with pytest.raises(RuntimeError, match=r"already has the layer deutan-1\.0.*Start Over"):
        bpy.ops.cvdgs.make_cvd_friendly()
    capture.cvdgs.run.start_over = True
    assert not making.run_settings(capture).resume


@pytest.mark.parametrize("moved", [False, True])
def test_a_run_made_anew_replaces_what_the_scene_has_of_the_earlier_one(capture, worker, run_folder, moved):
    worker(finishing(run_folder))
    press()
    finished(making.JOB)
    (first,) = splats_in(capture)
    for path in run_folder.glob("splats*.ply"):
        gaussians = read_ply(path)
        means = gaussians.means + 1.0 if moved else gaussians.means
        sh = gaussians.sh if path.name == "splats.ply" else 0.5 * gaussians.sh
        write_ply(path, replace(gaussians, means=means, sh=sh))
    capture.cvdgs.run.start_over = True
    press()
    finished(making.JOB)
    shown = capture.cvdgs.display.target
    assert (shown == first) is not moved
    assert first.hide_render is moved
    assert not shown.hide_render
    expected = read_ply(run_folder / "splats.deutan-1.0.ply").base_colors
    colors = np.empty((len(shown.data.vertices), 4), np.float32)
    shown.data.attributes["color_deutan-1.0"].data.foreach_get("color", colors.reshape(-1))
    np.testing.assert_allclose(colors[: len(expected), :3], expected, atol=1e-6)


def noting(path: Path) -> str:
    """Body of a worker that keeps what a run was asked for."""
    return f"""
        if request["job"] == "run":
            open({str(path)!r}, "w").write(json.dumps(request))
        """


@pytest.fixture
def broken_off(capture):
    """The settings of a draft that was broken off in the capture's output folder."""
    capture.cvdgs.viewer.cvd, capture.cvdgs.run.quality = "protan", "DRAFT"
    settings = making.run_settings(capture)
    folder = Path(settings.out, ".checkpoint")
    folder.mkdir(parents=True)
    (folder / "run.json").write_text(json.dumps(describe_run(settings)))
    (folder / "state.safetensors").write_bytes(b"")
    capture.cvdgs.viewer.cvd, capture.cvdgs.run.quality = "deutan", "STANDARD"
    return settings


def test_a_run_that_was_broken_off_goes_on_with_its_own_settings(capture, worker, run_folder, broken_off, tmp_path):
    panel = drawn(CVDGS_PT_run)
    assert "A run for protan-1.0 was broken off here; it can" in " ".join(panel.texts)
    assert "Start Over" in panel.texts
    asked = tmp_path / "asked"
    worker(noting(asked), finishing(run_folder))
    making.start_run(capture, goes_on=True)
    assert not bpy.ops.cvdgs.resume_run.poll()
    assert finished(making.JOB).problem == ""
    request = json.loads(asked.read_text())
    assert request["checkpoint"]["resume"]
    assert Settings.from_dict(request["settings"]) == broken_off
    assert len(splats_in(capture)) == 1
    assert not bpy.ops.cvdgs.resume_run.poll()
    assert "cvdgs.resume_run" not in drawn(CVDGS_PT_run).operators


def test_a_run_that_was_broken_off_is_replaced_by_one_that_starts_over(worker, run_folder, broken_off, tmp_path):
    asked = tmp_path / "asked"
    worker(noting(asked), finishing(run_folder))
    press()
    finished(making.JOB)
    request = json.loads(asked.read_text())
    assert not request["checkpoint"]["resume"]
    assert [layer["cvd"] for layer in request["settings"]["layers"]] == ["deutan"]


def test_a_script_goes_on_with_a_run_that_was_broken_off(capture, worker, run_folder, broken_off):
    worker(finishing(run_folder))
    assert bpy.ops.cvdgs.resume_run() == {"FINISHED"}
    assert len(splats_in(capture)) == 1
    with pytest.raises(RuntimeError, match="No run was broken off"):
        bpy.ops.cvdgs.resume_run()


def test_a_script_waits_for_the_result(capture, worker, run_folder):
    worker(finishing(run_folder))
    assert bpy.ops.cvdgs.make_cvd_friendly() == {"FINISHED"}
    assert len(splats_in(capture)) == 1


def test_without_a_worker_the_remedy_is_named(capture, monkeypatch, tmp_path):
    monkeypatch.setenv("CVDGS_PYTHON", str(tmp_path / "nowhere"))
    press()
    assert "open the add-on's preferences" in finished(making.JOB).problem


def test_without_a_capture_the_button_says_what_is_missing(addon):
    assert not bpy.ops.cvdgs.make_cvd_friendly.poll()
    with pytest.raises(RuntimeError, match="Choose a folder of photographs"):
        bpy.ops.cvdgs.make_cvd_friendly()


def test_settings_come_from_the_panels(capture, addon):
    addon.device = "cpu"
    viewer, run = capture.cvdgs.viewer, capture.cvdgs.run
    viewer.cvd, viewer.severity, viewer.simulation, viewer.strength = "protan", 0.6, "brettel", 0.5
    run.quality, run.enhancer, run.scene_file, run.refine_poses = "DRAFT", "cgan", True, True
    settings = making.run_settings(capture)
    assert [layer.name for layer in settings.layers] == ["protan-0.6"]
    assert (settings.simulation, settings.strength, settings.enhancer) == ("brettel", 0.5, "cgan")
    assert (settings.max_size, settings.device, settings.blend, settings.resume) == (320, "cpu", True, False)
    assert settings.refine_poses


def test_a_type_that_the_model_does_not_describe_is_refused_at_once(capture):
    capture.cvdgs.viewer.cvd, capture.cvdgs.viewer.simulation = "tritan", "vienot"
    with pytest.raises(RuntimeError, match="use brettel or machado"):
        bpy.ops.cvdgs.make_cvd_friendly()


def test_the_demos_results_do_not_go_into_the_extension(addon):
    bpy.ops.cvdgs.use_demo()
    folder = Path(making.output_folder(bpy.context.scene))
    assert Path(making.__file__).resolve().parents[1] not in folder.parents


def test_a_finished_run_is_loaded_again_from_its_folder(addon, run_folder):
    (run_folder / "report.json").write_text(json.dumps(REPORT))
    assert bpy.ops.cvdgs.load_run(directory=f"{run_folder}/") == {"FINISHED"}
    (splats,) = splats_in(bpy.context.scene)
    assert run_of(splats) == str(run_folder)
    bpy.ops.cvdgs.load_run(directory=f"{run_folder}/")
    assert splats_in(bpy.context.scene) == [splats]


def test_a_loaded_run_takes_further_layers(addon, run_folder):
    (run_folder / "report.json").write_text(json.dumps(REPORT))
    scene = bpy.context.scene
    bpy.ops.cvdgs.load_run(directory=f"{run_folder}/")
    scene.cvdgs.viewer.cvd = "protan"
    settings = making.run_settings(scene)
    assert (settings.capture, settings.out) == (str(run_folder / "capture"), str(run_folder))
    assert settings.resume


def test_loading_a_run_leaves_the_capture_that_is_picked(capture, run_folder):
    folder = capture.cvdgs.capture.folder
    bpy.ops.cvdgs.load_run(directory=f"{run_folder}/")
    assert capture.cvdgs.capture.folder == folder
    assert capture.cvdgs.run.out == ""


def test_a_folder_without_a_run_is_refused_with_what_to_do(addon, tmp_path):
    with pytest.raises(RuntimeError, match="choose the output folder of a finished run"):
        bpy.ops.cvdgs.load_run(directory=str(tmp_path))


def test_a_run_whose_gaussians_were_edited_is_added_anew(addon, run_folder):
    scene = bpy.context.scene
    splats = show_run(str(run_folder), scene)
    mesh = bpy.data.meshes.new("few")
    splats.data = mesh
    assert show_run(str(run_folder), scene) != splats
    assert len(splats_in(scene)) == 2


def test_layers_are_not_added_in_edit_mode(addon, run_folder, tmp_path):
    scene = bpy.context.scene
    (run_folder / "splats.tritan-0.5.ply").rename(tmp_path / "kept")
    splats = show_run(str(run_folder), scene)
    (tmp_path / "kept").rename(run_folder / "splats.tritan-0.5.ply")
    bpy.context.view_layer.objects.active = splats
    bpy.ops.object.mode_set(mode="EDIT")
    with pytest.raises(InputError, match="leave Edit Mode"):
        show_run(str(run_folder), scene)
    bpy.ops.object.mode_set(mode="OBJECT")


def test_everything_is_saved_with_the_file(capture, worker, run_folder, tmp_path):
    worker(finishing(run_folder))
    press()
    finished(making.JOB)
    capture.cvdgs.viewer.severity = 0.3
    (splats,) = splats_in(capture)
    folder = run_of(splats)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "file.blend"))
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "file.blend"))
    properties = bpy.context.scene.cvdgs
    assert properties.viewer.severity == pytest.approx(0.3)
    assert properties.capture.views == 24
    (splats,) = splats_in(bpy.context.scene)
    assert run_of(splats) == folder


def test_the_estimate_follows_what_runs_have_taken(capture, worker, run_folder, addon):
    quality = making.quality_called(capture.cvdgs.run.quality)
    before = making.estimated_seconds(capture, quality)
    assert before > 0.0
    worker(finishing(run_folder))  # in no time, where the model expects minutes
    press()
    finished(making.JOB)
    capture.cvdgs.run.start_over = True
    assert addon.stage_speeds
    assert making.estimated_seconds(capture, quality) < before


def test_the_estimate_includes_cameras_that_have_to_be_found(capture):
    quality = making.quality_called(capture.cvdgs.run.quality)
    with_cameras = making.estimated_seconds(capture, quality)
    capture.cvdgs.capture.format = "sfm"
    assert making.estimated_seconds(capture, quality) > with_cameras + 1.0


def test_the_estimate_of_a_video_goes_by_the_frames_that_it_is_likely_to_give(capture):
    properties, quality = capture.cvdgs.capture, making.quality_called(capture.cvdgs.run.quality)
    properties.format, properties.views, properties.videos = "sfm", 100, 0
    of_photographs = making.estimated_seconds(capture, quality)
    properties.views, properties.videos, properties.seconds = 0, 1, 25.0
    assert making.estimated_seconds(capture, quality) == pytest.approx(of_photographs)
