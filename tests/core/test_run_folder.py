"""The output folder: an earlier result stays whole until the new one is complete."""

import subprocess
import sys

import pytest

from cvdgs.core.errors import InputError
from cvdgs.core.run_folder import RunFolder


def test_results_appear_only_when_committed(tmp_path):
    folder = RunFolder(tmp_path / "out")
    (folder.staging / "report.json").write_text("new")
    assert not (tmp_path / "out" / "report.json").exists()
    folder.commit()
    assert (tmp_path / "out" / "report.json").read_text() == "new"
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["report.json"]


def test_an_aborted_run_leaves_the_earlier_result_untouched(tmp_path):
    (tmp_path / "report.json").write_text("old")
    folder = RunFolder(tmp_path)
    (folder.staging / "report.json").write_text("new")
    folder.abort()
    assert [p.name for p in tmp_path.iterdir()] == ["report.json"]
    assert (tmp_path / "report.json").read_text() == "old"


def test_an_aborted_run_removes_the_folders_that_it_made(tmp_path):
    RunFolder(tmp_path / "a" / "b").abort()
    assert list(tmp_path.iterdir()) == []


def test_a_new_result_replaces_all_of_the_old_one_and_nothing_else(tmp_path):
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
        "import os, sys; from cvdgs.core.run_folder import RunFolder; f = RunFolder(sys.argv[1]);"
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


def test_another_job_says_what_it_replaces(tmp_path):
    (tmp_path / "report.json").write_text("of a run")
    (tmp_path / "old.png").write_text("ours")
    folder = RunFolder(tmp_path, lambda out: [out / "old.png"], "table.csv")
    (folder.staging / "new.png").write_text("new")
    folder.commit()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["new.png", "report.json"]


def test_a_run_that_adds_starts_from_a_copy_of_the_earlier_one(tmp_path):
    (tmp_path / "report.json").write_text("old")
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
