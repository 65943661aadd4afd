"""The report: valid JSON whatever the figures are, and a page that needs no other file."""

import base64
import json
import re

import numpy as np
import pytest

from cvdgs.core.errors import InputError
from cvdgs.core.files.images import read_png, write_png
from cvdgs.core.runs.report import latest_seconds, without_non_finite, write_report
from cvdgs.core.runs.report_page import write_report_page

LAYER = {
    "psnr_to_enhanced": 31.5,
    "ccpr": {"input": 0.71, "enhanced": 0.9, "unenhanced": 0.6, "rendered": 0.87, "tau": 6},
    "ccpr_mean": {"input": 0.7, "enhanced": 0.9, "unenhanced": 0.6, "rendered": 0.8},
    "ssim_simulated": {"input": 0.62, "enhanced": 0.8, "unenhanced": 0.6, "rendered": 0.7},
    "naturalness": {"ssim": 0.9, "psnr": 22.0, "delta_e": 6.1},
    "rwe": {
        "ratio": float("nan"),
        "absolute": 0.01,
        "long_range_ratio": float("nan"),
        "enhanced_ratio": 1.01,
        "pairs": 0,
    },
}


def report(**changes):
    return {
        "schema": "cvdgs-report-1",
        "versions": {"cvdgs": "0"},
        "device": "cpu",
        "settings": {"capture": "photos/<b>silk & satin</b>"},
        "capture": {"format": "colmap", "views": 9, "train": 7, "test": 2, "width": 64, "height": 48, "points": 5},
        "gaussians": 12_345,
        "sh_degree": 0,
        "seconds": {"capture": 1.0, "geometry": 20.0, "blender": None, "total": 22.0},
        "peak_memory_mb": 800,
        "reconstruction": {"psnr": 30.0, "ssim": 0.9},
        "layers": {"deutan-1.0": LAYER},
        "views_shown": ["0001"],
        "notes": {"rwe": "no two views share enough points"},
        "warnings": [{"name": "few-views", "message": "only <9> views"}],
        "curve": [
            {"step": 0, "seconds": 0.0, "psnr": 12.0, "gaussians": 10},
            {"step": 9, "seconds": 3.0, "psnr": 30.0, "gaussians": 20},
        ],
        **changes,
    }


PLACES = {
    "photograph": "capture/images",
    "enhanced, rendered": "renders/deutan-1.0",
    "photograph, as deutan vision sees it": "renders/deutan-1.0/simulated_input",
    "enhanced, as deutan vision sees it": "renders/deutan-1.0/simulated",
}


@pytest.fixture
def folder(tmp_path):
    for seed, place in enumerate(PLACES.values()):
        image = np.random.default_rng(seed).integers(0, 256, (48, 64, 3), np.uint8)
        write_png(tmp_path / place / "0001.png", image)
    return tmp_path


def finish_report(folder, report):
    write_report(folder, report)
    write_report_page(folder)


def test_numbers_that_could_not_be_computed_are_null_with_a_reason(folder):
    finish_report(folder, without_non_finite(report(reconstruction={"psnr": float("inf"), "ssim": 1.0})))
    read = json.loads((folder / "report.json").read_text())
    assert read["layers"]["deutan-1.0"]["rwe"]["ratio"] is None
    assert read["layers"]["deutan-1.0"]["rwe"]["absolute"] == 0.01
    assert "nothing" in read["notes"]["layers.deutan-1.0.rwe.ratio"]
    assert "the same" in read["notes"]["reconstruction.psnr"]
    assert read["notes"]["rwe"] == "no two views share enough points"


def test_the_page_carries_its_pictures_and_asks_for_nothing_else(folder):
    finish_report(folder, without_non_finite(report()))
    page = (folder / "report.html").read_text()
    assert page.count("data:image/png;base64,") == 4
    assert not re.search(r"""(src|href)=["']?(?!["']?data:)""", page)
    assert "http" not in page


def test_every_picture_is_the_one_that_its_caption_says(folder):
    finish_report(folder, without_non_finite(report()))
    page = (folder / "report.html").read_text()
    shown = re.findall(r'<img alt="([^"]*)" src="data:image/png;base64,([^"]*)"><figcaption>([^<]*)<', page)
    assert [caption for caption, _, _ in shown] == [caption for _, _, caption in shown] == list(PLACES)
    for caption, content, _ in shown:
        assert base64.b64decode(content) == (folder / PLACES[caption] / "0001.png").read_bytes(), caption


def test_a_reader_who_sees_no_pictures_is_told_what_the_chart_shows_and_what_a_figure_is_of(folder):
    finish_report(folder, without_non_finite(report()))
    page = (folder / "report.html").read_text()
    assert 'aria-label="Held-out PSNR over training time, from 12.0 dB to 30.0 dB after 3 s"' in page
    assert '<th scope="row">SSIM, original to simulated</th>' in page
    assert '<th scope="col">' in page


def test_on_a_narrow_screen_the_chart_shrinks_and_the_widest_table_scrolls_by_itself(folder):
    finish_report(folder, without_non_finite(report()))
    page = (folder / "report.html").read_text()
    assert "svg { max-width: 100%; height: auto; }" in page
    assert re.search(r'<div class="scroll"><table>\s*<thead>', page)


def test_names_from_outside_are_shown_and_not_run(folder):
    finish_report(folder, without_non_finite(report()))
    page = (folder / "report.html").read_text()
    assert "<b>silk" not in page
    assert "&lt;9&gt; views" in page


@pytest.mark.parametrize(
    "changes",
    [
        {"layers": {"../secret": LAYER}},
        {"layers": {"/secret": LAYER}},
        {"views_shown": ["../../../secret"]},
        {"blender": {"stills": ["../secret.png"]}},
        {"turntable": {"frames": 4, "layers": ["../secret"]}},
        {"blender": {"stills": 7}},
    ],
)
def test_no_name_of_a_report_from_elsewhere_leads_out_of_its_folder(folder, changes):
    with pytest.raises(InputError, match="damaged"):
        finish_report(folder, without_non_finite(report(**changes)))
    assert not (folder / "report.html").exists()


def test_a_run_without_held_out_views_still_has_a_page(folder):
    curve = [{"step": 0, "seconds": 0.0, "psnr": None, "gaussians": 10}]
    finish_report(folder, without_non_finite(report(curve=curve, views_shown=[])))
    assert "no curve" in (folder / "report.html").read_text()


def test_the_page_says_what_was_decided_and_what_was_added_later(folder):
    decided = {"gaussians": "9 of <40>: growth did not pay any more"}
    added = [{"layers": ["protan-1.0"], "seconds": {"layers": 2.5, "blender": None, "total": 4.0}}]
    finish_report(folder, without_non_finite(report(decision=decided, skipped_steps=3, resumed=added)))
    page = (folder / "report.html").read_text()
    assert "9 of &lt;40&gt;" in page
    assert "3 steps skipped" in page
    assert "Added later: protan-1.0" in page


def page_of(folder, **ccpr) -> str:
    layer = {**LAYER, "ccpr": {**LAYER["ccpr"], **ccpr}}
    finish_report(folder, without_non_finite(report(layers={"deutan-1.0": layer})))
    return (folder / "report.html").read_text()


def test_the_page_says_what_second_photographs_have_or_would_have(folder):
    estimated = {"again_estimated": 0.63, "again_enhanced_estimated": 0.84}
    page = page_of(folder, **estimated)
    assert "would have, by an estimate, 84" in page
    assert "second photographs, estimated</th>" in page
    page = page_of(folder, again=0.62, again_enhanced=0.81, **estimated)
    assert "enhanced alike, has 81" in page
    assert "estimate" not in page
    assert "second photograph" not in page_of(folder, rendered=0.8)


def test_the_seconds_are_those_of_the_latest_addition():
    own = {"geometry": 9.0}
    assert latest_seconds({"seconds": own}) is own
    latest = {"layers": 1.0}
    added = [{"seconds": {}}, {"seconds": latest}]
    assert latest_seconds({"seconds": own, "resumed": added}) is latest


def test_png_files_come_back_as_they_were_written(tmp_path):
    image = np.random.default_rng(1).integers(0, 256, (7, 13, 3), np.uint8)
    write_png(tmp_path / "a" / "b.png", image)
    np.testing.assert_array_equal(read_png(tmp_path / "a" / "b.png"), image)


def test_an_image_that_cannot_be_written_is_an_error(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match="file"):
        write_png(tmp_path / "file" / "b.png", np.zeros((4, 4, 3), np.uint8))


def test_figures_of_training_views_are_not_called_held_out(folder):
    finish_report(folder, report(capture={**report()["capture"], "train": 9, "test": 0}, layers={}))
    page = (folder / "report.html").read_text()
    assert "30.00 dB on training views" in page
    assert "dB held out" not in page


def test_the_page_says_what_size_a_unit_has_once_it_is_measured(folder):
    finish_report(folder, without_non_finite(report()))
    assert "a unit of its world" not in (folder / "report.html").read_text()
    finish_report(folder, without_non_finite(report(capture={**report()["capture"], "metres_per_unit": 0.5})))
    assert re.search(r"a unit of its world is 0\.500\s+m long", (folder / "report.html").read_text())
    assert not list(folder.glob(".*")), "no partial page is left"
