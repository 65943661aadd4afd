"""The output folder: an earlier result stays whole until the new one is complete."""

import errno
import json
import os
import signal
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from cvdgs.core.errors import InputError
from cvdgs.core.runs import folder as run_folder
from cvdgs.core.runs.folder import RunFolder
from cvdgs.core.runs.report import SCHEMA

OLD_REPORT = json.dumps({"schema": SCHEMA})


def test_results_appear_only_when_committed(tmp_path):
    folder = RunFolder(tmp_path / "out")
    (folder.staging / "report.json").write_text("new")
    assert not (tmp_path / "out" / "report.json").exists()
    folder.commit()
    assert (tmp_path / "out" / "report.json").read_text() == "new"
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["report.json"]


def test_an_aborted_run_leaves_the_earlier_result_untouched(tmp_path):
    (tmp_path / "report.json").write_text(OLD_REPORT)
    folder = RunFolder(tmp_path)
    (folder.staging / "report.json").write_text("new")
    folder.abort()
    assert [p.name for p in tmp_path.iterdir()] == ["report.json"]
    assert (tmp_path / "report.json").read_text() == OLD_REPORT


def test_an_aborted_run_removes_the_folders_that_it_made(tmp_path):
    RunFolder(tmp_path / "a" / "b").abort()
    assert list(tmp_path.iterdir()) == []


def test_a_new_result_replaces_all_of_the_old_one_and_nothing_else(tmp_path):
    (tmp_path / "report.json").write_text(OLD_REPORT)
    (tmp_path / "splats.protan-1.0.ply").write_text("old layer")
    (tmp_path / "renders").mkdir()
    (tmp_path / "renders" / "old.png").write_text("old")
    (tmp_path / "notes.txt").write_text("the artist's own")
    folder = RunFolder(tmp_path)
    (folder.staging / "renders").mkdir()
    (folder.staging / "renders" / "new.png").write_text("new")
    folder.commit()
    assert sorted(p.relative_to(tmp_path).as_posix() for p in tmp_path.rglob("*")) == [
        "notes.txt",
        "renders",
        "renders/new.png",
    ]


def test_files_called_like_those_of_a_layer_stay_where_no_layer_has_that_name(tmp_path):
    own = ["splats.subject.ply", "splats.deutan-mine.ply", "layer.mine.cube", "layer.deutan-2.0.safetensors"]
    layers = ["splats.deutan-1.0.ply", "layer.protan-0.65.cube", "layer.tritan-1e-05.safetensors"]
    write(tmp_path, {"report.json": OLD_REPORT, **dict.fromkeys(own + layers, "old")})
    folder = RunFolder(tmp_path)
    folder.carry_over()
    assert sorted(files_in(folder.staging)) == sorted(["report.json", *layers])
    folder.abort()
    folder = RunFolder(tmp_path)
    write(folder.staging, NEW)
    folder.commit()
    assert files_in(tmp_path) == NEW | dict.fromkeys(own, "old")


@pytest.mark.parametrize("name", ["capture/IMG_1.jpg", "scene.blend", "layer.deutan-1.0.cube", "report.json"])
def test_files_that_no_run_has_made_are_never_replaced(tmp_path, name):
    write(tmp_path, {name: "the artist's own"})
    with pytest.raises(InputError, match="was not made by an earlier run - choose another folder with --out"):
        RunFolder(tmp_path)
    assert files_in(tmp_path) == {name: "the artist's own"}


def test_files_that_came_during_the_run_are_not_replaced_either(tmp_path):
    folder = RunFolder(tmp_path)
    write(folder.staging, NEW)
    write(tmp_path, {"scene.blend": "the artist's own"})
    with pytest.raises(InputError, match=r"scene\.blend"):
        folder.commit()
    folder.abort()
    assert files_in(tmp_path) == {"scene.blend": "the artist's own"}


def test_a_log_can_be_kept_from_a_failed_run(tmp_path):
    folder = RunFolder(tmp_path / "out")
    (folder.staging / "run.log").write_text("why")
    assert folder.abort(keep="run.log") == tmp_path / "out" / "failed.run.log"
    assert (tmp_path / "out" / "failed.run.log").read_text() == "why"


def test_two_runs_into_one_folder_are_kept_apart(tmp_path):
    first = RunFolder(tmp_path)
    with pytest.raises(InputError, match="another run"):
        RunFolder(tmp_path)
    first.abort()
    RunFolder(tmp_path).abort()


def test_a_run_that_was_killed_does_not_block_the_next(tmp_path):
    code = (
        "import os, sys; from cvdgs.core.runs.folder import RunFolder; f = RunFolder(sys.argv[1]);"
        "open(f.staging / 'half', 'w').write('x'); os.kill(os.getpid(), 9)"
    )
    subprocess.run([sys.executable, "-c", code, str(tmp_path)], check=False)
    assert (tmp_path / ".partial" / "half").exists()
    RunFolder(tmp_path).abort()
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_written_is_refused_in_one_line(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="--out"):
        RunFolder(tmp_path / "file" / "out")


def test_a_folder_whose_name_is_too_long_is_refused_in_one_line(tmp_path):
    with pytest.raises(InputError, match="cannot be written to"):
        RunFolder(tmp_path / ("a" * 300))


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere no name is anything but UTF-8")
@pytest.mark.parametrize("inside", ["", "out"])
def test_a_folder_whose_path_is_not_utf_8_is_refused_in_one_line(tmp_path, inside):
    with pytest.raises(InputError, match=r"\\udcfcro.*: its path is not UTF-8 - rename the folder, or choose another"):
        RunFolder(tmp_path / os.fsdecode(b"b\xfcro") / inside)
    assert list(tmp_path.iterdir()) == []


def test_another_job_says_what_it_replaces(tmp_path):
    (tmp_path / "report.json").write_text("of a run")
    (tmp_path / "old.png").write_text("ours")
    folder = RunFolder(tmp_path, lambda out: [out / "old.png"], "table.csv")
    (folder.staging / "new.png").write_text("new")
    folder.commit()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["new.png", "report.json"]


def test_a_link_is_copied_as_a_link_and_ends_a_cycle(tmp_path):
    (tmp_path / "report.json").write_text(OLD_REPORT)
    (tmp_path / "renders" / "original").mkdir(parents=True)
    (tmp_path / "renders" / "original" / "again").symlink_to("..", target_is_directory=True)
    folder = RunFolder(tmp_path)
    folder.carry_over()
    assert (folder.staging / "renders" / "original" / "again").readlink() == Path("..")
    folder.abort()


def test_a_run_can_be_added_to_although_its_files_are_read_only(tmp_path):
    published = tmp_path / "published"
    (published / "capture" / "images").mkdir(parents=True)
    files = [Path("report.json"), Path("run.log"), Path("capture/images/0.png")]
    for file in files:
        (published / file).write_text(OLD_REPORT)
        (published / file).chmod(0o444)
    folder = RunFolder(tmp_path / "out")
    folder.carry_over(published)
    assert [stat.filemode((folder.staging / file).stat().st_mode) for file in files] == ["-rw-r--r--"] * 3
    assert stat.filemode((published / "report.json").stat().st_mode) == "-r--r--r--"
    folder.abort()


@pytest.mark.parametrize("file", ["scene.blend", "capture/images/0.png"])
def test_what_the_system_says_is_passed_on_where_a_run_cannot_be_copied(tmp_path, file):
    path = tmp_path / "out" / file
    path.parent.mkdir(parents=True)
    path.write_bytes(bytes(200_000))
    (tmp_path / "out" / "report.json").write_text(OLD_REPORT)
    program = """
import resource, signal, sys
from cvdgs.core.runs.folder import RunFolder
from cvdgs.core.runtime.supervisor import all_or_nothing
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))
folder = RunFolder(sys.argv[1])
with all_or_nothing(folder, "out", "run.log"):
    folder.carry_over()
"""
    found = subprocess.run([sys.executable, "-c", program, str(tmp_path / "out")], capture_output=True, text=True)
    assert "InputError: out: cannot be written to (File too large) - free space or choose another" in found.stderr
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == sorted({"report.json", file.split("/")[0]})


def test_a_run_that_adds_starts_from_a_copy_of_the_earlier_one(tmp_path):
    (tmp_path / "report.json").write_text(OLD_REPORT)
    (tmp_path / "splats.protan-1.0.ply").write_text("layer")
    (tmp_path / "notes.txt").write_text("the artist's own")
    (tmp_path / "renders" / "original").mkdir(parents=True)
    (tmp_path / "renders" / "original" / "a.png").write_text("a")
    folder = RunFolder(tmp_path)
    folder.carry_over()
    (folder.staging / "report.json").write_text("extended")
    (folder.staging / "renders" / "original" / "a.png").write_text("changed")
    assert (tmp_path / "renders" / "original" / "a.png").read_text() == "a"
    assert not (folder.staging / "notes.txt").exists()
    folder.commit()
    assert (tmp_path / "report.json").read_text() == "extended"
    assert (tmp_path / "splats.protan-1.0.ply").read_text() == "layer"
    assert (tmp_path / "notes.txt").read_text() == "the artist's own"


OLD = {"report.json": OLD_REPORT, "splats.protan-1.0.ply": "old layer", "renders/old.png": "old"}
NEW = {"report.json": json.dumps({"schema": SCHEMA, "gaussians": 1}), "splats.ply": "new", "renders/new.png": "new"}
CHANGES_THE_DISK = ("os.rename", "os.rmdir", "os.remove", "os.mkdir")


def write(folder: Path, files: dict[str, str]) -> None:
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)


def files_in(folder: Path) -> dict[str, str]:
    return {p.relative_to(folder).as_posix(): p.read_text() for p in folder.rglob("*") if p.is_file()}


def commit_and_be_killed(out: Path, survived: int) -> bool:
    """Let a process replace the files of `OLD` by those of `NEW`; whether it was killed before a change of the disk."""
    process = os.fork()
    if process == 0:
        try:
            folder = RunFolder(out)
            write(folder.staging, NEW)
            left = survived

            def watch(event: str, _arguments: object) -> None:
                nonlocal left
                if event in CHANGES_THE_DISK:
                    if left == 0:
                        os.kill(os.getpid(), signal.SIGKILL)
                    left -= 1

            sys.addaudithook(watch)
            folder.commit()
        finally:
            os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]) == -signal.SIGKILL


@pytest.mark.skipif(not hasattr(os, "fork"), reason="processes are killed by a signal")
def test_a_run_killed_while_it_replaces_a_result_leaves_the_old_one_or_the_new_one(tmp_path):
    seen = []
    for survived in range(100):
        out = tmp_path / str(survived)
        write(out, OLD)
        killed = commit_and_be_killed(out, survived)
        # A folder without the file that vouches for the others is not taken for a result.
        half = {name: text for name, text in files_in(out).items() if not name.startswith(".")}
        assert half in (OLD, NEW) or "report.json" not in half
        folder = RunFolder(out)
        found = {name: text for name, text in files_in(out).items() if name != ".lock"}
        folder.abort()
        assert found in (OLD, NEW)
        assert files_in(out) == found
        assert bool(folder.mended) or half == found
        seen.append(found == NEW)
        if not killed:
            break
    assert seen == sorted(seen)  # once the new result is there, it stays
    assert not seen[0]
    assert seen[-1]
    assert len(seen) > 8


@pytest.mark.parametrize("failing", range(7))
def test_a_result_that_cannot_be_replaced_stays_as_it_was(tmp_path, monkeypatch, failing):
    write(tmp_path, OLD)
    folder = RunFolder(tmp_path)
    write(folder.staging, NEW)
    rename, calls = os.replace, []

    def fail_once(source, target):
        calls.append(source)
        if len(calls) == failing + 1:
            raise OSError(errno.EBUSY, "Device or resource busy")
        rename(source, target)

    monkeypatch.setattr(os, "replace", fail_once)
    with pytest.raises(OSError, match="busy"):
        folder.commit()
    folder.abort()
    assert files_in(tmp_path) == OLD


def test_a_lock_that_a_finished_run_has_removed_keeps_nobody_out(tmp_path, monkeypatch):
    first = RunFolder(tmp_path)
    take, removed = run_folder.lock_exclusively, []

    def finish_meanwhile(file):
        if not removed:
            first.abort()  # between the opening of the lock file and its locking
            removed.append(file)
        take(file)

    monkeypatch.setattr(run_folder, "lock_exclusively", finish_meanwhile)
    second = RunFolder(tmp_path)
    monkeypatch.undo()
    with pytest.raises(InputError, match="another run"):
        RunFolder(tmp_path)
    second.abort()


def test_a_run_that_may_not_take_the_lock_leaves_the_other_ones_files(tmp_path, monkeypatch):
    first = RunFolder(tmp_path)
    (first.staging / "splats.ply").write_text("new")

    def refuse(_file):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(run_folder, "lock_exclusively", refuse)
    with pytest.raises(InputError, match="No locks available"):
        RunFolder(tmp_path)
    assert (first.staging / "splats.ply").exists()
