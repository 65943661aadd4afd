"""Reading a run folder: what is there, and what is refused in one line."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from cvdgs.core.errors import InputError
from cvdgs.core.runs.layout import CAMERAS_FILE, CAPTURE_FOLDER
from cvdgs.core.splats.io.ply import write_ply
from cvdgs.cvdgs_addon.scene.finished_run import read_run

from .scenes import CAMERA, cloud, ring_view


def edit_cameras(folder: Path, change) -> None:
    path = folder / CAPTURE_FOLDER / CAMERAS_FILE
    document = json.loads(path.read_text())
    change(document)
    path.write_text(json.dumps(document))


def test_a_run_is_read_whole(run_folder):
    run = read_run(run_folder)
    assert [view.key for view in run.views] == [f"view{index}" for index in range(5)]
    assert run.views[0].camera == CAMERA
    np.testing.assert_array_equal(run.views[0].camera_to_world, ring_view(0.0))
    assert list(run.layers) == ["deutan-1.0", "tritan-0.5"]
    np.testing.assert_allclose(run.layers["deutan-1.0"], 1.0 - run.gaussians.base_colors, atol=1e-6)
    assert run.background == (0.0, 0.0, 0.0)
    assert run.view("view3") is run.views[3]


def test_splats_that_no_layer_has_are_left_alone(run_folder):
    write_ply(run_folder / "splats.subject.ply", cloud(7))
    assert list(read_run(run_folder).layers) == ["deutan-1.0", "tritan-0.5"]


def test_cut_outs_were_trained_over_white(run_folder):
    header = b"\x89PNG\r\n\x1a\n" + bytes([0, 0, 0, 13]) + b"IHDR" + bytes(8) + bytes([8, 6])
    (run_folder / "capture" / "images" / "view2.png").write_bytes(header)
    assert read_run(run_folder).background == (1.0, 1.0, 1.0)


def test_photographs_outside_the_capture_are_not_opened(run_folder):
    header = b"\x89PNG\r\n\x1a\n" + bytes([0, 0, 0, 13]) + b"IHDR" + bytes(8) + bytes([8, 6])
    (run_folder / "secret.png").write_bytes(header)
    edit_cameras(run_folder, lambda document: document["frames"][0].update(file_path="../secret.png"))
    assert read_run(run_folder).background == (0.0, 0.0, 0.0)


def test_a_sequence_of_splats_is_refused_in_one_line(tmp_path):
    for number in range(3):
        write_ply(tmp_path / f"frame_{number}.ply", cloud(3))
    with pytest.raises(InputError, match=r"3 splat files \(frame_0\.ply, \.\.\.\), no run: sequences .* - choose"):
        read_run(tmp_path)


def test_a_missing_folder_or_file_is_named(run_folder, tmp_path):
    with pytest.raises(InputError, match="nowhere: no such folder"):
        read_run(tmp_path / "nowhere")
    (run_folder / "splats.ply").unlink()
    with pytest.raises(InputError, match=r"splats\.ply: no such file"):
        read_run(run_folder)
    shutil.rmtree(run_folder / "capture")
    with pytest.raises(InputError, match=r"transforms\.json: no such file"):
        read_run(run_folder)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (lambda document: document.pop("frames"), "not the cameras of a run"),
        (lambda document: document.update(frames=[]), "lists no cameras"),
        (lambda document: document["frames"][1].pop("fl_y"), "fl_y"),
        (lambda document: document["frames"][1].update(w=0), "'view1' has an impossible camera"),
        (lambda document: document["frames"][1].update(cx=float("nan")), "'view1' has an impossible camera"),
        (lambda document: document["frames"][1].update(transform_matrix=[[1.0]]), "'view1' has no rigid pose"),
        (
            lambda document: document["frames"][1].update(transform_matrix=np.diag([2.0, 1, 1, 1]).tolist()),
            "'view1' has no rigid pose",
        ),
        (
            lambda document: document["frames"][1].update(transform_matrix=np.diag([-1.0, 1, 1, 1]).tolist()),
            "'view1' has no rigid pose",
        ),
        (lambda document: document["frames"][1].update(file_path=None), "not the cameras of a run"),
    ],
)
def test_damaged_cameras_are_refused(run_folder, change, complaint):
    edit_cameras(run_folder, change)
    with pytest.raises(InputError, match=complaint):
        read_run(run_folder)


def test_a_camera_file_cut_in_the_middle_is_refused(run_folder):
    path = run_folder / CAPTURE_FOLDER / CAMERAS_FILE
    path.write_text(path.read_text()[:200])
    with pytest.raises(InputError, match="not valid JSON"):
        read_run(run_folder)


def test_a_layer_of_another_run_is_refused(run_folder):
    write_ply(run_folder / "splats.protan-1.0.ply", cloud(7))
    with pytest.raises(InputError, match=r"splats\.protan-1\.0\.ply: 7 Gaussians, but splats\.ply has 400"):
        read_run(run_folder)


def test_an_unknown_view_is_refused(run_folder):
    with pytest.raises(InputError, match=r"no view is called 'x'.*view0, view1, view2"):
        read_run(run_folder).view("x")
