"""scripts/enhance.py on real files: what it writes, what it keeps, and what it refuses."""

from __future__ import annotations

import base64
import csv
import io
import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from cvdgs.core.bootstrap import ROOT
from cvdgs.core.color.srgb import simulate_bytes
from cvdgs.core.enhance import LutEnhancer, SceneNetworkEnhancer
from cvdgs.core.enhance.gan.weights import save_generator
from cvdgs.core.enhance.lut_fit import LutSettings
from cvdgs.core.enhance.scene.fit import FitSettings
from cvdgs.core.errors import InputError
from cvdgs.core.photographs.find import Photograph, survey
from cvdgs.core.photographs.front import EnhanceRequest, enhance
from cvdgs.core.photographs.job import enhance_folder
from cvdgs.core.runs.enhanced import enhanced_files
from cvdgs.core.runtime.protocol import Reporter

from ...patience import SOON
from ..enhance import textiles
from ..enhance.gan.networks import random_generator

BRIEF = LutSettings(steps=60, pairs=800, relaxations=0)  # enough to see the direction of a fit
TARTAN = textiles.tartan(size=48, stripe=8)


class Recorder(Reporter):
    """Keeps the warnings, and how far the stage "enhance" was."""

    def __init__(self) -> None:
        self.warnings: dict[str, str] = {}
        self.enhanced: list[float] = []

    def progress(self, stage: str, fraction: float, message: str = "") -> None:
        if stage == "enhance":
            self.enhanced.append(fraction)

    def warning(self, name: str, message: str) -> None:
        self.warnings[name] = message


@pytest.fixture
def brief_fits(monkeypatch: pytest.MonkeyPatch) -> None:
    """The LUT, fitted in a tenth of the time."""

    def make(
        name: str,
        cvd: str,
        severity: float,
        simulation: str,
        strength: float,
        seed: int,
        budget: float | None,
        fit_steps: int,
    ) -> LutEnhancer:
        assert name == "lut"
        return LutEnhancer(cvd, severity, simulation, strength, seed, BRIEF)

    monkeypatch.setattr("cvdgs.core.photographs.job.make_enhancer", make)


def save(path: Path, pixels: np.ndarray = TARTAN, mode: str | None = None, **options: object) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    picture = Image.fromarray(pixels)
    (picture.convert(mode) if mode else picture).save(path, **options)
    return path


def run(out: Path, *inputs: Path, **options: object) -> Recorder:
    """The worker's job in this process, without staging."""
    recorder = Recorder()
    out.mkdir(parents=True, exist_ok=True)
    request = EnhanceRequest(tuple(map(str, inputs)), str(out), **{"enhancer": "none", **options})
    enhance_folder(request, out, recorder)
    return recorder


def pixels(path: Path) -> np.ndarray:
    return np.asarray(Image.open(path))


def table(out: Path) -> dict[str, dict[str, str]]:
    """Rows of metrics.csv by the names of the results; the mean's is empty."""
    with open(out / "metrics.csv", newline="", encoding="utf-8") as file:
        return {row["output"]: row for row in csv.DictReader(file)}


def names(folder: Path) -> list[str]:
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*"))


@pytest.mark.usefixtures("brief_fits")
def test_each_photograph_gets_a_picture_a_row_and_a_place_on_the_page(tmp_path: Path) -> None:
    save(tmp_path / "in" / "a.png")
    save(tmp_path / "in" / "deep" / "b.png", textiles.tartan(size=48, stripe=8, shift=3))
    run(tmp_path / "out", tmp_path / "in", enhancer="lut")
    assert names(tmp_path / "out") == ["a.png", "deep_b.png", "metrics.csv", "sheet.html"]
    rows = table(tmp_path / "out")
    for name in ("a.png", "deep_b.png"):
        assert float(rows[name]["ccpr_input"]) < 0.1
        assert float(rows[name]["ccpr_enhanced"]) > 0.5
        assert 0.0 < float(rows[name]["naturalness_ssim"]) < 1.0
    mean = np.mean([float(rows[name]["ccpr_enhanced"]) for name in ("a.png", "deep_b.png")])
    assert float(rows[""]["ccpr_enhanced"]) == pytest.approx(mean, abs=1e-5)
    page = (tmp_path / "out" / "sheet.html").read_text(encoding="utf-8")
    assert page.count("data:image/jpeg;base64,") == 8
    assert "http" not in page


@pytest.mark.usefixtures("brief_fits")
def test_every_picture_of_the_page_is_the_one_that_its_caption_says(tmp_path: Path) -> None:
    alpha = np.full((48, 48, 1), 255, np.uint8)
    alpha[:, 32:] = 0  # of the page's white
    save(tmp_path / "a.png", np.dstack([TARTAN, alpha]))
    run(tmp_path / "out", tmp_path / "a.png", enhancer="lut", cvd="protan", severity=0.9)
    shown = re.findall(
        r'alt="([^"]*)"[^>]*src="data:image/jpeg;base64,([^"]*)"', (tmp_path / "out" / "sheet.html").read_text()
    )
    before, after = (np.where(alpha > 0, image[..., :3], 255) for image in (TARTAN, pixels(tmp_path / "out" / "a.png")))
    expected = {
        "before": before,
        "after": after,
        "before, as protan vision sees it": simulate_bytes(before.astype(np.uint8), "protan", 0.9),
        "after, as protan vision sees it": simulate_bytes(after.astype(np.uint8), "protan", 0.9),
    }
    assert [caption for caption, _ in shown] == list(expected)
    for caption, content in shown:
        picture = np.asarray(Image.open(io.BytesIO(base64.b64decode(content)))).astype(float)
        assert np.abs(picture - expected[caption]).mean() < 4.0, caption
    assert np.abs(expected["after"] - before.astype(float)).mean() > 8.0


@pytest.mark.usefixtures("brief_fits")
def test_photographs_of_one_scene_get_one_colour_map_and_separate_ones_their_own(tmp_path: Path) -> None:
    blue = np.full((48, 48, 3), (40, 60, 160), np.uint8)
    blue[:, 24:] = (200, 190, 90)
    blue[:4, :4] = TARTAN[0, 0]
    both = [save(tmp_path / "tartan.png"), save(tmp_path / "blue.png", blue)]
    recorder = run(tmp_path / "together", *both, enhancer="lut", together=True)
    assert recorder.warnings == {}
    together = [pixels(tmp_path / "together" / f"{name}.png")[0, 0] for name in ("tartan", "blue")]
    np.testing.assert_array_equal(*together)
    run(tmp_path / "apart", *both, enhancer="lut", separately=True)
    apart = [pixels(tmp_path / "apart" / f"{name}.png")[0, 0].astype(int) for name in ("tartan", "blue")]
    assert np.abs(apart[0] - apart[1]).max() > 4


@pytest.mark.usefixtures("brief_fits")
def test_photographs_whose_colours_have_nothing_in_common_are_scenes_of_their_own_and_that_is_said(
    tmp_path: Path,
) -> None:
    blue = np.full((48, 48, 3), (40, 60, 160), np.uint8)
    blue[:, 24:] = (200, 190, 90)
    tartans = [save(tmp_path / f"{shift}.png", textiles.tartan(size=48, stripe=8, shift=shift)) for shift in (0, 3, 6)]
    recorder = run(tmp_path / "mixed", *tartans, save(tmp_path / "blue.png", blue), enhancer="lut")
    assert "2 scenes, the largest of 3 photographs," in recorder.warnings["several-scenes"]
    assert "--together" in recorder.warnings["several-scenes"]
    run(tmp_path / "tartans", *tartans, enhancer="lut")
    run(tmp_path / "blue", tmp_path / "blue.png", enhancer="lut")
    for alone, name in (("tartans", "3.png"), ("blue", "blue.png")):
        np.testing.assert_array_equal(pixels(tmp_path / "mixed" / name), pixels(tmp_path / alone / name))


def test_what_is_not_fitted_takes_no_part_of_the_time(tmp_path: Path) -> None:
    photographs = [save(tmp_path / f"{number}.png") for number in range(4)]
    for options in ({}, {"enhancer": "lut", "strength": 0.0}, {"separately": True}):
        assert run(tmp_path / "out", *photographs, **options).enhanced == [0.0, 0.25, 0.5, 0.75, 1.0]


@pytest.mark.usefixtures("brief_fits")
def test_a_fit_to_one_photograph_alone_is_seen_to_go_on(tmp_path: Path) -> None:
    photographs = [save(tmp_path / f"{number}.png") for number in range(2)]
    told = run(tmp_path / "out", *photographs, enhancer="lut", separately=True).enhanced
    assert told == sorted(told)
    assert all(sum(start < fraction < start + 0.4 for fraction in told) > 20 for start in (0.0, 0.5))


def test_the_budget_and_the_steps_that_are_asked_for_count(tmp_path: Path) -> None:
    save_generator(random_generator(), tmp_path / "weights.safetensors")
    photograph, changes = save(tmp_path / "a.png"), []
    for budget, fit in ((1.0, 0), (3.0, 0), (3.0, 2)):
        out = tmp_path / f"{budget}-{fit}"
        run(out, photograph, enhancer=str(tmp_path / "weights.safetensors"), change_budget=budget, fit=fit)
        changes.append(float(table(out)["a.png"]["naturalness_delta_e_2000"]))
    assert changes[0] < 1.2
    assert changes[1] > 1.5
    assert changes[2] != changes[1]


def test_a_card_that_is_not_there_is_not_missed(tmp_path: Path) -> None:
    run(tmp_path / "out", save(tmp_path / "a.png"), device="cuda")
    assert (tmp_path / "out" / "a.png").exists()


def test_together_and_separately_at_once_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="together and separately"):
        run(tmp_path / "out", save(tmp_path / "a.png"), together=True, separately=True)


def test_a_photograph_is_enhanced_by_the_network_of_a_run_and_a_damaged_one_is_refused(tmp_path: Path) -> None:
    photograph, network = save(tmp_path / "a.png"), tmp_path / "layer.deutan-1.0.safetensors"
    brief = FitSettings(size=48, start_steps=4, table_steps=4, steps=12)
    enhancer = SceneNetworkEnhancer("deutan", 1.0, settings=brief)
    enhancer.fit([TARTAN])
    enhancer.save(network)
    run(tmp_path / "out", photograph, enhancer=str(network))
    np.testing.assert_array_equal(pixels(tmp_path / "out" / "a.png"), enhancer.enhance_bytes(TARTAN))
    network.write_bytes(network.read_bytes()[:-100])
    process = start(photograph, "--out", tmp_path / "refused", "--enhancer", network)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 2
    assert network.name in errors.splitlines()[-1]
    assert "Traceback" not in errors
    assert not (tmp_path / "refused").exists()


@pytest.mark.usefixtures("brief_fits")
def test_alpha_is_kept_and_what_is_invisible_counts_for_nothing(tmp_path: Path) -> None:
    alpha = np.zeros((48, 48, 1), np.uint8)
    alpha[10:30] = 200
    save(tmp_path / "cut.png", np.dstack([TARTAN, alpha]))
    save(tmp_path / "clear.png", np.dstack([TARTAN, 0 * alpha]))
    run(tmp_path / "out", tmp_path / "cut.png", tmp_path / "clear.png", enhancer="lut")
    np.testing.assert_array_equal(pixels(tmp_path / "out" / "cut.png")[..., 3:], alpha)
    np.testing.assert_array_equal(pixels(tmp_path / "out" / "clear.png")[..., 3:], 0 * alpha)
    row = table(tmp_path / "out")["clear.png"]
    assert (row["ccpr_input"], row["ssim_simulated_input"]) == ("", "")
    assert "no pixel is visible" in row["notes"]


@pytest.mark.usefixtures("brief_fits")
def test_rotated_deep_grey_and_tiny_photographs_are_handled_and_said(tmp_path: Path) -> None:
    exif = Image.Exif()
    exif[274] = 6
    save(tmp_path / "in" / "turned.png", TARTAN[:40], exif=exif)
    save(tmp_path / "in" / "deep.png", TARTAN[..., 0].astype(np.uint16) * 257)
    save(tmp_path / "in" / "grey.jpg", mode="L")
    save(tmp_path / "in" / "one.png", TARTAN[:1, :1])
    save(tmp_path / "in" / "palette.png", mode="P")
    save(tmp_path / "in" / "pages.tif", save_all=True, append_images=[Image.fromarray(TARTAN[::-1])])
    recorder = run(tmp_path / "out", tmp_path / "in", enhancer="lut", together=True)
    assert set(recorder.warnings) == {"exif-rotated", "deep-colour", "several-pages"}
    assert pixels(tmp_path / "out" / "turned.png").shape == (48, 40, 3)
    assert pixels(tmp_path / "out" / "one.png").shape == (1, 1, 3)
    for name in ("deep.png", "grey.png"):
        result = pixels(tmp_path / "out" / name)
        assert result.dtype == np.uint8
        assert (result == result[..., :1]).all()
    np.testing.assert_array_equal(pixels(tmp_path / "out" / "deep.png")[..., 0], TARTAN[..., 0])
    row = table(tmp_path / "out")["one.png"]
    assert row["ccpr_input"] == ""
    assert "no two colours" in row["notes"]


def test_names_that_collide_keep_apart_and_hostile_ones_stay_text(tmp_path: Path) -> None:
    photographs = [tmp_path / "in" / name for name in ("a.png", "a.bmp", "A.tif", "<b>&'.png", "x/a.png", "日本.png")]
    for path in photographs:
        save(path)
    run(tmp_path / "out", tmp_path / "in", tmp_path / "in" / "a.png")
    results = [name for name in names(tmp_path / "out") if name.endswith(".png")]
    assert len(results) == len({name.lower() for name in results}) == len(photographs)
    assert all(re.fullmatch(r"[\w.-]+", name) for name in results)
    page = (tmp_path / "out" / "sheet.html").read_text(encoding="utf-8")
    assert "<b>" not in page
    assert "&lt;b&gt;&amp;" in page


def test_of_more_pixels_than_a_fit_can_hold_some_are_left_out_and_none_is_mixed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cvdgs.core.photographs.find._SCENE_PIXELS", 1000)
    photographs = [Photograph(save(tmp_path / f"{number}.png"), str(number)) for number in range(4)]
    images = survey(photographs, Reporter(), keep_pixels=True, skip_unreadable=False).images
    colors = np.concatenate([image.reshape(-1, 3) for image in images])
    assert 500 < len(colors) <= 1000
    assert set(map(tuple, colors)) <= set(map(tuple, TARTAN.reshape(-1, 3)))


def test_large_photographs_are_measured_on_a_reduced_copy_and_the_table_says_so(tmp_path: Path) -> None:
    save(tmp_path / "large.png", np.tile(TARTAN, (22, 22, 1)))
    run(tmp_path / "out", tmp_path / "large.png")
    row = table(tmp_path / "out")["large.png"]
    assert float(row["metrics_scale"]) == pytest.approx(1000 / 1056, abs=1e-3)
    assert "reduced" in row["notes"]
    assert (row["width"], row["height"]) == ("1056", "1056")


@pytest.mark.usefixtures("brief_fits")
def test_blocks_of_rows_leave_no_seam(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    save(tmp_path / "a.png")
    run(tmp_path / "whole", tmp_path / "a.png", enhancer="lut")
    monkeypatch.setattr("cvdgs.core.photographs.job._BLOCK_PIXELS", 48 * 5)
    run(tmp_path / "blocks", tmp_path / "a.png", enhancer="lut")
    np.testing.assert_array_equal(pixels(tmp_path / "whole" / "a.png"), pixels(tmp_path / "blocks" / "a.png"))


def test_what_is_no_image_is_skipped_and_named(tmp_path: Path) -> None:
    save(tmp_path / "in" / "a.png")
    save(tmp_path / "elsewhere" / "b.png")
    os.symlink("../elsewhere", tmp_path / "in" / "more")
    for name in ("clip.mp4", "notes.txt", ".hidden"):
        (tmp_path / "in" / name).write_text("x")
    os.symlink("loop", tmp_path / "in" / "loop")
    recorder = run(tmp_path / "out", tmp_path / "in")
    assert "clip.mp4, loop, more (a linked folder) and 1 more" in recorder.warnings["not-images"]
    assert "hidden" not in recorder.warnings["not-images"]


def test_results_inside_the_folder_of_photographs_are_not_read_again(tmp_path: Path) -> None:
    save(tmp_path / "a.png")
    for _ in range(2):
        recorder = run(tmp_path / "out", tmp_path)
        assert names(tmp_path / "out") == ["a.png", "metrics.csv", "sheet.html"]
        assert "not-images" not in recorder.warnings


def test_results_may_lie_around_the_folder_of_photographs(tmp_path: Path) -> None:
    save(tmp_path / "photos" / "a.png")
    for _ in range(2):
        run(tmp_path, tmp_path / "photos")
        assert names(tmp_path) == ["a.png", "metrics.csv", "photos", "photos/a.png", "sheet.html"]


def damaged(folder: Path) -> Path:
    """A folder with one good photograph and one that is cut in half."""
    save(folder / "good.png")
    whole = save(folder / "whole.png", np.random.default_rng(0).integers(0, 256, (64, 64, 3), dtype=np.uint8))
    (folder / "half.png").write_bytes(whole.read_bytes()[:6000])
    whole.unlink()
    return folder


def test_a_damaged_photograph_is_refused_or_skipped_when_asked(tmp_path: Path) -> None:
    folder = damaged(tmp_path / "in")
    with pytest.raises(InputError, match=r"half\.png.*--skip-unreadable"):
        run(tmp_path / "out", folder)
    assert names(tmp_path / "out") == []
    recorder = run(tmp_path / "out", folder, skip_unreadable=True)
    assert "half.png" in recorder.warnings["unreadable"]
    assert names(tmp_path / "out") == ["good.png", "metrics.csv", "sheet.html"]
    (folder / "good.png").unlink()
    with pytest.raises(InputError, match="none of the photographs"):
        run(tmp_path / "other", folder, skip_unreadable=True)


def test_a_video_in_place_of_a_photograph_is_refused_as_one(tmp_path: Path) -> None:
    video = tmp_path / "walk.mp4"
    video.write_bytes(b"\0\0\0\x18ftypmp42" + bytes(100))
    with pytest.raises(InputError, match=r"walk\.mp4: is a video, not a photograph - .* or pass --skip-unreadable"):
        run(tmp_path / "out", video)


@pytest.mark.parametrize(
    ("options", "mentions"),
    [
        ({"cvd": "red"}, "'red'"),
        ({"severity": 1.5}, "severity"),
        ({"severity": float("nan")}, "severity"),
        ({"strength": -1.0}, "strength"),
        ({"simulation": "vienot", "cvd": "tritan"}, "Viénot"),
        ({"enhancer": "magic"}, "magic"),
        ({"enhancer": "missing.safetensors"}, "missing.safetensors"),
        ({"device": "abacus"}, "--device"),
        ({"seed": -1}, "--seed"),
        ({"fit": 1001}, "--fit"),
        ({"change_budget": 0.0}, "--change-budget"),
    ],
)
def test_unusable_options_are_refused_before_anything_is_read(
    tmp_path: Path, options: dict[str, object], mentions: str
) -> None:
    with pytest.raises(InputError, match=mentions):
        run(tmp_path / "out", tmp_path / "not-there", **options)


def test_inputs_that_are_missing_empty_or_made_for_print_are_refused(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "notes.txt").write_text("x")
    with pytest.raises(InputError, match=r"no image.*notes\.txt"):
        run(tmp_path / "out", tmp_path / "in")
    with pytest.raises(InputError, match=r"gone\.png.*no such"):
        run(tmp_path / "out", tmp_path / "gone.png")
    with pytest.raises(InputError, match="CMYK"):
        run(tmp_path / "out", save(tmp_path / "print.jpg", mode="CMYK"))
    with pytest.raises(InputError, match="cannot be opened"):
        run(tmp_path / "out", tmp_path / "in" / "notes.txt")


def test_the_users_own_files_are_never_replaced(tmp_path: Path) -> None:
    photograph = save(tmp_path / "a.png")
    before = photograph.read_bytes()
    with pytest.raises(InputError, match="folder of photographs itself"):
        run(tmp_path, tmp_path)
    with pytest.raises(InputError, match=r"a\.png.*not made by an earlier run"):
        run(tmp_path, photograph)
    (tmp_path / "metrics.csv").write_text("file,output\nx,a.png\ny,../secret.png\n")
    with pytest.raises(InputError, match="result of an earlier run"):
        run(tmp_path, photograph)
    assert photograph.read_bytes() == before
    assert [path.name for path in enhanced_files(tmp_path)] == ["a.png", "sheet.html", "metrics.csv"]


@pytest.mark.parametrize("name", ["metrics.csv", "sheet.html"])
def test_a_table_or_page_of_the_users_own_is_not_replaced(tmp_path: Path, name: str) -> None:
    photograph = save(tmp_path / "a.png")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / name).write_text("picture,score\n")
    with pytest.raises(InputError, match=rf"{name}: already exists and was not made by an earlier run"):
        run(tmp_path / "out", photograph)


def test_a_table_of_another_program_names_nothing_of_ours(tmp_path: Path) -> None:
    (tmp_path / "metrics.csv").write_text("picture,score\na.png,1\n")
    assert enhanced_files(tmp_path) == []


def test_a_new_result_replaces_all_of_the_old_one_and_nothing_else(tmp_path: Path) -> None:
    out = tmp_path / "out"
    run(out, save(tmp_path / "old.png"))
    (out / "mine.png").write_text("the artist's own")
    request = EnhanceRequest((str(save(tmp_path / "new.png")),), str(out), enhancer="none")
    result = enhance(request, lambda event: None)
    assert result["summary"]["images"] == 1
    assert names(out) == ["metrics.csv", "mine.png", "new.png", "sheet.html"]


def start(*arguments: object, folder: Path | None = None) -> subprocess.Popen[str]:
    command = [sys.executable, str(ROOT / "scripts" / "enhance.py"), *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=folder)


def test_a_refusal_is_one_line_with_exit_code_2_and_leaves_nothing(tmp_path: Path) -> None:
    process = start(damaged(tmp_path / "in"), "--out", tmp_path / "out", "--enhancer", "none")
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 2
    assert "half.png" in errors.splitlines()[-1]
    assert "Traceback" not in errors
    assert not (tmp_path / "out").exists()


def test_an_unknown_option_is_one_line_and_exit_code_2(tmp_path: Path) -> None:
    process = start(tmp_path, "--out", tmp_path / "out", "--colour", "red")
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 2
    assert len(errors.splitlines()) == 1


@pytest.mark.parametrize(
    ("arguments", "said"),
    [(("", "--out", "out"), "inputs: a name is empty"), (("a.png", "--out", ""), "--out: no output folder")],
)
def test_an_empty_name_does_not_stand_for_the_current_folder(
    tmp_path: Path, arguments: tuple[str, ...], said: str
) -> None:
    save(tmp_path / "a.png")
    process = start(*arguments, folder=tmp_path)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 2
    assert errors.startswith(f"enhance.py: {said}")
    assert names(tmp_path) == ["a.png"]


@pytest.mark.parametrize("option", [("--seed", "-1"), ("--severity", "nan")])
def test_a_value_out_of_range_names_its_option(tmp_path: Path, option: tuple[str, str]) -> None:
    process = start(tmp_path, "--out", tmp_path / "out", *option)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 2
    assert errors.startswith(f"enhance.py: {option[0]}: {option[1]} is out of range")


@pytest.mark.parametrize(
    ("entries", "said"),
    [({"colour": "red"}, "unknown entries: colour"), ({"inputs": []}, "no photographs"), ({"inputs": "a"}, "no list")],
)
def test_a_request_with_unknown_entries_or_without_photographs_is_refused(
    entries: dict[str, object], said: str
) -> None:
    with pytest.raises(InputError, match=said):
        EnhanceRequest.from_dict({"inputs": ["a.png"], "out": "o", **entries})


def test_ctrl_c_ends_it_soon_and_leaves_nothing(tmp_path: Path) -> None:
    for number in range(30):
        save(tmp_path / "in" / f"{number}.png")
    process = start(tmp_path / "in", "--out", tmp_path / "out", "--enhancer", "lut", "--separately", "--json")
    assert process.stdout is not None
    for line in process.stdout:
        event = json.loads(line)
        if event["event"] == "status" and event["stage"] == "enhance":
            break
    process.send_signal(signal.SIGINT)
    assert process.wait(timeout=SOON) == 130
    assert not (tmp_path / "out").exists()
    process.communicate()
