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
from cvdgs.scripts.benchmarks.studies.peers import OPENSPLAT_RUNS, train_opensplat

from ....core.splats.training.test_trainer import photographs, wall

HOLDOUT = 4


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


@pytest.fixture
def stand_in(tmp_path: Path) -> Path:
    write_ply(tmp_path / "true.ply", wall(300))
    note = f'echo "$@" >> "{tmp_path}/arguments"; cp "$1/transforms.json" "{tmp_path}"'
    return program(tmp_path, f'{note}; cp "{tmp_path}/true.ply" "$3"')


def test_a_scene_in_the_capture_s_coordinates_is_judged_by_the_held_out_views(subject, stand_in):
    found = train_opensplat(stand_in, "wall", subject, Reporter(), OPENSPLAT_RUNS[:1])
    assert [(run.gaussians, run.iterations) for run in found] == [(300, 2000)]
    assert found[0].psnr > 40.0  # the photographs are of that very scene
    assert found[0].geometry_seconds > 0.0


def test_held_out_views_are_kept_from_it_and_its_scene_stays_where_the_cameras_are(subject, stand_in):
    train_opensplat(stand_in, "wall", subject, Reporter(), OPENSPLAT_RUNS)
    given = json.loads((stand_in.parent / "transforms.json").read_text(encoding="utf-8"))
    names = {Path(frame["file_path"]).stem for frame in given["frames"]}
    assert names == {subject.given.views[i].key for i in subject.split.train}
    calls = (stand_in.parent / "arguments").read_text(encoding="utf-8").splitlines()
    assert len(calls) == len(OPENSPLAT_RUNS)
    assert all("--keep-crs" in call and "--cpu" in call for call in calls)


def test_a_program_that_fails_is_quoted(subject, tmp_path):
    with pytest.raises(InputError, match="out of memory"):
        train_opensplat(program(tmp_path, "echo out of memory >&2; exit 1"), "wall", subject, Reporter())


def test_a_program_that_is_not_there_is_said_in_one_line(subject, tmp_path):
    with pytest.raises(InputError, match="cannot be run"):
        train_opensplat(tmp_path / "nowhere", "wall", subject, Reporter())
