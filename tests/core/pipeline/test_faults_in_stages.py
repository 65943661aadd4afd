"""Real runs whose worker, Blender or disk fails in every stage: an earlier result stays as it was, byte for byte.

`test_faults.py` has what stand-ins can show.
"""

from __future__ import annotations

import hashlib
import importlib.util
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from cvdgs.core.runtime.process import ROOT

from ...few_views import write_few_views
from ...patience import SOON

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(1200),
    pytest.mark.skipif(sys.platform != "linux", reason="looks at processes in /proc"),
]

HAS_BLENDER = importlib.util.find_spec("bpy") is not None
STAGES = ["capture", "enhance", "geometry", "layers", "evaluate", *(("blender", "turntable") if HAS_BLENDER else ())]
OPTIONS = ("--max-size", "64", "--iterations", "60", "--gaussians", "500")
BLENDER_OPTIONS = ("--turntable", "8") if HAS_BLENDER else ("--no-blend",)
VIEWS = 8
DISK_MB = 64
NEEDS_MOUNTS = pytest.mark.skipif(os.geteuid() != 0, reason="mounting a small disk needs root")

Fault = Callable[[subprocess.Popen], None]


def start(capture: Path, out: Path, *options: str, **environment: str) -> subprocess.Popen:
    script = str(ROOT / "scripts" / "run.py")
    return subprocess.Popen(
        [sys.executable, script, str(capture), "--out", str(out), "--json", *OPTIONS, *options],
        env={**os.environ, "CVDGS_PYTHON": sys.executable, **environment},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def run_into(fault: Fault, stage: str, process: subprocess.Popen) -> dict:
    """Let the fault happen when the run is in `stage`; returns the run's last event."""
    last, happened = {}, False
    for line in process.stdout:
        last = json.loads(line)
        if last.get("stage") == stage and not happened:
            happened = True
            fault(process)
    process.wait()
    assert happened
    assert "Traceback" not in process.stderr.read()
    return last


def succeed(process: subprocess.Popen) -> None:
    out, said = process.communicate()
    assert process.returncode == 0, out[-500:] + said


def children(process: int) -> list[int]:
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text().rpartition(")")[2].split()
        except (FileNotFoundError, ProcessLookupError):
            continue
        if fields[0] != "Z" and int(fields[1]) == process:
            found.append(int(path.parent.name))
    return found


def kill_worker(process: subprocess.Popen) -> None:
    while not (workers := children(process.pid)):  # on a busy machine, the next one may have its turn already
        assert process.poll() is None
        time.sleep(0.01)
    os.kill(workers[0], signal.SIGKILL)


def state_of(folder: Path) -> dict[str, str]:
    """Digest of every file."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


@pytest.fixture(scope="module")
def capture(tmp_path_factory) -> Path:
    """A few of the demo's views."""
    return write_few_views(tmp_path_factory.mktemp("photographs"), VIEWS)


@pytest.fixture(scope="module")
def finished(capture, tmp_path_factory) -> Path:
    """A run that succeeded."""
    out = tmp_path_factory.mktemp("run") / "out"
    succeed(start(capture, out, "--seed", "1", *BLENDER_OPTIONS))
    return out


@pytest.fixture
def disk(tmp_path) -> Iterator[Path]:
    """A file system of its own, of a few megabytes."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", f"size={DISK_MB}m", "tmpfs", str(folder)]
    if subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("no permission to mount")
    yield folder
    subprocess.run(["umount", "-l", str(folder)], check=False)


@pytest.mark.parametrize("stage", STAGES)
def test_a_worker_killed_in_any_stage_leaves_the_earlier_result(stage, capture, finished, tmp_path):
    out = shutil.copytree(finished, tmp_path / "out")
    before = state_of(out)
    last = run_into(kill_worker, stage, process := start(capture, out, *BLENDER_OPTIONS))
    assert process.returncode == 1
    assert last["kind"] == "defect"
    assert "the worker was killed during" in last["message"]
    assert str(out / "failed.run.log") in last["message"]
    (out / "failed.run.log").unlink()
    assert state_of(out) == before


@NEEDS_MOUNTS
@pytest.mark.parametrize("stage", STAGES)
def test_a_disk_that_is_full_in_any_stage_leaves_the_earlier_result(stage, capture, finished, disk):
    out = shutil.copytree(finished, disk / "out")
    before, filler = state_of(out), disk / "filler"

    def fill(_process: subprocess.Popen) -> None:
        with open(filler, "wb", buffering=0) as file:
            size = 1 << 20
            while size:
                try:
                    file.write(bytes(size))
                except OSError:
                    size //= 2  # there may be room for less

    last = run_into(fill, stage, process := start(capture, out, *BLENDER_OPTIONS))
    assert process.returncode == 2, last
    assert last["kind"] == "input"
    assert "space" in last["message"]
    assert state_of(out) == before


@pytest.mark.parametrize("stage", ["geometry", STAGES[-1]])
def test_a_run_that_is_killed_itself_ends_its_worker_and_running_again_completes_it(stage, capture, finished, tmp_path):
    out = shutil.copytree(finished, tmp_path / "out")
    before, workers = state_of(out), []

    def kill(process: subprocess.Popen) -> None:
        workers.extend(children(process.pid))
        process.kill()

    run_into(kill, stage, start(capture, out, *BLENDER_OPTIONS))
    deadline = time.monotonic() + SOON
    while any(Path(f"/proc/{worker}").exists() for worker in workers) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert workers
    assert not any(Path(f"/proc/{worker}").exists() for worker in workers)
    left = {name: digest for name, digest in state_of(out).items() if not name.startswith((".partial/", ".lock"))}
    assert left == before
    succeed(start(capture, out, *BLENDER_OPTIONS))
    assert not [path.name for path in out.iterdir() if path.name.startswith(".")]
    assert json.loads((out / "report.json").read_text())["settings"]["seed"] == 0


def test_resuming_after_a_kill_adds_the_layer(capture, finished, tmp_path):
    out = shutil.copytree(finished, tmp_path / "out")
    before, added = state_of(out), ("--resume", "--cvd", "tritan", "--no-blend")
    # --resume takes the run's own options, so those of `start` have to be the same.
    run_into(kill_worker, "layers", start(capture, out, *added))
    (out / "failed.run.log").unlink()
    assert state_of(out) == before
    succeed(start(capture, out, *added))
    assert set(json.loads((out / "report.json").read_text())["layers"]) == {"deutan-1.0", "tritan-1.0"}
    assert state_of(out)["splats.ply"] == before["splats.ply"]


@NEEDS_MOUNTS
def test_photographs_on_a_read_only_disk_and_an_output_on_another_one_are_enough(capture, disk, tmp_path):
    photographs, scratch = tmp_path / "photographs", tmp_path / "scratch"
    photographs.mkdir()
    scratch.mkdir()
    for options in (["--bind", str(capture)], ["-o", "remount,ro,bind"]):
        if subprocess.run(["mount", *options, str(photographs)], capture_output=True).returncode:
            pytest.skip("no permission to mount")
    try:
        with pytest.raises(OSError, match="Read-only"):
            (photographs / "file").touch()
        assert (disk.stat().st_dev) != scratch.stat().st_dev
        succeed(start(photographs, disk / "out", "--no-blend", TMPDIR=str(scratch)))
        assert (disk / "out" / "report.json").is_file()
        assert list(scratch.glob("cvdgs*")) == []  # torch makes a folder of its own
    finally:
        subprocess.run(["umount", "-l", str(photographs)], check=False)
