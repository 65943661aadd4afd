"""The whole run up to Blender on the embedded demo at thumbnail size, most of it through the command line."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cvdgs.core.bootstrap import ROOT
from cvdgs.core.capture.reader import read_capture
from cvdgs.core.demo import SHOWROOM
from cvdgs.core.enhance import enhance_bytes, make_enhancer
from cvdgs.core.files.images import read_png
from cvdgs.core.pipeline import run as pipeline
from cvdgs.core.runs.report import SCHEMA
from cvdgs.core.runtime.protocol import Reporter
from cvdgs.core.settings import Layer, Settings
from cvdgs.core.splats.io.ply import read_ply

VIEWS = 40


def run(capture: Path, out: Path, *options: str, expect: int = 0) -> subprocess.CompletedProcess:
    command = [
        sys.executable,
        str(ROOT / "scripts" / "run.py"),
        str(capture),
        "--out",
        str(out),
        "--no-blend",
        *options,
    ]
    environment = {**os.environ, "CVDGS_PYTHON": sys.executable}
    result = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=240)
    assert result.returncode == expect, result.stderr
    assert "Traceback" not in result.stderr
    return result


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("run") / "out"
    run(SHOWROOM, out, "--max-size", "96", "--iterations", "80", "--gaussians", "3000",
        "--cvd", "deutan", "--cvd", "tritan", "--severity", "0.6")  # fmt: skip
    return out


@pytest.fixture(scope="module")
def report(finished) -> dict:
    return json.loads((finished / "report.json").read_text())


def test_everything_that_the_contract_names_is_there(finished):
    names = {path.name for path in finished.iterdir()}
    assert names == {
        "capture",
        "enhanced",
        "layer.deutan-0.6.cube",
        "layer.deutan-0.6.safetensors",
        "layer.tritan-0.6.cube",
        "layer.tritan-0.6.safetensors",
        "renders",
        "report.html",
        "report.json",
        "run.log",
        "splats.deutan-0.6.ply",
        "splats.ply",
        "splats.tritan-0.6.ply",
        "viewer.html",
    }
    for layer in ("deutan-0.6", "tritan-0.6"):
        assert len(list((finished / "enhanced" / layer).glob("*.png"))) == VIEWS
        assert len(list((finished / "renders" / layer).glob("*.png"))) == VIEWS // 8
        assert len(list((finished / "renders" / layer / "simulated").glob("*.png"))) == VIEWS // 8


def test_the_report_can_be_read_by_a_program(report):
    assert report["capture"] == {
        "format": "transforms", "views": VIEWS, "train": 35, "test": 5, "width": 96, "height": 72,
        "points": report["capture"]["points"],
        "up": [0.0, 0.0, 1.0], "up_from": "axis", "metres_per_unit": None, "estimate": None,
        "masks": {"views": 0, "share": 0.0},
    }  # fmt: skip
    assert set(report["seconds"]) == {"capture", "enhance", "geometry", "layers", "evaluate", "blender", "total"}
    assert report["peak_memory_mb"] > 100
    assert report["gaussians"] <= 3000
    for layer in report["layers"].values():
        assert {"psnr_to_enhanced", "ccpr", "ccpr_mean", "ssim_simulated", "naturalness", "rwe"} <= set(layer)
        assert layer["ccpr"]["tau"] == 6
        assert all(0.0 <= layer["ccpr"][kind] <= 1.0 for kind in ("input", "enhanced", "unenhanced", "rendered"))


def test_the_report_says_how_a_layer_and_the_geometry_came_about(report):
    assert all((layer["enhancer"], layer["strength"]) == ("scene", 1.0) for layer in report["layers"].values())
    assert {"gaussians", "steps", "sh_degree"} <= set(report["decision"])
    assert report["skipped_steps"] == 0


def test_the_layers_share_the_geometry_of_the_original(finished):
    original, layer = (read_ply(finished / name) for name in ("splats.ply", "splats.deutan-0.6.ply"))
    for name in ("means", "log_scales", "quaternions", "opacity_logits"):
        np.testing.assert_array_equal(getattr(original, name), getattr(layer, name))
    assert (original.sh[:, 0] != layer.sh[:, 0]).any()


def test_the_capture_in_the_result_is_a_capture(finished):
    again = read_capture(finished / "capture", max_size=None)
    original = read_capture(SHOWROOM, max_size=96)
    assert len(again.views) == VIEWS
    for first, second in zip(again.views, original.views, strict=True):
        np.testing.assert_allclose(first.world_to_camera, second.world_to_camera, atol=1e-8)
        np.testing.assert_array_equal(first.image, second.image)


def test_the_enhancement_helps_and_the_photographs_come_first(finished, report):
    ccpr = report["layers"]["deutan-0.6"]["ccpr"]
    assert ccpr["enhanced"] > ccpr["input"]
    before = read_png(next(iter(sorted((finished / "capture" / "images").glob("*.png")))))
    after = read_png(next(iter(sorted((finished / "enhanced" / "deutan-0.6").glob("*.png")))))
    assert 0.5 < np.abs(before.astype(float) - after).mean() < 40


def made(out: Path, layer: Layer, **options: Any) -> dict[str, Any]:
    """The report of a run of two steps on small photographs, in this process."""
    out.mkdir()
    settings = Settings(str(SHOWROOM), str(out), layers=(layer,), blend=False, max_size=64, iterations=2, **options)
    return pipeline.run(settings, out, Reporter())


def first_photograph(out: Path, layer: str) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """As it was given, and enhanced."""
    path = min((out / "capture" / "images").glob("*.png"))
    return read_png(path), read_png(out / "enhanced" / layer / path.name)


def test_severity_zero_leaves_the_photographs_as_they_are_and_no_view_need_be_held_out(tmp_path):
    report = made(tmp_path / "out", Layer("deutan", 0.0), holdout=0)
    for path in (tmp_path / "out" / "capture" / "images").glob("*.png"):
        np.testing.assert_array_equal(
            read_png(path), read_png(tmp_path / "out" / "enhanced" / "deutan-0.0" / path.name)
        )
    assert report["capture"]["test"] == 0
    assert "reconstruction" in report["notes"]


def test_the_trained_network_enhances_a_run_too(tmp_path):
    made(tmp_path / "out", Layer("protan", 1.0), enhancer="cgan")
    photograph, enhanced = first_photograph(tmp_path / "out", "protan-1.0")
    assert 0.5 < np.abs(photograph.astype(float) - enhanced).mean() < 40
    assert list((tmp_path / "out").glob("*.cube"))  # what a table alone can do


def test_a_network_fitted_to_the_scene_is_kept_in_the_run_and_enhances_its_photographs_again(tmp_path):
    out = tmp_path / "out"
    made(out, Layer("tritan", 1.0), enhancer="scene", change_budget=2.0)
    assert (out / "layer.tritan-1.0.cube").is_file()
    enhancer = make_enhancer(str(out / "layer.tritan-1.0.safetensors"), "tritan", 1.0)
    assert enhancer.fitted.budget == 2.0
    photograph, enhanced = first_photograph(out, "tritan-1.0")
    np.testing.assert_array_equal(enhance_bytes(enhancer, photograph[..., :3]), enhanced)
    assert np.abs(photograph.astype(float) - enhanced).mean() > 0.5


def test_an_empty_folder_is_one_line_and_exit_code_2(tmp_path):
    (tmp_path / "empty").mkdir()
    result = run(tmp_path / "empty", tmp_path / "out", expect=2)
    assert "empty" in result.stderr.splitlines()[-1]
    assert not (tmp_path / "out").exists()


@pytest.mark.skipif(sys.platform != "linux" or os.geteuid() != 0, reason="mounting a small disk needs root on Linux")
def test_a_full_disk_is_one_line_and_exit_code_2_and_the_earlier_result_stays(tmp_path):
    disk = tmp_path / "disk"
    disk.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=600k", "tmpfs", str(disk)], capture_output=True).returncode:
        pytest.skip("no permission to mount")
    try:
        (disk / "out").mkdir()
        earlier = json.dumps({"schema": SCHEMA})
        (disk / "out" / "report.json").write_text(earlier)
        result = run(SHOWROOM, disk / "out", "--max-size", "96", "--iterations", "5", expect=2)
        assert "space" in result.stderr.splitlines()[-1]
        assert [path.name for path in (disk / "out").iterdir()] == ["report.json"]
        assert (disk / "out" / "report.json").read_text() == earlier
    finally:
        subprocess.run(["umount", "-l", str(disk)], check=False)
