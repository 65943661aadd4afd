"""The sub-panels: each says what is missing before it can be used, and shows what there is."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import bpy
import pytest

from cvdgs.core.errors import InputError
from cvdgs.cvdgs_addon import inspection, making, messages, registration, viewer
from cvdgs.cvdgs_addon.activity import ACTIVITY
from cvdgs.cvdgs_addon.background import State
from cvdgs.cvdgs_addon.pictures import PICTURES
from cvdgs.cvdgs_addon.preferences_panel import draw_preferences
from cvdgs.cvdgs_addon.results import show_run
from cvdgs.operators import CLASSES as OPERATORS
from cvdgs.ui import CLASSES as PANELS
from cvdgs.ui.capture import CVDGS_PT_capture
from cvdgs.ui.layout import say_end
from cvdgs.ui.results import CVDGS_PT_export, CVDGS_PT_report
from cvdgs.ui.run import CVDGS_PT_run
from cvdgs.ui.viewer import CVDGS_MT_viewer_presets, CVDGS_PT_viewer

from .interpreters import INSPECTING, INSPECTING_A_VIDEO, REFUSING, REPORT
from .layouts import RecordingLayout, drawn
from .waiting import finished, until


def write_thumbnail(path: Path) -> Path:
    """A small picture file."""
    image = bpy.data.images.new("thumbnail", 8, 6)
    image.filepath_raw, image.file_format = str(path), "PNG"
    image.save()
    bpy.data.images.remove(image)
    return path


def test_every_operator_has_a_tooltip_and_is_found_by_search(addon):
    for cls in OPERATORS:
        assert cls.__doc__, cls.bl_idname
        assert len(cls.__doc__.strip()) > 20, cls.bl_idname
        assert cls.bl_label
        assert cls.bl_idname.startswith("cvdgs.")


def test_every_property_has_a_description(addon):
    groups = [group for group in bpy.context.scene.cvdgs.bl_rna.properties if group.type == "POINTER"]
    for group in groups:
        if group.identifier == "rna_type":
            continue
        for name, rna in group.fixed_type.properties.items():
            assert name in ("rna_type", "name") or rna.description, f"{group.identifier}.{name}"


def test_the_panels_stand_in_the_order_of_the_work():
    names = [
        panel.bl_label for panel in PANELS if issubclass(panel, bpy.types.Panel) and not hasattr(panel, "bl_parent_id")
    ]
    order = ["Capture", "Viewer", "Make CVD-friendly", "Display", "Simulate", "Turntable", "Report", "Export"]
    assert [name for name in names if name in order] == [name for name in order if name in names]
    assert {panel.bl_category for panel in PANELS if issubclass(panel, bpy.types.Panel)} == {"CVD"}


@pytest.mark.parametrize("panel", [CVDGS_PT_run, CVDGS_PT_report, CVDGS_PT_export, CVDGS_PT_capture])
def test_in_an_empty_scene_a_panel_says_what_to_do_first(addon, panel):
    shown = drawn(panel)
    assert any("first" in text or "Choose" in text for text in shown.texts)
    assert set(shown.operators) <= {
        *("cvdgs.load_run", "cvdgs.inspect_capture", "cvdgs.choose_capture_file", "cvdgs.use_demo")
    }


def test_an_inspected_capture_is_described(addon, worker, tmp_path):
    worker(INSPECTING)
    scene = bpy.context.scene
    scene.cvdgs.capture.folder = str(tmp_path)
    inspection.start_inspection(scene)
    assert any("Reading" in text for text in drawn(CVDGS_PT_capture).texts)
    assert not bpy.ops.cvdgs.inspect_capture.poll()
    finished(inspection.JOB)
    texts = drawn(CVDGS_PT_capture).texts
    assert "24 photographs, 480 × 360 pixels" in texts
    assert "COLMAP" in texts
    assert "5,000 sparse points" in texts
    assert "not many views" in texts
    assert bpy.ops.cvdgs.inspect_capture.poll()


def test_another_folder_does_not_wait_for_the_first(addon, worker, tmp_path):
    worker("time.sleep(60)")
    scene = bpy.context.scene
    scene.cvdgs.capture.folder = str(tmp_path)
    inspection.start_inspection(scene)
    worker(INSPECTING)
    inspection.start_inspection(scene)
    finished(inspection.JOB)
    assert scene.cvdgs.capture.views == 24


def test_undo_forgets_nothing_of_what_was_found_in_a_folder(addon, worker, tmp_path):
    worker(INSPECTING)
    bpy.context.scene.cvdgs.capture.folder = str(tmp_path)
    inspection.start_inspection(bpy.context.scene)
    bpy.ops.ed.undo_push(message="the folder")
    finished(inspection.JOB)
    bpy.ops.ed.undo_push(message="something else")
    bpy.ops.ed.undo()
    inspection.catch_up(bpy.context.scene)  # called by `history` where there is a window
    assert bpy.context.scene.cvdgs.capture.views == 24


def test_what_is_found_in_a_folder_that_was_undone_is_not_shown_of_another(addon, worker, tmp_path):
    worker(INSPECTING)
    scene = bpy.context.scene
    scene.cvdgs.capture.folder = str(tmp_path / "first")
    inspection.start_inspection(scene)
    scene.cvdgs.capture.folder = str(tmp_path / "second")
    finished(inspection.JOB)
    assert scene.cvdgs.capture.views == 0


def test_a_file_that_opens_starts_its_inspection_when_that_of_the_file_before_has_ended(
    addon, worker, tmp_path, monkeypatch
):
    file = str(tmp_path / "file.blend")
    worker("time.sleep(60)")
    bpy.context.scene.cvdgs.capture.folder = str(tmp_path)
    bpy.ops.wm.save_as_mainfile(filepath=file)
    inspection.start_inspection(bpy.context.scene)
    before = ACTIVITY.running(inspection.JOB)
    worker(INSPECTING)
    with_window = SimpleNamespace(background=False, handlers=bpy.app.handlers)
    monkeypatch.setattr(registration, "bpy", SimpleNamespace(app=with_window, context=bpy.context, data=bpy.data))
    bpy.ops.wm.open_mainfile(filepath=file)
    assert not before.is_running
    assert finished(inspection.JOB) is not before
    assert bpy.context.scene.cvdgs.capture.views == 24


def test_a_wrong_folder_is_explained_in_the_panels_words(addon, worker, tmp_path):
    worker(REFUSING)
    scene = bpy.context.scene
    scene.cvdgs.capture.folder = str(tmp_path)
    inspection.start_inspection(scene)
    finished(inspection.JOB)
    shown = drawn(CVDGS_PT_capture)
    text = " ".join(shown.texts)
    assert "no cameras" in text
    assert "'Cameras'" in text
    assert "--cameras" not in text
    assert "cameras" in shown.properties
    with pytest.raises(RuntimeError, match="set 'Cameras' to Automatic"):
        bpy.ops.cvdgs.make_cvd_friendly()


def test_a_video_is_described_and_a_file_can_be_chosen(addon, worker, tmp_path):
    worker(INSPECTING_A_VIDEO)
    capture = bpy.context.scene.cvdgs.capture
    assert bpy.ops.cvdgs.choose_capture_file(filepath=str(tmp_path / "room.mp4")) == {"FINISHED"}
    assert capture.folder == str(tmp_path / "room.mp4")
    bpy.ops.cvdgs.inspect_capture()
    text = " ".join(drawn(CVDGS_PT_capture).texts)
    assert "1 video of 19 s" in text
    assert "0 photographs" not in text
    assert "cameras" in drawn(CVDGS_PT_capture).properties


def test_a_script_waits_for_the_inspection(addon, worker, tmp_path):
    worker(INSPECTING)
    bpy.context.scene.cvdgs.capture.folder = str(tmp_path)
    assert bpy.ops.cvdgs.inspect_capture() == {"FINISHED"}
    assert bpy.context.scene.cvdgs.capture.views == 24
    worker(REFUSING)
    with pytest.raises(RuntimeError, match="set 'Cameras' to Automatic"):
        bpy.ops.cvdgs.inspect_capture()


def test_the_real_worker_looks_at_the_demo(addon):
    bpy.ops.cvdgs.use_demo()
    bpy.ops.cvdgs.inspect_capture()
    capture = bpy.context.scene.cvdgs.capture
    assert (capture.views, capture.width, capture.height) == (40, 480, 360)
    assert len(inspection.thumbnails_of(capture)) == 4


def test_a_run_shows_its_progress_and_a_way_out(addon, worker, tmp_path):
    picture = write_thumbnail(tmp_path / "preview.png")
    worker(
        f"""
        emit("progress", stage="geometry", fraction=0.5, seconds_left=9.0, message="12 Gaussians")
        emit("preview", file={str(picture)!r})
        time.sleep(60)
        """
    )
    scene = bpy.context.scene
    scene.cvdgs.capture.folder = str(tmp_path)
    making.start_run(scene)
    job = ACTIVITY.job(making.JOB)
    until(lambda: job.progress.stage == "geometry")
    until(lambda: making.PREVIEW in PICTURES)
    shown = drawn(CVDGS_PT_run)
    assert "Reconstructing" in shown.texts
    assert "12 Gaussians" in shown.texts
    assert any("left" in text for text in shown.texts)
    assert shown.operators == ["cvdgs.cancel_job"]
    bpy.ops.cvdgs.cancel_job()
    finished(making.JOB)
    assert making.PREVIEW not in PICTURES
    assert any("Cancelled" in text for text in drawn(CVDGS_PT_run).texts)


def test_the_qualities_have_times_once_the_capture_is_known(addon, worker, tmp_path):
    worker(INSPECTING)
    bpy.context.scene.cvdgs.capture.folder = str(tmp_path)
    assert not any("about" in text for text in drawn(CVDGS_PT_run).texts)
    bpy.ops.cvdgs.inspect_capture()
    texts = [text for text in drawn(CVDGS_PT_run).texts if "about" in text]
    assert [text.split(",")[0] for text in texts] == ["Draft", "Standard", "Fine"]


def test_where_a_run_is_the_button_adds_a_layer(addon, worker, tmp_path, run_folder):
    worker(INSPECTING)
    (run_folder / "report.json").write_text(json.dumps(REPORT))
    properties = bpy.context.scene.cvdgs
    properties.capture.folder, properties.run.out = str(tmp_path), str(run_folder)
    shown = drawn(CVDGS_PT_run)
    assert "cvdgs.make_cvd_friendly" not in shown.operators  # deutan-1.0 is there
    assert "start_over" in shown.properties
    properties.viewer.cvd = "tritan"
    assert "Add tritan-1.0" in drawn(CVDGS_PT_run).texts


def test_without_a_worker_the_panel_leads_to_the_preferences(addon, monkeypatch, tmp_path):
    monkeypatch.setenv("CVDGS_PYTHON", str(tmp_path / "nowhere"))
    bpy.context.scene.cvdgs.capture.folder = str(tmp_path)
    shown = drawn(CVDGS_PT_run)
    assert "preferences.addon_show" in shown.operators
    assert "cvdgs.make_cvd_friendly" not in shown.operators


def test_the_report_shows_the_figures_of_the_run(addon, run_folder):
    (run_folder / "report.json").write_text(json.dumps(REPORT))
    show_run(str(run_folder), bpy.context.scene)
    shown = drawn(CVDGS_PT_report)
    assert {"31.4 dB", "0.900", "60 → 90 %", "50 → 80 %", "4.2"} <= set(shown.texts)
    assert shown.operators == ["cvdgs.open_report"]


def test_a_damaged_report_is_said(addon, run_folder):
    (run_folder / "report.json").write_text("{")
    show_run(str(run_folder), bpy.context.scene)
    assert any("no report" in text for text in drawn(CVDGS_PT_report).texts)
    with pytest.raises(RuntimeError, match="there is no report"):
        bpy.ops.cvdgs.open_report()


def test_presets_set_type_and_severity(addon):
    drawn(CVDGS_MT_viewer_presets)
    bpy.ops.cvdgs.viewer_preset(preset="PROTANOMALY")
    properties = bpy.context.scene.cvdgs.viewer
    assert (properties.cvd, properties.severity) == ("protan", pytest.approx(0.6))


def test_the_arrangement_test_is_done_by_clicks(addon):
    scene = bpy.context.scene
    assert not bpy.ops.cvdgs.place_cap.poll()
    bpy.ops.cvdgs.start_arrangement(seed=7)
    assert sorted(viewer.free_caps(scene)) == list(range(1, 16))
    assert viewer.free_caps(scene) != list(range(1, 16))
    bpy.ops.cvdgs.place_cap(cap=15)
    bpy.ops.cvdgs.place_cap(cap=1)
    bpy.ops.cvdgs.take_back_cap(cap=15)
    assert viewer.arranged_caps(scene) == [1]
    with pytest.raises(RuntimeError, match="already"):
        bpy.ops.cvdgs.place_cap(cap=1)
    # As a simulated deuteranope arranges them.
    for cap in (15, 2, 3, 14, 13, 4, 5, 12, 11, 6, 10, 7, 9, 8):
        bpy.ops.cvdgs.place_cap(cap=cap)
    shown = drawn(CVDGS_PT_viewer)
    assert any("not a diagnosis" in text for text in shown.texts)
    bpy.ops.cvdgs.use_suggestion()
    assert scene.cvdgs.viewer.cvd == "deutan"
    assert scene.cvdgs.viewer.severity > 0.7
    assert not scene.cvdgs.viewer.test_is_open


def test_caps_in_order_suggest_nothing(addon):
    bpy.ops.cvdgs.start_arrangement()
    for cap in range(1, 16):
        bpy.ops.cvdgs.place_cap(cap=cap)
    assert not bpy.ops.cvdgs.use_suggestion.poll()


def test_the_preferences_say_what_was_found(addon, worker, tmp_path):
    worker("")
    layout = RecordingLayout()
    draw_preferences(addon, layout)
    assert str(tmp_path / "python") in layout.texts
    assert {"python", "device", "cache", "cache_limit"} <= set(layout.properties)


def test_a_message_has_the_remedy_in_a_line_of_its_own():
    error = InputError("no cameras", where="photos", remedy="add --cameras estimate")
    assert messages.lines_of(str(error)) == ["photos: no cameras", "Set 'Cameras' to Estimate"]


def test_narrow_panels_wrap_their_text(addon):
    narrow = SimpleNamespace(scene=bpy.context.scene, preferences=bpy.context.preferences,
                             region=SimpleNamespace(width=180), view_layer=bpy.context.view_layer)  # fmt: skip
    wide = SimpleNamespace(**{**vars(narrow), "region": SimpleNamespace(width=600)})
    assert len(drawn(CVDGS_PT_report, narrow).texts) > len(drawn(CVDGS_PT_report, wide).texts)


def test_the_default_output_is_beside_the_capture(addon, tmp_path):
    scene = bpy.context.scene
    assert making.output_folder(scene) == ""
    scene.cvdgs.capture.folder = f"{tmp_path}/photos/"
    assert Path(making.output_folder(scene)) == tmp_path / "photos CVD"


def test_messages_name_options_as_the_panels_do():
    assert messages.in_panel_words("--no-refine-poses keeps it") == "'Correct Cameras off' keeps it"


def test_a_cancelled_job_claims_nothing_about_earlier_results():
    layout = RecordingLayout()
    say_end(layout, bpy.context, SimpleNamespace(state=State.CANCELLED))
    assert "no results were changed" in " ".join(layout.texts)
