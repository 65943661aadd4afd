"""Runs that were broken off: what --resume makes of what they left, with real workers that are killed."""

import json
import os
import shutil
import signal
import threading
from dataclasses import replace

import pytest

from cvdgs import __version__
from cvdgs.core.demo import SHOWROOM
from cvdgs.core.errors import Cancelled, InputError
from cvdgs.core.pipeline.continuation import (
    CheckpointRequest,
    Resumption,
    broken_off,
    continued,
    describe_run,
    goes_on,
    resumption,
)
from cvdgs.core.pipeline.given import LAYERS
from cvdgs.core.pipeline.launch import run, stages_of
from cvdgs.core.runtime.process import Workers
from cvdgs.core.runtime.progress import CAMERAS
from cvdgs.core.runtime.supervisor import WorkerKilled
from cvdgs.core.settings import Layer, Settings

from ...few_views import write_few_views

STEPS = 90


@pytest.fixture(scope="module")
def capture(tmp_path_factory):
    return write_few_views(tmp_path_factory.mktemp("capture") / "photographs", 8, scale=0.2)


@pytest.fixture(scope="module")
def uninterrupted(capture, tmp_path_factory):
    out = tmp_path_factory.mktemp("whole") / "out"
    run(settings_for(capture, out), lambda _: None)
    return out


def settings_for(capture, out, **others) -> Settings:
    return Settings(str(capture), str(out), **{"iterations": STEPS, "blend": False, "enhancer": "lut", **others})


def scenes(out) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in out.glob("*.ply")}


def training_at(share: float, then):
    """A listener that does `then` once the geometry has come so far."""
    done = threading.Event()

    def listen(event):
        if event.get("stage") == "geometry" and event.get("fraction", 0.0) >= share and not done.is_set():
            done.set()
            then()

    return listen


def worker_of(workers: Workers) -> int:
    return workers._current._process.pid


@pytest.mark.slow
@pytest.mark.timeout(600)  # three runs with fresh processes on a busy machine
@pytest.mark.parametrize("share", [0.15, 0.7], ids=["coarse", "late"])
def test_a_run_whose_worker_was_killed_goes_on_and_ends_with_the_same_bytes(capture, uninterrupted, tmp_path, share):
    out, workers = tmp_path / "out", Workers()
    kill = training_at(share, lambda: os.kill(worker_of(workers), signal.SIGKILL))
    with pytest.raises(WorkerKilled):
        run(settings_for(capture, out), kill, workers, checkpoint_seconds=0.0)
    assert (out / ".checkpoint" / "state.safetensors").is_file()
    heard = []
    report = run(Settings(str(capture), str(out), resume=True), heard.append, given=())  # everything as before
    assert any("from step" in event.get("message", "") for event in heard)
    assert scenes(out) == scenes(uninterrupted)
    assert report["settings"]["iterations"] == STEPS
    assert report["settings"]["resume"] is False
    assert not (out / ".checkpoint").exists()


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_cancelled_run_leaves_a_checkpoint_and_nothing_else(capture, uninterrupted, tmp_path):
    out, workers = tmp_path / "out", Workers()
    with pytest.raises(Cancelled):
        run(settings_for(capture, out), training_at(0.3, workers.cancel), workers, checkpoint_seconds=0.0)
    assert [path.name for path in out.iterdir()] == [".checkpoint"]
    run(settings_for(capture, out, resume=True), lambda _: None)
    assert scenes(out) == scenes(uninterrupted)


@pytest.fixture(scope="module")
def photographs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("without-cameras")
    for path in sorted((SHOWROOM / "images").iterdir())[::4]:
        shutil.copy(path, folder)
    return folder


@pytest.mark.timeout(600)
def test_a_run_that_was_killed_before_it_trained_estimates_no_cameras_again(photographs, tmp_path):
    def kill_after_capture(event):
        if event.get("stage") == "enhance":
            os.kill(worker_of(workers), signal.SIGKILL)

    out, workers, asked = tmp_path / "out", Workers(), {"iterations": 30, "max_size": 96}
    with pytest.raises(WorkerKilled):
        run(settings_for(photographs, out, **asked), kill_after_capture, workers)
    assert sorted(path.name for path in (out / ".checkpoint").iterdir()) == ["capture.safetensors", "run.json"]
    heard = []
    report = run(Settings(str(photographs), str(out), resume=True), heard.append, given=())
    assert not any(event.get("stage") == CAMERAS for event in heard)
    assert report["settings"]["max_size"] == 96
    assert report["capture"]["estimate"]["placed"] == 10
    assert "cameras-estimated" in {warning["name"] for warning in report["warnings"]}
    assert not (out / ".checkpoint").exists()


@pytest.fixture
def broken_off_run(tmp_path):
    """The folder of a run that was broken off, as `resumption` looks at it."""

    def make(out=tmp_path / "out", **others):
        settings = Settings("photos", str(out), **others)
        (out / ".checkpoint").mkdir(parents=True)
        (out / ".checkpoint" / "run.json").write_text(json.dumps(describe_run(settings)))
        (out / ".checkpoint" / "state.safetensors").write_bytes(b"")
        return settings

    return make


def test_without_resume_a_checkpoint_is_left_alone(broken_off_run):
    settings = broken_off_run()
    assert resumption(settings) == resumption(replace(settings, resume=False))
    assert not resumption(settings).continues


def test_the_run_that_was_broken_off_has_the_options_that_are_not_given(broken_off_run):
    settings = broken_off_run(iterations=700, layers=(Layer("protan", 0.5),), turntable=48, engine="eevee")
    bare = Settings("photos", settings.out, resume=True)
    assert resumption(bare, ()) == Resumption(settings, continues=True)
    found = resumption(replace(bare, turntable=12), {"turntable"})
    assert found.continues
    assert found.settings == replace(settings, turntable=12)
    assert "geometry" in stages_of(found.settings)


def test_a_run_that_was_broken_off_without_blender_goes_on_without_it_unless_it_is_asked_for(broken_off_run):
    settings = broken_off_run(blend=False)
    bare = Settings("photos", settings.out, resume=True)
    assert resumption(bare, ()).settings == settings
    assert resumption(bare, {"blend"}).settings == replace(settings, blend=True)
    turning = replace(settings, blend=True, turntable=12)
    assert resumption(replace(bare, turntable=12), {"turntable"}).settings == turning, "Blender renders it"


def test_a_turntable_that_was_broken_off_is_left_out_without_blender(broken_off_run):
    settings = broken_off_run(turntable=12)
    asked = Settings("photos", settings.out, resume=True, blend=False)
    assert resumption(asked, {"blend"}).settings == replace(settings, blend=False, turntable=0)


@pytest.mark.parametrize(
    ("made_with", "given", "said"),
    [
        ({"layers": (Layer("protan", 1.0),)}, LAYERS, "--cvd"),
        ({"iterations": 700}, "iterations", "--iterations"),
        ({"max_size": 320}, "max_size", "--max-size"),
        ({"strength": 0.5}, "strength", "--strength"),
    ],
)
def test_an_option_that_is_given_counts_although_its_value_is_the_usual_one(broken_off_run, made_with, given, said):
    settings = Settings("photos", broken_off_run(**made_with).out)
    found = resumption(replace(settings, resume=True), {given})
    assert f"was made with another {said};" in found.note
    assert found.settings == settings
    assert not goes_on(settings, {given})
    assert goes_on(settings, ())


def test_other_options_make_another_run_and_that_is_said(broken_off_run):
    settings = broken_off_run(iterations=700)
    found = resumption(replace(settings, iterations=800, resume=True))
    assert not found.continues
    assert found.settings == replace(settings, iterations=800)
    assert found.note == (
        "the checkpoint of a run that was broken off here was made with another --iterations; it is not used"
    )


def test_other_layers_make_another_run(broken_off_run):
    settings = broken_off_run(layers=(Layer("protan", 0.5),))
    assert "another --cvd" in resumption(replace(settings, layers=(Layer("tritan", 1.0),), resume=True)).note


def test_another_version_makes_another_run(broken_off_run, tmp_path):
    settings = broken_off_run()
    described = describe_run(settings) | {"version": __version__ + "1"}
    (tmp_path / "out" / ".checkpoint" / "run.json").write_text(json.dumps(described))
    assert f"was made by version {__version__}1" in resumption(replace(settings, resume=True)).note


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"version": "1", "settings": {"capture": 3}}', '{"settings": null}'])
def test_a_damaged_description_is_said_and_the_run_starts_anew(broken_off_run, tmp_path, text):
    settings = broken_off_run()
    (tmp_path / "out" / ".checkpoint" / "run.json").write_text(text)
    found = resumption(replace(settings, resume=True))
    assert "is damaged" in found.note
    assert found.settings == settings


def test_beside_a_finished_run_layers_are_added_unless_the_very_same_was_asked_for(broken_off_run, tmp_path):
    settings = broken_off_run(iterations=700)
    (tmp_path / "out" / "report.json").write_text("{}")
    found = resumption(Settings("photos", settings.out, resume=True))
    assert not found.continues
    assert found.settings.resume
    assert not resumption(Settings("photos", settings.out, resume=True), ()).continues
    assert resumption(replace(settings, resume=True)).continues
    assert resumption(replace(settings, resume=True), {"iterations"}).continues


@pytest.fixture
def finished_run(tmp_path):
    """The settings of a finished run, as `resumption` looks at it."""
    (tmp_path / "out").mkdir()
    others = {"iterations": 700, "strength": 0.5, "enhancer": "lut", "turntable": 48, "engine": "eevee"}
    settings = Settings("photos", str(tmp_path / "out"), (Layer("protan", 0.5),), **others)
    (tmp_path / "out" / "report.json").write_text(json.dumps({"settings": settings.to_dict()}))
    return settings


def test_a_layer_that_is_added_has_the_options_that_are_not_given_of_the_finished_run(finished_run):
    bare = Settings("photos", finished_run.out, resume=True)
    added = replace(finished_run, layers=bare.layers, resume=True)
    assert resumption(bare, ()) == Resumption(added)
    asked = {"strength": 1.0, "enhancer": "scene", "turntable": 0}  # all of them usual
    assert resumption(bare, asked.keys()).settings == replace(added, **asked)


def test_what_shaped_a_finished_run_is_refused_where_it_is_given_otherwise_though_as_usual(finished_run):
    asked = Settings("photos", finished_run.out, resume=True)
    with pytest.raises(InputError, match="--iterations: the finished run has 700, not 5000 - leave it out"):
        resumption(asked, {"iterations"})
    assert not goes_on(asked, {"iterations"})


def test_settings_without_a_word_on_what_was_given_are_taken_as_they_are_but_for_what_shaped_the_run(finished_run):
    asked = Settings("photos", finished_run.out, (Layer("tritan", 1.0),), resume=True, blend=False)
    assert resumption(asked).settings == replace(asked, iterations=700)


def test_a_batch_goes_on_by_itself(broken_off_run):
    settings = broken_off_run(iterations=700)
    assert continued(settings).resume
    assert not continued(replace(settings, iterations=800)).resume
    assert not continued(Settings("photos", settings.out)).resume, "the usual value is one of its own, too"
    assert resumption(continued(settings)).continues


def test_a_folder_says_what_goes_on_with_its_run_whatever_it_was_made_with(broken_off_run, tmp_path):
    assert broken_off(tmp_path / "out") is None
    settings = broken_off_run(iterations=700, layers=(Layer("protan", 0.5),))
    asked = broken_off(tmp_path / "out")
    assert asked == replace(settings, resume=True)
    assert resumption(asked).continues
    (tmp_path / "out" / "report.json").write_text("{}")
    assert resumption(broken_off(tmp_path / "out")).continues, "beside a finished run, too"


@pytest.mark.parametrize("text", ["", "[]", json.dumps({"version": "0.0.0", "settings": {}})])
def test_a_folder_whose_checkpoint_cannot_be_used_offers_nothing(broken_off_run, tmp_path, text):
    broken_off_run()
    (tmp_path / "out" / ".checkpoint" / "run.json").write_text(text)
    assert broken_off(tmp_path / "out") is None


@pytest.mark.parametrize("values", [{}, {"folder": 3}, {"folder": "a", "other": 1}, {"folder": "a", "resume": "yes"}])
def test_a_request_for_checkpoints_that_is_none_is_refused(values):
    with pytest.raises(InputError):
        CheckpointRequest.from_dict(values)
