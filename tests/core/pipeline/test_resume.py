"""Adding to a finished run: what has to be the same, what may differ, and a report that loses nothing."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cvdgs.core.capture.model import Capture, PinholeCamera, View
from cvdgs.core.capture.normalised import write_capture
from cvdgs.core.errors import InputError
from cvdgs.core.files.images import read_png, write_png
from cvdgs.core.pipeline.moving import keep_moving
from cvdgs.core.pipeline.resume import EarlierRun
from cvdgs.core.runs.report import SCHEMA
from cvdgs.core.runtime.protocol import Reporter
from cvdgs.core.settings import Layer, Settings
from cvdgs.core.splats.gaussians import Gaussians
from cvdgs.core.splats.io.ply import write_ply

MADE_WITH = Settings(capture="photos", out="out", iterations=700, holdout=4, max_size=48, gaussians=900)


FIGURES = {"input": 0.6, "enhanced": 0.9, "unenhanced": 0.5, "rendered": 0.8}
LAYER = {
    "enhancer": "lut",
    "ccpr": {**FIGURES, "tau": 6},
    "ccpr_mean": FIGURES,
    "ssim_simulated": FIGURES,
    "naturalness": {"ssim": 0.9, "psnr": None, "delta_e": 4.0},
    "rwe": {"ratio": None, "enhanced_ratio": 1.1},
    "psnr_to_enhanced": 30.0,
}


def report() -> dict:
    return {
        "schema": SCHEMA,
        "versions": {"cvdgs": "0"},
        "device": "cpu",
        "settings": MADE_WITH.to_dict(),
        "capture": {"views": 5, "train": 4, "test": 1, "width": 48, "height": 32, "points": 0},
        "reconstruction": {"psnr": 30.0, "ssim": 0.9},
        "views_shown": ["00"],
        "curve": [{"seconds": 1.0, "psnr": 20.0}],
        "gaussians": 3,
        "seconds": {"geometry": 20.0, "layers": 2.0, "blender": 5.0, "total": 30.0},
        "peak_memory_mb": 800,
        "layers": {"deutan-1.0": LAYER},
        "notes": {"rwe": "nothing shared"},
        "warnings": [{"name": "few-views", "message": "only 5"}],
        "blender": {"stills": ["stills/original.png"]},
    }


def capture(folder: Path) -> Capture:
    rng = np.random.default_rng(0)
    camera = PinholeCamera(48, 32, 40.0, 41.0, 24.0, 16.0)
    views = []
    for i in range(5):
        pose = np.eye(4)
        pose[0, 3] = 0.3 * i
        image = rng.integers(0, 256, (32, 48, 3), np.uint8)
        views.append(View(f"{i:02d}", folder / f"{i:02d}.png", camera, pose, image))
    return Capture(folder, "transforms", tuple(views), np.zeros((0, 3), np.float32), np.zeros((0, 3), np.uint8))


@pytest.fixture
def folder(tmp_path) -> Path:
    out = tmp_path / "out"
    write_capture(capture(tmp_path), out / "capture")
    gaussians = Gaussians(*(np.zeros((3, n), np.float32) for n in (3, 3, 4)), np.zeros(3, np.float32),
                          np.zeros((3, 1, 3), np.float32))  # fmt: skip
    for name in ("splats.ply", "splats.deutan-1.0.ply"):
        write_ply(out / name, gaussians)
    (out / "report.json").write_text(json.dumps(report()))
    return out


@pytest.fixture
def run(folder) -> EarlierRun:
    return EarlierRun.read(folder, "out")


def asked(**changes) -> Settings:
    usual = {"layers": (Layer("protan", 1.0),), "resume": True}
    return Settings(capture="photos", out="out", **{**usual, **changes})


def test_what_was_left_out_is_as_in_the_finished_run(run):
    completed = run.complete(asked())
    assert (completed.iterations, completed.holdout, completed.max_size, completed.gaussians) == (700, 4, 48, 900)
    assert completed.layers == (Layer("protan", 1.0),)
    assert completed.resume


def test_enhancer_strength_and_blender_may_differ(run):
    completed = run.complete(asked(enhancer="none", strength=0.5, blend=False))
    assert (completed.enhancer, completed.strength, completed.blend) == ("none", 0.5, False)


@pytest.mark.parametrize(
    ("changes", "option"),
    [
        ({"iterations": 800}, "--iterations"),
        ({"holdout": 5}, "--holdout"),
        ({"max_size": 64}, "--max-size"),
        ({"mode": "post"}, "--mode"),
        ({"simulation": "vienot"}, "--simulation"),
        ({"seed": 3}, "--seed"),
        ({"sh_degree": 2}, "--sh-degree"),
        ({"layers": (Layer("tritan", 1.0), Layer("deutan", 1.0))}, "--cvd: the finished run has deutan-1.0 already"),
    ],
)
def test_what_contradicts_the_finished_run_is_refused_by_its_option(run, changes, option):
    with pytest.raises(InputError, match=option):
        run.complete(asked(**changes))


def test_the_values_of_the_finished_run_may_be_repeated(run):
    assert run.complete(asked(iterations=700, holdout=4, max_size=48)).iterations == 700


def test_a_layer_whose_file_was_lost_may_be_added_again_and_is_reported_once(folder):
    (folder / "splats.deutan-1.0.ply").unlink()
    run = EarlierRun.read(folder, "out")
    completed = run.complete(asked(layers=(Layer("deutan", 1.0),)))
    added = {**report(), "settings": completed.to_dict(), "layers": {"deutan-1.0": {"enhancer": "none"}}}
    extended = run.extend(added)
    assert extended["settings"]["layers"] == [{"cvd": "deutan", "severity": 1.0}]
    assert extended["layers"] == {"deutan-1.0": {"enhancer": "none"}}


def test_pictures_of_a_layer_that_was_lost_are_listed_no_more(folder):
    made = {
        **report(),
        "blender": {"stills": ["stills/original.png", "stills/deutan-1.0.png"], "blend": "scene.blend"},
        "turntable": {"frames": 8, "layers": ["original", "deutan-1.0"], "engine": "workbench"},
    }
    (folder / "report.json").write_text(json.dumps(made))
    (folder / "splats.deutan-1.0.ply").unlink()
    run = EarlierRun.read(folder, "out")
    completed = run.complete(asked(layers=(Layer("deutan", 1.0),)))
    extended = run.extend({**report(), "settings": completed.to_dict(), "layers": {"deutan-1.0": LAYER}})
    assert extended["blender"] == {"stills": ["stills/original.png"], "blend": "scene.blend"}
    assert extended["turntable"] == {"frames": 8, "layers": ["original"], "engine": "workbench"}


def test_the_runs_own_capture_is_accepted(run, folder):
    run.check_photographs(folder / "capture", Reporter())


def test_the_runs_own_capture_needs_no_camera_file_that_the_run_was_made_with(folder, tmp_path):
    made = {**report(), "settings": replace(MADE_WITH, cameras=str(tmp_path / "gone.json")).to_dict()}
    (folder / "report.json").write_text(json.dumps(made))
    run = EarlierRun.read(folder, str(folder))
    run.check_photographs(folder / "." / "capture", Reporter())
    with pytest.raises(InputError, match=r"gone\.json: no such file or folder"):
        run.check_photographs(tmp_path, Reporter())


def changed_capture(tmp_path, change) -> Path:
    original = capture(tmp_path)
    write_capture(replace(original, views=change(original.views)), tmp_path / "photos")
    return tmp_path / "photos"


def test_a_run_keeps_its_own_order_of_views_and_the_capture_may_have_another(folder, tmp_path):
    turned = changed_capture(tmp_path, lambda views: views[::-1])
    (folder / "capture").rename(tmp_path / "photographs")
    turned.rename(folder / "capture")
    run = EarlierRun.read(folder, "out")
    assert [view.key for view in run.capture.views] == ["04", "03", "02", "01", "00"]
    run.check_photographs(tmp_path / "photographs", Reporter())


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (lambda views: views[:4], "4 views, the finished run has 5"),
        (lambda views: (*views[:4], replace(views[4], key="other")), "'other' where the finished run has '04'"),
        (lambda views: (replace(views[0], image=255 - views[0].image), *views[1:]), "photograph '00' has changed"),
        (
            lambda views: (replace(views[0], camera=replace(views[0].camera, fx=44.0)), *views[1:]),
            "view '00' has another camera",
        ),
        (
            lambda views: (replace(views[0], world_to_camera=views[1].world_to_camera), *views[1:]),
            "view '00' has another camera",
        ),
        (
            lambda views: tuple(
                replace(v, image=np.ascontiguousarray(v.image[:, :40]), camera=replace(v.camera, width=40))
                for v in views
            ),
            "is 40x32, in the finished run 48x32",
        ),
    ],
    ids=["fewer", "another", "retouched", "lens", "moved", "cropped"],
)
def test_another_capture_is_refused(run, tmp_path, change, complaint):
    with pytest.raises(InputError, match=complaint):
        run.check_photographs(changed_capture(tmp_path, change), Reporter())


def test_estimated_cameras_stay_and_only_the_photographs_are_counted(run, tmp_path):
    estimated = replace(run, settings=replace(run.settings, sfm=True))
    for i in range(5):
        write_png(tmp_path / "photos" / f"{i}.png", np.full((32, 48, 3), i, np.uint8))
    estimated.check_photographs(tmp_path / "photos", Reporter())
    (tmp_path / "photos" / "3.png").unlink()
    with pytest.raises(InputError, match="4 photographs"):
        estimated.check_photographs(tmp_path / "photos", Reporter())


def test_poses_that_the_run_corrected_may_differ_from_those_given(run, tmp_path):
    corrected = replace(run, report={**run.report, "decision": {"poses": "corrected: they were off"}})
    moved = changed_capture(tmp_path, lambda views: (views[0].at(views[1].world_to_camera), *views[1:]))
    corrected.check_photographs(moved, Reporter())


def test_a_focal_length_that_the_run_corrected_may_differ_from_that_given(run, tmp_path):
    corrected = replace(run, report={**run.report, "decision": {"focal_length": "corrected: it was 5.0% too long"}})
    longer = changed_capture(
        tmp_path / "lens", lambda views: tuple(replace(v, camera=v.camera.zoomed(1.05)) for v in views)
    )
    corrected.check_photographs(longer, Reporter())
    aside = changed_capture(
        tmp_path / "middle",
        lambda views: tuple(replace(v, camera=replace(v.camera, cx=v.camera.cx + 1)) for v in views),
    )
    with pytest.raises(InputError, match="has another camera"):
        corrected.check_photographs(aside, Reporter())


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        (None, "out: no finished run .* leave out --resume"),
        ("{", "out: the report of the finished run is damaged"),
        ("[]", "damaged"),
        (json.dumps({**report(), "schema": "cvdgs-report-9"}), "another version"),
        (json.dumps({**report(), "settings": {"flavour": "mint"}}), "flavour"),
        (json.dumps({**report(), "layers": {"deutan-1.0": {}}}), r"report\.layers\.deutan-1\.0\.ccpr is missing"),
        (json.dumps({**report(), "warnings": 5}), r"report\.warnings is unusable"),
    ],
)
def test_a_folder_without_a_usable_run_is_refused(folder, text, complaint):
    (folder / "report.json").unlink()
    if text is not None:
        (folder / "report.json").write_text(text)
    with pytest.raises(InputError, match=complaint):
        EarlierRun.read(folder, "out")


def test_the_report_keeps_everything_and_gains_the_layer(run):
    added = {
        **report(),
        "settings": asked().to_dict(),
        "seconds": {"enhance": 1.0, "layers": 2.5, "blender": None, "total": None},
        "peak_memory_mb": 900,
        "layers": {"protan-1.0": {"enhancer": "none"}},
        "notes": {"layers.protan-1.0.rwe.ratio": "there is nothing to measure it on"},
        "warnings": [{"name": "few-views", "message": "only 5"}, {"name": "new", "message": "new"}],
    }
    extended = run.extend(added)
    assert extended["layers"] == {"deutan-1.0": LAYER, "protan-1.0": {"enhancer": "none"}}
    assert extended["settings"]["layers"] == [{"cvd": "deutan", "severity": 1.0}, {"cvd": "protan", "severity": 1.0}]
    assert extended["seconds"] == report()["seconds"]
    assert extended["peak_memory_mb"] == 900
    assert [item["name"] for item in extended["warnings"]] == ["few-views", "new"]
    assert set(extended["notes"]) == {"rwe", "layers.protan-1.0.rwe.ratio"}
    assert extended["blender"] == report()["blender"]
    (addition,) = extended["resumed"]
    assert addition["layers"] == ["protan-1.0"]
    assert addition["seconds"]["layers"] == 2.5
    again = replace(run, report=extended).extend({**added, "layers": {"tritan-1.0": {}}})
    assert [item["layers"] for item in again["resumed"]] == [["protan-1.0"], ["tritan-1.0"]]


def test_what_a_run_found_to_move_is_kept_told_and_no_changed_mask(run, folder, tmp_path):
    class Heard(Reporter):
        def warning(self, name: str, message: str) -> None:
            heard.append((name, message))

    heard: list[tuple[str, str]] = []
    region = np.zeros((32, 48), bool)
    region[8:24, 10:20] = True
    regions = {"01": region, "03": region}
    photographs = capture(tmp_path)
    figures = keep_moving(photographs.without(regions), regions, folder, Heard())
    assert figures == {"views": ["01", "03"], "share": pytest.approx(2 * 160 / (5 * 32 * 48), rel=1e-4)}
    ((name, message),) = heard
    assert name == "moving-things"
    assert "2 of 5 photographs" in message
    sheet = read_png(folder / "capture" / "moving.png")
    vermilion = (sheet == (213, 94, 0)).all(axis=2)
    assert vermilion[6:26, 8:22].any()
    assert not vermilion[:, 24:48].any()
    again = EarlierRun.read(folder, folder)
    assert [view.key for view in again.capture.views if view.mask is not None] == ["01", "03"]
    assert np.array_equal(again.capture.views[1].mask, ~region)
    given = changed_capture(tmp_path / "given", lambda views: views)
    with pytest.raises(InputError, match="the mask of '01' has changed"):
        again.check_photographs(given, Reporter())
    replace(again, report={**again.report, "moving": figures}).check_photographs(given, Reporter())
    assert keep_moving(photographs, {}, folder, Heard()) == {}
