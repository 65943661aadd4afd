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
from cvdgs.core.pipeline.continuation import CheckpointRequest, broken_off, continued, describe_run, resumption
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


@pytest.mark.timeout(600)  # three runs with fresh processes on a busy machine
@pytest.mark.parametrize("share", [0.15, pytest.param(0.7, marks=pytest.mark.slow)], ids=["coarse", "late"])
def test_a_run_whose_worker_was_killed_goes_on_and_ends_with_the_same_bytes(capture, uninterrupted, tmp_path, share):
    out, workers = tmp_path / "out", Workers()
    kill = training_at(share, lambda: os.kill(worker_of(workers), signal.SIGKILL))
    with pytest.raises(WorkerKilled):
        run(settings_for(capture, out), kill, workers, checkpoint_seconds=0.0)
    assert (out / ".checkpoint" / "state.safetensors").is_file()
    heard = []
    asked = Settings(str(capture), str(out), blend=False, enhancer="lut", resume=True)  # the rest as before
    report = run(asked, heard.append)
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
    report = run(Settings(str(photographs), str(out), blend=False, enhancer="lut", resume=True), heard.append)
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
    settings = broken_off_run(iterations=700, layers=(Layer("protan", 0.5),))
    found = resumption(Settings("photos", settings.out, resume=True, turntable=12))
    assert found.continues
    assert found.settings == replace(settings, turntable=12)
    assert "geometry" in stages_of(found.settings)


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
    assert resumption(replace(settings, resume=True)).continues


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
