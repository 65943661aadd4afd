"""Cameras that are a little off, and their lens, through a whole run: corrected for all that follows."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cvdgs.core.capture.model import Capture
from cvdgs.core.capture.normalised import write_capture
from cvdgs.core.capture.reader import read_capture
from cvdgs.core.capture.source import OPENGL_TO_OPENCV
from cvdgs.core.demo import SHOWROOM

from ..capture.test_view_matches import turned
from .test_run import run


def degrees_off(capture: Capture, truth: Capture) -> float:
    """Mean angle between the turns of the views, a turn of all of them together left out."""
    pairs = zip(capture.views, truth.views, strict=True)
    between = Rotation.from_matrix([a.world_to_camera[:3, :3].T @ b.world_to_camera[:3, :3] for a, b in pairs])
    return float(np.degrees((between.mean().inv() * between).magnitude().mean()))


def with_and_without_correction(folder: Path, *options: str) -> dict[str, dict[str, Any]]:
    """The reports of two runs on ``folder/given``, made in folders of their names beside it."""
    results = {}
    for name, more in (("plain", ("--no-refine-poses",)), ("corrected", ())):
        run(folder / "given", folder / name, *options, *more)
        results[name] = json.loads((folder / name / "report.json").read_text())
    return results


@pytest.mark.slow
@pytest.mark.parametrize(("degrees", "by"), [(0.5, "poses"), (3.0, "given_poses")], ids=["a-little", "a-lot"])
def test_a_run_on_cameras_that_are_off_corrects_them_and_keeps_the_corrected_ones(tmp_path, degrees, by):
    """A little along with the scene, a lot before it."""
    truth = read_capture(SHOWROOM, max_size=160)
    write_capture(turned(truth, degrees), tmp_path / "given")
    options = ("--iterations", "700", "--gaussians", "6000", "--sh-degree", "0")
    results = with_and_without_correction(tmp_path, *options)
    assert results["corrected"]["decision"][by].startswith("corrected")
    warned = {name: {warning["name"] for warning in report["warnings"]} for name, report in results.items()}
    assert "cameras-corrected" in warned["corrected"] - warned["plain"]
    kept = read_capture(tmp_path / "corrected" / "capture", max_size=None)
    given = read_capture(tmp_path / "given", max_size=None)
    assert degrees_off(kept, truth) < 0.6 * degrees_off(given, truth)
    psnr = {name: report["reconstruction"]["psnr"] for name, report in results.items()}
    assert psnr["corrected"] > psnr["plain"] + 0.5
    # The given poses are not held against it.
    run(tmp_path / "given", tmp_path / "corrected", "--resume", "--cvd", "tritan")


@pytest.mark.slow
def test_a_run_with_a_lens_that_is_off_corrects_it_and_keeps_the_corrected_one(tmp_path):
    truth = read_capture(SHOWROOM, max_size=160)
    write_capture(truth.zoomed(1.08), tmp_path / "given")
    options = ("--iterations", "300", "--gaussians", "6000", "--sh-degree", "0")
    results = with_and_without_correction(tmp_path, *options)
    assert results["corrected"]["decision"]["focal_length"].startswith("corrected")
    assert "focal_length" not in results["plain"]["decision"]
    warned = {name: {warning["name"] for warning in report["warnings"]} for name, report in results.items()}
    assert "lens-corrected" in warned["corrected"] - warned["plain"]
    kept = read_capture(tmp_path / "corrected" / "capture", max_size=None)
    assert kept.views[0].camera.fx == pytest.approx(truth.views[0].camera.fx, rel=0.01)
    psnr = {name: report["reconstruction"]["psnr"] for name, report in results.items()}
    assert psnr["corrected"] > psnr["plain"] + 0.3
    # The given lens is not held against it.
    run(tmp_path / "given", tmp_path / "corrected", "--resume", "--cvd", "tritan")


@pytest.mark.slow
def test_a_run_on_poses_of_another_convention_stands_upright_all_the_same(tmp_path):
    shutil.copytree(SHOWROOM, tmp_path / "given")
    file = tmp_path / "given" / "transforms.json"
    document = json.loads(file.read_text())
    for frame in document["frames"]:
        frame["transform_matrix"] = (np.array(frame["transform_matrix"]) @ OPENGL_TO_OPENCV).tolist()
    file.write_text(json.dumps(document))
    run(tmp_path / "given", tmp_path / "run", "--max-size", "120", "--iterations", "300", "--gaussians", "3000")
    report = json.loads((tmp_path / "run" / "report.json").read_text())
    assert "y and z of the cameras point the other way" in report["decision"]["given_poses"]
    truth = read_capture(SHOWROOM, max_size=120)
    assert truth.up is not None
    assert report["capture"]["up"] == pytest.approx(truth.up.direction.tolist())
    kept = read_capture(tmp_path / "run" / "capture", max_size=None)
    assert degrees_off(kept, truth) < 0.5
    assert report["reconstruction"]["psnr"] > 25.0
