"""The web page of a finished run, by itself, in the report and from the command line."""

from __future__ import annotations

import base64
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from cvdgs.core.errors import InputError
from cvdgs.core.files.images import write_png
from cvdgs.core.runs.report_page import write_report_page
from cvdgs.core.splats.web.finished_run import is_finished_run, write_viewer
from cvdgs.scripts import convert

from .scenes import write_run
from .test_page import scene_of

SENTENCE = "A deutan could tell apart 60 of 100 neighbouring colours in the photographs, 80 in the finished scene."


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    folder = write_run(tmp_path_factory.mktemp("run"), simulation="vienot")
    write_viewer(folder)
    return folder


def text_of(path: Path) -> str:
    return path.read_text(encoding="utf-8")


def test_it_begins_where_the_report_does_and_says_what_it_says(run):
    scene, text = scene_of(run / "viewer.html"), text_of(run / "viewer.html")
    assert [layer["name"] for layer in scene["layers"]] == ["original", "deutan-1.0", "tritan-0.5"]
    assert scene["names"][1:] == ["deutan vision", "tritan vision of severity 0.5"]
    assert scene["captions"][1] == SENTENCE
    assert (len(scene["cameras"]), scene["start"]) == (4, 1)
    assert scene["up"] == [0.0, 0.0, 1.0]
    for part in (
        "blobs &amp; more in colours for everyone",
        "400 Gaussians, made from 4 photographs; 30.0 dB",
        "cvdgs 7",
    ):
        assert part in text
    assert text.count("<figure>") == 5  # the original, and each layer as everybody and as its observer see it


def test_every_still_is_the_picture_that_its_caption_says(run):
    renders, pattern = run / "renders", r'<img alt="([^"]*)" src="data:image/png;base64,([^"]*)">'
    shown = dict(re.findall(pattern, text_of(run / "viewer.html")))
    for caption, place in {
        "Original colours": renders / "original",
        "Enhanced for deutan vision": renders / "deutan-1.0",
        "Enhanced, as deutan vision sees it": renders / "deutan-1.0" / "simulated",
    }.items():
        assert base64.b64decode(shown[caption]) == (place / "view1.png").read_bytes(), caption


def test_up_is_what_the_run_found(tmp_path):
    folder = write_run(tmp_path)
    cameras = folder / "capture" / "transforms.json"
    cameras.write_text(json.dumps({**json.loads(cameras.read_text()), "up": [0.0, -3.0, 4.0]}))
    write_viewer(folder)
    assert scene_of(folder / "viewer.html")["up"] == [0.0, -0.6, 0.8]


def test_cut_out_photographs_stand_on_white_and_views_that_were_trained_on_are_called_so(run, tmp_path):
    assert scene_of(run / "viewer.html")["background"] == [0.0, 0.0, 0.0]
    folder = write_run(tmp_path)
    picture = np.full((120, 160, 3), 90, np.uint8)
    write_png(folder / "capture" / "images" / "view1.png", picture, np.zeros((120, 160), np.uint8))
    report = json.loads((folder / "report.json").read_text())
    report["capture"] |= {"train": 4, "test": 0}
    (folder / "report.json").write_text(json.dumps(report))
    write_viewer(folder)
    assert scene_of(folder / "viewer.html")["background"] == [1.0, 1.0, 1.0]
    assert "30.0 dB on training views" in text_of(folder / "viewer.html")


def test_a_run_without_layers_has_one_too(tmp_path):
    write_viewer(write_run(tmp_path, with_layers=False))
    assert [layer["name"] for layer in scene_of(tmp_path / "viewer.html")["layers"]] == ["original"]


def test_one_of_a_damaged_run_is_refused_and_an_old_one_does_not_stay(tmp_path):
    write_viewer(write_run(tmp_path))
    (tmp_path / "splats.ply").write_text("no Gaussians")
    with pytest.raises(InputError, match=r"splats\.ply"):
        write_viewer(tmp_path)
    assert not (tmp_path / "viewer.html").exists()


@pytest.mark.parametrize(
    "changed",
    [
        {"views_shown": {"view1": 1}},
        {"layers": {"deutan-1.0": {}}},
        {"capture": [4]},
        {"reconstruction": {"psnr": "good"}},
        {"reconstruction": {"psnr": 10**400}},
        {"settings": {"capture": 5}},
        {"versions": []},
    ],
    ids=lambda changed: next(iter(changed)),
)
def test_a_report_that_cannot_be_used_is_said_in_a_line(tmp_path, capsys, changed):
    report = write_run(tmp_path) / "report.json"
    report.write_text(json.dumps({**json.loads(report.read_text()), **changed}))
    assert convert.main([str(tmp_path / "splats.ply"), str(tmp_path / "scene.html")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "report.json of the finished run is damaged" in line
    assert not (tmp_path / "scene.html").exists()


def test_a_view_whose_name_no_file_can_have_has_no_stills(tmp_path):
    report = write_run(tmp_path) / "report.json"
    report.write_text(json.dumps({**json.loads(report.read_text()), "views_shown": ["a" * 300]}))
    assert convert.main([str(tmp_path / "splats.ply"), str(tmp_path / "scene.html")]) == 0
    assert "<figure>" not in (tmp_path / "scene.html").read_text()


def moved_away(frame: dict) -> None:
    frame["transform_matrix"][0][3] = 1e200


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (moved_away, "'view0' has no rigid pose"),
        (lambda frame: frame.update(w=10**400), "'view0' has an impossible camera"),
        (lambda frame: frame.update(cx=-1e300), "'view0' has an impossible camera"),
    ],
    ids=["position", "width", "middle"],
)
def test_cameras_beyond_all_measure_are_refused_in_a_line(tmp_path, capsys, damage, said):
    cameras = write_run(tmp_path) / "capture" / "transforms.json"
    document = json.loads(cameras.read_text())
    damage(document["frames"][0])
    cameras.write_text(json.dumps(document))
    assert convert.main([str(tmp_path / "splats.ply"), str(tmp_path / "scene.html")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line


def test_the_report_begins_with_what_was_gained_and_holds_the_scene(run):
    write_report_page(run)
    text = text_of(run / "report.html")
    assert text.index("<h1>") < text.index(SENTENCE) < text.index("4 views (3 for training")
    assert text.count(SENTENCE) == 1 + 1  # the second is in the scene's page
    assert text.count("</script>") == 2  # the scene's own are no elements of the report


def test_a_large_scene_is_not_in_the_report_but_beside_it(run, tmp_path, monkeypatch):
    monkeypatch.setattr("cvdgs.core.runs.report_page._MOST_EMBEDDED_BYTES", 1000)
    shutil.copytree(run, tmp_path / "run")
    write_report_page(tmp_path / "run")
    text = text_of(tmp_path / "run" / "report.html")
    assert 'id="viewer"' not in text
    assert 'href="viewer.html"' in text


def test_files_of_a_run_bring_its_cameras_and_others_do_not(run, tmp_path):
    sources = [str(run / name) for name in ("splats.ply", "splats.deutan-1.0.ply")]
    assert convert.main([*sources, str(tmp_path / "scene.html")]) == 0
    assert scene_of(tmp_path / "scene.html")["captions"] == ["", SENTENCE]
    assert len(scene_of(tmp_path / "scene.html")["cameras"]) == 4
    shutil.copy(sources[0], tmp_path / "alone.ply")
    assert not is_finished_run(tmp_path)
    assert convert.main([str(tmp_path / "alone.ply"), str(tmp_path / "alone.html"), "--up", "x"]) == 0
    assert scene_of(tmp_path / "alone.html")["cameras"] == []


def test_a_budget_is_kept_and_one_of_nothing_refused(run, tmp_path, capsys):
    source = str(run / "splats.ply")
    assert convert.main([source, str(tmp_path / "few.html"), "--gaussians", "100"]) == 0
    assert scene_of(tmp_path / "few.html")["count"] == 100
    assert convert.main([source, str(tmp_path / "none.html"), "--gaussians", "0"]) == 2
    assert "from 1 on" in capsys.readouterr().err
    assert not (tmp_path / "none.html").exists()


def test_that_many_gaussians_are_heavy_for_a_phone_is_said(run, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(convert, "_MANY_FOR_A_PAGE", 300)
    assert convert.main([str(run / "splats.ply"), str(tmp_path / "scene.html")]) == 0
    assert "--gaussians 300 makes it lighter" in capsys.readouterr().out
