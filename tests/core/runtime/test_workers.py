"""Workers that another thread cancels, as Blender's window does."""

from __future__ import annotations

import os
import sys
import textwrap
import threading
import time
from pathlib import Path

import pytest

from cvdgs.core.errors import Cancelled, InputError
from cvdgs.core.pipeline.launch import run
from cvdgs.core.runtime.process import WORKER, Job, Workers, follow_parent
from cvdgs.core.runtime.supervisor import finish
from cvdgs.core.settings import Settings

from ...patience import SOON


@pytest.fixture
def interpreter(tmp_path: Path):
    """Makes a program that takes the place of the worker's Python and does what its body says."""

    def make(body: str) -> str:
        program = tmp_path / "python"
        program.write_text(f"#!{sys.executable}\nimport json, os, signal, sys, time\n" + textwrap.dedent(body))
        program.chmod(0o755)
        return str(program)

    return make


def start_event(path: Path) -> None:
    deadline = time.monotonic() + SOON
    while not path.exists() and time.monotonic() < deadline:
        time.sleep(0.01)


@pytest.mark.parametrize("deaf", [False, True], ids=["obedient", "deaf"])
def test_a_cancelled_run_ends_soon_and_leaves_nothing(interpreter, tmp_path, deaf):
    started = tmp_path / "started"
    python = interpreter(
        f"""
        {"signal.signal(signal.SIGINT, signal.SIG_IGN)" if deaf else ""}
        open({str(started)!r}, "w").close()
        time.sleep(60)
        """
    )
    workers, seen = Workers(python), []

    def work() -> None:
        try:
            run(Settings("photos", str(tmp_path / "out"), blend=False), lambda _: None, workers)
        except Cancelled:
            seen.append("cancelled")

    thread = threading.Thread(target=work)
    thread.start()
    start_event(started)
    workers.cancel()
    assert thread.is_alive() or not deaf  # the window does not wait for the end
    thread.join(timeout=SOON)
    assert seen == ["cancelled"]
    assert not (tmp_path / "out").exists()


def test_nothing_is_started_after_a_cancellation(interpreter):
    workers = Workers(interpreter("raise SystemExit(0)"))
    workers.cancel()
    with pytest.raises(Cancelled):
        workers.start({"job": "inspect"})


def test_workers_get_their_variables(interpreter):
    body = """print(json.dumps({"event": "result", "folder": os.environ["CVDGS_TEST"]}), flush=True)"""
    job = Workers(interpreter(body), {"CVDGS_TEST": "here"}).start({"job": "inspect"})
    assert finish(job, lambda _: None)["folder"] == "here"


@pytest.mark.skipif(not hasattr(os, "getpriority"), reason="this system has other priorities")
@pytest.mark.parametrize("low_priority", [True, False])
def test_workers_get_a_low_priority_if_asked(interpreter, low_priority):
    body = """
    sys.stdin.readline()  # comes after the process was told
    group = open("/proc/self/autogroup").read() if os.path.exists("/proc/self/autogroup") else "nice 5"
    own = os.getpriority(os.PRIO_PROCESS, 0)
    print(json.dumps({"event": "result", "own": own, "group": int(group.split()[-1])}), flush=True)
    """
    found = finish(Workers(interpreter(body), low_priority=low_priority).start({"job": "inspect"}), lambda _: None)
    ours = os.getpriority(os.PRIO_PROCESS, 0)
    assert (found["own"] >= 5) == (low_priority or ours >= 5)
    assert found["group"] == 5 or not low_priority


def test_a_missing_interpreter_is_refused_before_a_folder_is_made(tmp_path, monkeypatch):
    monkeypatch.setenv("CVDGS_PYTHON", str(tmp_path / "nowhere"))
    with pytest.raises(InputError, match="not a program"):
        run(Settings("photos", str(tmp_path / "out")), lambda _: None)
    assert not (tmp_path / "out").exists()


def test_a_library_that_crashes_at_the_end_does_not_spoil_the_result(tmp_path):
    program = f"""
        import atexit, os, runpy, sys
        atexit.register(os.abort)
        sys.path.insert(0, {str(WORKER.parent)!r})
        runpy.run_path({str(WORKER)!r}, run_name="__main__")
    """
    command = [sys.executable, "-c", textwrap.dedent(program)]
    job = Job(command, {"job": "inspect-all", "captures": [{"capture": str(tmp_path), "cameras": "auto"}]})
    assert [event["event"] for event in job.events()][-1] == "result"
    assert job.wait() == 0


def test_windows_which_does_not_tell_of_a_lost_parent_is_not_believed_to_have_told(monkeypatch):
    """There a virtual environment's python.exe starts another process, whose parent it is."""
    gone = threading.Event()
    monkeypatch.setattr(sys, "platform", "win32")
    follow_parent(gone.set, parent=os.getpid())
    assert not gone.wait(0.5)
