"""What a run makes of faults around it: killed processes, full disks, silence, impatience. With stand-ins for workers.

`test_faults_in_stages.py` does the same to real runs.
"""

from __future__ import annotations

import errno
import json
import os
import re
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import pytest

from cvdgs.core.errors import Cancelled, InputError
from cvdgs.core.pipeline.launch import run
from cvdgs.core.runtime.process import Job, Workers
from cvdgs.core.runtime.supervisor import WorkerKilled, finish, in_console
from cvdgs.core.settings import Settings

from ...patience import SOON
from ..workers import REPORT, ROOT, start_run

POSIX = pytest.mark.skipif(os.name != "posix", reason="processes are killed by a signal")
PACKAGE = ("core", "cvdgs_addon", "operators", "ui", "scripts")


def started(body: str, **options) -> Job:
    """A worker that does what `body` says."""
    return Job([sys.executable, "-c", "import json, os, signal, sys, time\n" + textwrap.dedent(body)], **options)


def ends(process: int) -> bool:
    """Whether the process ends soon."""
    deadline = time.monotonic() + SOON
    while time.monotonic() < deadline:
        try:
            if Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] == "Z":
                return True
            os.kill(process, 0)
        except (ProcessLookupError, FileNotFoundError):
            return True
        time.sleep(0.05)
    return False


@POSIX
def test_a_worker_that_was_killed_is_no_defect_and_the_message_says_in_which_stage():
    job = started("""
        print(json.dumps({"event": "status", "stage": "geometry", "message": ""}), flush=True)
        os.kill(os.getpid(), signal.SIGKILL)
    """)
    with pytest.raises(
        WorkerKilled, match=r"killed during 'geometry', most likely because .* memory .* then run again"
    ):
        finish(job, lambda _: None)


@POSIX
@pytest.mark.parametrize("ending", ["os.kill(os.getpid(), signal.SIGTERM)", "sys.exit(130)"], ids=["signal", "code"])
def test_a_worker_that_others_stop_says_so(ending):
    with pytest.raises(WorkerKilled, match=r"by another program.* - run again"):
        finish(started(ending), lambda _: None)


@POSIX
def test_the_log_of_a_killed_worker_is_kept_and_nobody_is_asked_to_report_it(tmp_path):
    process = start_run(tmp_path / "worker", "os.kill(os.getpid(), signal.SIGKILL)", out=tmp_path / "out")
    _, said = process.communicate(timeout=SOON)
    assert process.returncode == 1
    assert str(tmp_path / "out" / "failed.run.log") in said
    assert "report it" not in said
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["failed.run.log"]


def test_a_log_on_a_full_disk_ends_the_run_instead_of_stopping_the_worker_for_ever():
    def full(_line: str) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    chatter = 'print("a library talks", "." * 1000, file=[sys.stdout, sys.stderr][i % 2])'
    body = f'for i in range(2000): {chatter}\nprint(json.dumps({{"event": "result"}}), flush=True)'
    with pytest.raises(OSError, match=os.strerror(errno.ENOSPC)):
        finish(started(body, log=full), lambda _: None)


def test_a_worker_that_says_nothing_is_told_once_a_stage():
    job = started("""
        def status(stage): print(json.dumps({"event": "status", "stage": stage, "message": ""}), flush=True)
        status("geometry"); time.sleep(1.0); status("layers"); time.sleep(1.0)
        print(json.dumps({"event": "result"}), flush=True)
    """)
    heard = []
    finish(job, heard.append, patience_seconds=0.3)
    warnings = [event["message"] for event in heard if event["event"] == "warning"]
    places = [message for message in warnings if " in '" in message]  # before its first word it is in no stage yet
    assert [place.partition(" in '")[2].partition("'")[0] for place in places] == ["geometry", "layers"]
    assert all("cancel and run again" in message for message in warnings)


@POSIX
def test_ctrl_c_twice_ends_a_deaf_worker_too_and_leaves_nothing(tmp_path):
    body = """
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        open(folder + "/half.ply", "w").write("x")
        emit("status", stage="geometry", message=str(os.getpid()))
        time.sleep(60)
    """
    process = start_run(tmp_path / "worker", body, "--json", out=tmp_path / "out")
    assert process.stdout is not None
    process.stdout.readline()
    worker = int(json.loads(process.stdout.readline())["message"])
    process.send_signal(signal.SIGINT)
    time.sleep(0.3)  # the worker has 1.2 s
    for _ in range(3):
        process.send_signal(signal.SIGINT)
        time.sleep(0.1)
    out, said = process.communicate(timeout=SOON)
    assert process.returncode == 130, said
    assert json.loads(out.splitlines()[-1])["message"] == "cancelled; nothing was written"
    assert "Traceback" not in said
    assert ends(worker)
    assert not (tmp_path / "out").exists()


@POSIX
def test_a_run_whose_reader_has_gone_is_cancelled(tmp_path):
    body = """
        emit("status", stage="geometry", message=str(os.getpid()))
        for i in range(600): emit("status", stage="geometry", message="on"), time.sleep(0.1)
    """
    process = start_run(tmp_path / "worker", body, "--json", out=tmp_path / "out")
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.readline()
    worker = int(json.loads(process.stdout.readline())["message"])
    process.stdout.close()
    assert process.wait(timeout=SOON) == 130
    assert process.stderr.read() == ""
    assert ends(worker)
    assert not (tmp_path / "out").exists()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
@pytest.mark.parametrize(
    "command",
    [
        ["run.py", "photos", "--no-blend", "--json"],
        ["turntable.py", "batch.toml", "--json", "--dry-run"],
        ["turntable.py", "unusable.toml", "--json"],
    ],
)
def test_events_on_a_full_disk_end_the_work_without_a_traceback(tmp_path, command):
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "1.jpg").touch()
    (tmp_path / "batch.toml").write_text("[[items]]\ncapture = 'photos'\n")
    (tmp_path / "unusable.toml").write_text("[[items]]\nrun = 'nowhere'\n")
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, str(ROOT / "scripts" / command[0]), *command[1:], "--out", "out"],
            cwd=tmp_path,
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
        )
    assert done.returncode in (2, 130)
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "out").exists()


def test_a_reader_who_has_gone_when_all_is_done_does_not_make_it_a_failure():
    def gone(event):
        if event["event"] == "result":
            raise Cancelled

    assert in_console(lambda listen: {"out": "run"}, gone) == 0


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="looks at processes in /proc")
def test_a_worker_ends_with_the_program_that_started_it(tmp_path):
    starter = """
        import time
        from cvdgs.core.runtime.process import Job, WORKER
        import sys
        job = Job([sys.executable, "-c", FOLLOWER])
        for event in job.events():
            print(event["process"], flush=True)
    """
    follower = """
        import json, os, time
        from cvdgs.core.runtime.process import follow_parent
        follow_parent(lambda: os._exit(7))
        print(json.dumps({"event": "started", "process": os.getpid()}), flush=True)
        time.sleep(60)
    """
    code = f"FOLLOWER = {textwrap.dedent(follower)!r}\n{textwrap.dedent(starter)}"
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    worker = int(process.stdout.readline())
    process.kill()
    process.wait()
    assert ends(worker)


def test_two_runs_into_one_folder_are_kept_apart_and_the_first_one_succeeds(tmp_path):
    out, go_on = tmp_path / "out", tmp_path / "go on"
    body = f"""
        emit("status", stage="geometry", message="")
        while not os.path.exists({str(go_on)!r}): time.sleep(0.02)
        emit("result", report=REPORT)
    """
    first = start_run(tmp_path / "worker", body, "--json", out=out)
    assert first.stdout is not None
    first.stdout.readline(), first.stdout.readline()
    with pytest.raises(InputError, match="another run is writing here - wait for it, or choose another"):
        run(Settings("photos", str(out), blend=False), lambda _: None, Workers(sys.executable))
    go_on.touch()
    first.communicate(timeout=SOON)
    assert first.returncode == 0
    assert sorted(path.name for path in out.iterdir()) == ["report.html", "report.json", "run.log"]


def test_the_next_run_says_what_it_did_about_one_that_was_killed_while_it_put_its_results_in_place(tmp_path):
    out = tmp_path / "out"
    (out / ".complete").mkdir(parents=True)
    (out / ".complete" / "report.json").write_text(json.dumps(REPORT))
    process = start_run(tmp_path / "worker", "emit('result', report=REPORT)", "--json", out=out)
    said, _ = process.communicate(timeout=SOON)
    warnings = [json.loads(line) for line in said.splitlines() if '"warning"' in line]
    assert [warning["name"] for warning in warnings] == ["interrupted-run"]
    assert "they are now complete" in warnings[0]["message"]


WALL_CLOCK = re.compile(r"\btime\.time(_ns)?\(|\bdatetime\.(now|utcnow)\(")


def test_no_duration_comes_from_a_clock_that_somebody_may_set():
    files = [path for folder in PACKAGE for path in sorted((ROOT / folder).rglob("*.py"))]
    assert not [path.name for path in files if WALL_CLOCK.search(path.read_text(encoding="utf-8"))]
