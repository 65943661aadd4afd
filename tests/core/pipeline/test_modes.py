"""`--mode joint` and its baseline `post` through the command line, and layers that are added to finished runs."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from cvdgs.core.demo import SHOWROOM
from cvdgs.core.enhance import enhance_bytes, make_enhancer
from cvdgs.core.files.images import read_png
from cvdgs.core.splats.io.ply import read_ply

from .test_run import VIEWS, run

GEOMETRY = ("means", "log_scales", "quaternions", "opacity_logits")
SMALL = ("--max-size", "64", "--iterations", "60", "--gaussians", "1500", "--holdout", "10")


def report_of(out: Path) -> dict:
    return json.loads((out / "report.json").read_text())


def files(out: Path) -> dict[str, bytes]:
    return {str(path.relative_to(out)): path.read_bytes() for path in out.rglob("*") if path.is_file()}


@pytest.fixture(scope="module")
def post(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("post") / "out"
    run(SHOWROOM, out, *SMALL, "--mode", "post", "--enhancer", "lut")
    return out


@pytest.fixture(scope="module")
def joint(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("joint") / "out"
    run(SHOWROOM, out, *SMALL, "--mode", "joint", "--cvd", "deutan", "--cvd", "tritan", "--severity", "1",
        "--severity", "0")  # fmt: skip
    return out


@pytest.fixture(scope="module")
def added(post, tmp_path_factory) -> Path:
    """A copy of the post run with a layer of another enhancer and another strength."""
    out = tmp_path_factory.mktemp("added") / "out"
    shutil.copytree(post, out)
    run(SHOWROOM, out, "--resume", "--cvd", "protan", "--strength", "0.5", "--enhancer", "scene")
    return out


def test_in_post_a_picture_is_a_rendering_that_was_enhanced_afterwards(post):
    """The scene's LUT gives one colour one result, so the pictures are a function of the renderings' colours."""
    results: dict[tuple, tuple] = {}
    for path in sorted((post / "renders" / "original").glob("*.png")):
        before = read_png(path).reshape(-1, 3)
        after = read_png(post / "renders" / "deutan-1.0" / path.name).reshape(-1, 3)
        for color, result in zip(map(tuple, before), map(tuple, after), strict=True):
            assert results.setdefault(color, result) == result
    assert len(results) > 1000
    assert any(color != result for color, result in results.items())


def test_in_post_every_view_has_its_picture_and_the_gaussians_resemble_them(post):
    assert len(list((post / "renders" / "deutan-1.0").glob("*.png"))) == VIEWS
    original, layer = (read_ply(post / name) for name in ("splats.ply", "splats.deutan-1.0.ply"))
    for name in GEOMETRY:
        np.testing.assert_array_equal(getattr(original, name), getattr(layer, name))
    assert (original.base_colors != layer.base_colors).any()
    assert "layers" in report_of(post)["notes"]


def test_in_joint_all_colours_share_the_geometry_that_the_enhanced_views_gave(joint, post):
    names = ("splats.ply", "splats.deutan-1.0.ply", "splats.tritan-0.0.ply")
    original, *layers = (read_ply(joint / name) for name in names)
    for layer in layers:
        for name in GEOMETRY:
            np.testing.assert_array_equal(getattr(original, name), getattr(layer, name))
    assert np.abs(original.base_colors - layers[0].base_colors).mean() > 0.005
    other = read_ply(post / "splats.ply")
    assert len(other) != len(original) or (other.means != original.means).any()


def test_in_joint_the_original_colours_are_those_of_the_photographs(joint):
    shown = report_of(joint)
    assert shown["reconstruction"]["psnr"] > 12
    assert shown["layers"]["deutan-1.0"]["psnr_to_enhanced"] > 12
    assert "enhanced" in shown["notes"]["curve"]


def test_a_layer_is_added_without_touching_what_is_there(post, added):
    before, after = files(post), files(added)
    rewritten = {"report.json", "report.html", "viewer.html", "run.log"}
    assert {name: after[name] for name in before.keys() - rewritten} == {
        name: before[name] for name in before.keys() - rewritten
    }
    new = {name.split("/")[0] for name in after.keys() - before.keys()}
    assert new == {
        "enhanced",
        "layer.protan-1.0.cube",
        "layer.protan-1.0.safetensors",
        "renders",
        "splats.protan-1.0.ply",
    }
    for name in GEOMETRY:
        np.testing.assert_array_equal(
            getattr(read_ply(added / "splats.ply"), name), getattr(read_ply(added / "splats.protan-1.0.ply"), name)
        )


def test_the_photographs_of_a_layer_are_enhanced_by_its_own_strength(added):
    path = next((added / "capture" / "images").glob("*.png"))
    photograph, enhanced = (read_png(one) for one in (path, added / "enhanced" / "protan-1.0" / path.name))
    kept = str(added / "layer.protan-1.0.safetensors")
    half, full = (make_enhancer(kept, "protan", 1.0, strength=strength) for strength in (0.5, 1.0))
    np.testing.assert_array_equal(enhance_bytes(half, photograph[..., :3]), enhanced)
    assert (enhance_bytes(full, photograph[..., :3]) != enhanced).any()


def test_a_lost_layer_is_added_again_without_files_of_the_one_that_was_lost(post, tmp_path):
    out = tmp_path / "out"
    shutil.copytree(post, out)
    (out / "splats.deutan-1.0.ply").unlink()
    stale = [out / name for name in ("layer.deutan-1.0.safetensors", "turntable/deutan-1.0/0001.png",
                                     "stills/deutan-1.0.png", "enhanced/deutan-1.0/lost.png")]  # fmt: skip
    for path in stale:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("of the lost layer")
    run(SHOWROOM, out, "--resume", "--cvd", "deutan", "--enhancer", "none")
    assert not [path for path in (*stale, out / "layer.deutan-1.0.cube") if path.exists()]
    assert report_of(out)["layers"]["deutan-1.0"]["enhancer"] == "none"


def test_the_report_tells_of_the_addition(post, added):
    before, after = report_of(post), report_of(added)
    assert after["layers"]["deutan-1.0"] == before["layers"]["deutan-1.0"]
    assert (after["layers"]["protan-1.0"]["enhancer"], after["layers"]["protan-1.0"]["strength"]) == ("scene", 0.5)
    assert [layer["cvd"] for layer in after["settings"]["layers"]] == ["deutan", "protan"]
    assert after["seconds"] == before["seconds"]
    (addition,) = after["resumed"]
    assert addition["layers"] == ["protan-1.0"]
    assert set(addition["seconds"]) == {"capture", "enhance", "layers", "evaluate", "blender", "total"}
    assert after["capture"] == before["capture"]
    assert after["gaussians"] == before["gaussians"]


def test_what_does_not_fit_is_refused_and_changes_nothing(post, tmp_path):
    out = tmp_path / "out"
    shutil.copytree(post, out)
    result = run(SHOWROOM, out, "--resume", "--cvd", "protan", "--holdout", "5", expect=2)
    assert "--holdout" in result.stderr.splitlines()[-1]
    assert files(out) == files(post)
