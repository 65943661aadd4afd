"""Other programs: OpenSplat, by a stand-in that hands back a scene that is there already."""

import json
import stat
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cvdgs.core.capture.model import Capture
from cvdgs.core.errors import InputError
from cvdgs.core.runtime.protocol import Reporter
from cvdgs.core.splats.io.ply import write_ply
from cvdgs.scripts.benchmarks.studies.captures import Subject
from cvdgs.scripts.benchmarks.studies.peers import OpenSplatRun, opensplat_runs, train_opensplat

from ....core.splats.training.test_trainer import photographs, wall

HOLDOUT = 4
RUNS = opensplat_runs()
SHORT = OpenSplatRun("short", 60, measured=2)


@pytest.fixture(scope="module")
def subject() -> Subject:
    """Photographs of a scene of known Gaussians; two of eight are held out."""
    scene = wall(300)
    views = tuple(replace(view, source=Path("wall")) for view in photographs(scene, 8))
    capture = Capture(Path("wall"), "test", views, scene.means, np.full((300, 3), 128, np.uint8))
    return Subject.of(capture, HOLDOUT)


def program(folder: Path, script: str) -> Path:
    """An executable; OpenSplat's arguments are CAPTURE --output SCENE and more."""
    path = folder / "opensplat"
    path.write_text(f"#!/bin/sh\n{script}\n", encoding="utf-8")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return path


def stand_in_of(folder: Path, version: str, options: str) -> Path:
    """A program of that version with these options, which saves half a scene as often as it is told, then one."""
    true = wall(300)
    write_ply(folder / "true.ply", true)
    write_ply(folder / "half.ply", true.take(np.arange(300) < 150))
    about = f'case "$1" in --help) echo "{options}"; exit;; --version) echo "{version}"; exit;; esac'
    note = f'echo "$@" >> "{folder}/arguments"; cp "$1/transforms.json" "{folder}"'
    every = 'all="$*"; every="${all#*--save-every }"; every="${every%% *}"'
    half = f'[ $((n % every)) -gt 0 ] || cp "{folder}/half.ply" "${{3%.ply}}_$n.ply"'
    steps = f'{every}; n=0; while [ $((n += 10)) -le "$5" ]; do echo "Step $n: 0.1"; {half}; done'
    return program(folder, f'{about}; {note}; {steps}; cp "{folder}/true.ply" "$3"')


@pytest.fixture
def stand_in(tmp_path: Path) -> Path:
    return stand_in_of(tmp_path, "1.2.0 (git commit 2947938)", "--center --cpu")


def test_a_scene_in_the_capture_s_coordinates_is_judged_by_the_held_out_views(subject, stand_in):
    (found,) = train_opensplat(stand_in, "wall", subject, Reporter(), [SHORT])
    assert (found.trial.label, found.trial.gaussians, found.trial.iterations) == ("OpenSplat 1.2.0, short", 300, 60)
    assert found.trial.psnr > 40.0  # the photographs are of that very scene
    assert found.trial.geometry_seconds > 0.0


def test_scenes_on_the_way_are_judged_too_and_in_the_order_of_time(subject, stand_in):
    (found,) = train_opensplat(stand_in, "wall", subject, Reporter(), [SHORT])
    times = [point.processor_seconds for point in found.curve]
    assert len(times) == 3
    assert times == sorted(times)
    assert found.curve[0].psnr < found.curve[-1].psnr == found.trial.psnr


def test_scenes_are_measured_at_steps_that_the_program_says_whatever_the_length_of_the_run(subject, stand_in):
    (found,) = train_opensplat(stand_in, "wall", subject, Reporter(), [OpenSplatRun("odd", 333)])
    assert len(found.curve) == 5


def test_a_scene_that_was_not_saved_on_the_way_is_an_error(subject, tmp_path):
    write_ply(tmp_path / "true.ply", wall(300))
    silent = program(tmp_path, f'[ "$1" = --help ] || [ "$1" = --version ] || cp "{tmp_path}/true.ply" "$3"')
    with pytest.raises(InputError, match="did not say and save step 20 of 60"):
        train_opensplat(silent, "wall", subject, Reporter(), [SHORT])


def test_held_out_views_are_kept_from_it(subject, stand_in):
    train_opensplat(stand_in, "wall", subject, Reporter(), RUNS)
    given = json.loads((stand_in.parent / "transforms.json").read_text(encoding="utf-8"))
    names = {Path(frame["file_path"]).stem for frame in given["frames"]}
    assert names == {subject.given.views[i].key for i in subject.split.train}
    calls = (stand_in.parent / "arguments").read_text(encoding="utf-8").splitlines()
    assert len(calls) == len(RUNS)
    for call, run in zip(calls, RUNS, strict=True):
        assert set(run.options) <= set(call.split())


@pytest.mark.parametrize(("options", "keeps"), [("--keep-crs --cpu", True), ("--center --cpu", False)])
def test_a_scene_stays_where_the_cameras_are_whatever_the_version(subject, tmp_path, options, keeps):
    train_opensplat(stand_in_of(tmp_path, "1", options), "wall", subject, Reporter(), [SHORT])
    (call,) = (tmp_path / "arguments").read_text(encoding="utf-8").splitlines()
    assert ("--keep-crs" in call) == keeps
    assert "--center" not in call


def test_a_program_that_fails_is_quoted(subject, tmp_path):
    with pytest.raises(InputError, match="out of memory"):
        train_opensplat(program(tmp_path, "echo out of memory >&2; exit 1"), "wall", subject, Reporter(), [SHORT])


def test_a_program_that_is_not_there_is_said_in_one_line(subject, tmp_path):
    with pytest.raises(InputError, match="cannot be run"):
        train_opensplat(tmp_path / "nowhere", "wall", subject, Reporter(), [SHORT])
