"""The worker's environment in the preferences: chosen, made by a button, found, checked, removed."""

from __future__ import annotations

import sys

import bpy
import pytest

from cvdgs.core.errors import InputError
from cvdgs.core.runs.folder import lock_exclusively, open_lock
from cvdgs.core.runtime.environment import mark
from cvdgs.core.runtime.process import find_python
from cvdgs.cvdgs_addon import environment
from cvdgs.cvdgs_addon.activity import ACTIVITY
from cvdgs.cvdgs_addon.background import State
from cvdgs.cvdgs_addon.preferences import known_machine, machine_speed

from .interpreters import interpreter
from .layouts import RecordingLayout
from .waiting import finished, until

MAKING = """
    folder = request["folder"]
    os.makedirs(folder + "/bin")
    emit("status", stage="environment", message="making")
    emit("progress", stage="environment", fraction=0.4, message="downloading torch (190 MB)")
    """
MADE = f"""
    open(folder + "/.complete", "w").write({mark()!r})
    shutil.copy(__file__, folder + "/bin/python")
    emit("result", python=folder + "/bin/python")
    """
CHECKING = """
    if request["job"] == "check":
        emit("result", machine={"versions": {"torch": "2.0"}, "device": "cpu: fast, 8 threads", "speed": 2.5})
        raise SystemExit(0)
    """
NOT_FOUND = 'emit("error", kind="input", message="no internet - try again")\nraise SystemExit(2)'


@pytest.fixture
def online(addon, tmp_path, monkeypatch):
    """The add-on with online access, its own folder, and no environment that is found elsewhere."""
    system = bpy.context.preferences.system
    before = system.use_online_access
    system.use_online_access = True
    monkeypatch.setattr(environment, "user_folder", lambda: tmp_path / "user")
    monkeypatch.setenv("CVDGS_PYTHON", str(tmp_path / "nowhere"))
    yield addon
    system.use_online_access = before


def base(tmp_path, *bodies: str) -> str:
    """A program that takes the place of the Python from which the environment is made."""
    (tmp_path / "base").mkdir(exist_ok=True)
    return interpreter(tmp_path / "base", *bodies)


def test_without_anything_the_user_is_led_to_the_preferences(online):
    with pytest.raises(InputError, match="set up the worker"):
        environment.worker_python()


def test_the_button_makes_an_environment_and_checks_it(online, tmp_path):
    environment.start_making(base(tmp_path, CHECKING, MAKING, MADE))
    bpy.context.preferences.is_dirty = False
    assert not bpy.ops.cvdgs.make_environment.poll()
    assert finished(environment.MAKE_JOB).problem == ""
    assert environment.worker_python() == str(tmp_path / "user" / "environment" / "bin" / "python")
    assert finished(environment.CHECK_JOB).problem == ""
    assert known_machine()["device"] == "cpu: fast, 8 threads"
    assert machine_speed() == 2.5
    assert bpy.context.preferences.is_dirty, "Blender would not save it"
    layout = RecordingLayout()
    from cvdgs.cvdgs_addon.preferences_panel import draw_preferences

    draw_preferences(online, layout)
    assert {"torch 2.0", "cpu: fast, 8 threads"} <= set(layout.texts)

    assert bpy.ops.cvdgs.remove_environment() == {"FINISHED"}
    assert not (tmp_path / "user" / "environment").exists()
    assert known_machine() == {}
    assert not bpy.ops.cvdgs.remove_environment.poll()


def test_a_failure_leaves_nothing_and_can_be_repeated(online, tmp_path):
    environment.start_making(base(tmp_path, MAKING, NOT_FOUND))
    assert finished(environment.MAKE_JOB).problem == "no internet - try again"
    assert not (tmp_path / "user" / "environment").exists()
    assert bpy.ops.cvdgs.make_environment.poll()


def test_a_cancellation_leaves_nothing(online, tmp_path):
    environment.start_making(base(tmp_path, MAKING, "time.sleep(60)"))
    job = ACTIVITY.job(environment.MAKE_JOB)
    until(lambda: job.progress.message.startswith("downloading torch"))
    layout = RecordingLayout()
    from cvdgs.cvdgs_addon.preferences_panel import draw_preferences

    draw_preferences(online, layout)
    assert any("downloading torch (190 MB)" in text for text in layout.texts)
    bpy.ops.cvdgs.cancel_job(job=environment.MAKE_JOB)
    finished(environment.MAKE_JOB)
    assert job.state is State.CANCELLED
    assert not (tmp_path / "user" / "environment").exists()


def test_a_working_environment_is_not_set_up_again(online, tmp_path):
    """Somebody who cancels that, or is offline, would lose it."""
    environment.start_making(base(tmp_path, CHECKING, MAKING, MADE))
    finished(environment.MAKE_JOB)
    finished(environment.CHECK_JOB)
    with pytest.raises(RuntimeError, match="Remove Worker first"):
        bpy.ops.cvdgs.make_environment()


def test_files_that_a_running_job_may_use_are_not_deleted(online, tmp_path):
    environment.start_making(base(tmp_path, 'if request["job"] == "check": time.sleep(60)', MAKING, MADE))
    finished(environment.MAKE_JOB)
    for delete in (bpy.ops.cvdgs.remove_environment, bpy.ops.cvdgs.clear_cache):
        with pytest.raises(RuntimeError, match="Wait for the running job"):
            delete()
    ACTIVITY.end(environment.CHECK_JOB)
    assert bpy.ops.cvdgs.remove_environment.poll()
    assert bpy.ops.cvdgs.clear_cache.poll()


def test_removing_ends_the_setting_up(online, tmp_path):
    environment.start_making(base(tmp_path, MAKING, "time.sleep(60)"))
    job = ACTIVITY.job(environment.MAKE_JOB)
    until(lambda: job.progress.message.startswith("downloading torch"))
    assert bpy.ops.cvdgs.remove_environment() == {"FINISHED"}
    assert ACTIVITY.job(environment.MAKE_JOB) is None
    assert not (tmp_path / "user" / "environment").exists()


def test_what_another_blender_is_setting_up_is_neither_removed_nor_replaced(online, tmp_path):
    half_made = tmp_path / "user" / "environment" / "pyvenv.cfg"
    half_made.parent.mkdir(parents=True)
    half_made.touch()
    with open_lock(tmp_path / "user" / "environment.lock") as lock:
        lock_exclusively(lock)  # as the other one's worker does
        environment.start_making(base(tmp_path, NOT_FOUND))
        assert finished(environment.MAKE_JOB).problem
        with pytest.raises(RuntimeError, match="a second Blender, is setting up the worker"):
            bpy.ops.cvdgs.remove_environment()
        assert half_made.exists()
    assert bpy.ops.cvdgs.remove_environment() == {"FINISHED"}
    assert not half_made.exists()


def test_nothing_is_downloaded_without_online_access(online):
    bpy.context.preferences.system.use_online_access = False
    assert not bpy.ops.cvdgs.make_environment.poll()
    with pytest.raises(RuntimeError, match="Online Access"):
        bpy.ops.cvdgs.make_environment()


def test_an_own_interpreter_comes_first(online, tmp_path):
    online.python = sys.executable
    assert environment.worker_python() == sys.executable
    online.python = str(tmp_path / "absent")
    with pytest.raises(InputError, match="not an executable program"):
        environment.worker_python()


def test_an_environment_that_was_left_half_made_is_not_used(online, tmp_path):
    environment.start_making(base(tmp_path, MAKING, MADE))
    finished(environment.MAKE_JOB)
    ACTIVITY.end(environment.CHECK_JOB)
    (tmp_path / "user" / "environment" / ".complete").unlink()
    with pytest.raises(InputError, match="set up the worker"):
        environment.worker_python()


def test_an_environment_with_the_packages_of_another_version_is_set_up_again(online, tmp_path):
    """It lies outside of the extension, where updates leave it."""
    environment.start_making(base(tmp_path, CHECKING, MAKING, MADE))
    finished(environment.MAKE_JOB)
    finished(environment.CHECK_JOB)
    (tmp_path / "user" / "environment" / ".complete").write_text("numpy>=1.26,<2\n")
    with pytest.raises(InputError, match=r"another version of the add-on - .* set up the worker"):
        environment.worker_python()
    assert "Set Up Worker replaces it" in environment.why_no_worker()
    assert bpy.ops.cvdgs.make_environment.poll()


def test_a_python_that_cannot_make_environments_is_refused(online, tmp_path):
    online.base_python = str(tmp_path / "absent")
    with pytest.raises(RuntimeError, match=r"python\.org"):
        bpy.ops.cvdgs.make_environment()
    online.base_python = sys.executable
    assert environment.find_base_python() == sys.executable


@pytest.mark.slow
def test_the_real_worker_can_be_checked(addon):
    addon.python = find_python()
    environment.start_check()
    job = ACTIVITY.job(environment.CHECK_JOB)
    job.wait()
    assert job.problem == ""
    assert job.result["speed"] > 0.0
    assert {"torch", "warp-lang", "python"} <= job.result["versions"].keys()
