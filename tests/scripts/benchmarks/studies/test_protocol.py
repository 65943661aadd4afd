"""The protocol of Hu and Xiao (2026) on a made folder in the layout of Mip-NeRF 360."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from cvdgs.core.errors import InputError
from cvdgs.core.runtime.protocol import Reporter
from cvdgs.core.settings import Layer
from cvdgs.scripts.benchmarks.enhancers.frames import SelectionRule
from cvdgs.scripts.benchmarks.studies.protocol import (
    PAPER,
    FrameRun,
    filter_frames,
    scenes_of,
    sequences_of,
    summarise,
    table_one,
    write_frames,
)
from cvdgs.scripts.benchmarks.studies.recipe import Recipe, Trial, described
from cvdgs.scripts.benchmarks.tables import frame_of

from ....core.capture.make_captures import Shot, pinhole, write_colmap

DEUTAN = Layer("deutan", 1.0)
SHORT = SelectionRule(longer_than=2)
CONFUSED = np.array([(181, 109, 109), (109, 139, 109)], float)  # a deutan sees one colour
PLAIN = np.array([(40, 40, 40), (220, 220, 220)], float)


@dataclass
class Striped(Shot):
    """A photograph of stripes in two colours."""

    pair: np.ndarray = None

    def render(self) -> np.ndarray:
        columns = (np.arange(self.camera.width) // 4) % 2
        return np.repeat(self.pair[columns][None].astype(np.uint8), self.camera.height, axis=0)


@pytest.fixture(scope="module")
def scenes(tmp_path_factory) -> Path:
    """A folder of one scene whose frames 3 to 6 of nine are hard."""
    folder = tmp_path_factory.mktemp("mipnerf360")
    shots = []
    for number in range(9):
        pose = np.eye(4)
        pose[0, 3] = -0.1 * number
        pair = CONFUSED if 3 <= number <= 6 else PLAIN
        shots.append(Striped(f"DSCF{number:04d}.png", pinhole(), pose, pair))
    write_colmap(folder / "garden", shots, image_folder="images_4")
    return folder


@pytest.fixture(scope="module")
def frames(scenes, tmp_path_factory) -> pd.DataFrame:
    (scene,) = scenes_of(scenes, 96)
    (found,) = filter_frames(scene, ["none"], DEUTAN, tmp_path_factory.mktemp("frames"), Reporter()).values()
    return found


def test_a_folder_of_scenes_and_a_scene_are_both_taken(scenes):
    assert [scene.name for scene in scenes_of(scenes, 96)] == ["garden"]
    assert scenes_of(scenes / "garden", 96) == scenes_of(scenes, 96)


def test_a_folder_without_a_scene_is_refused(tmp_path):
    with pytest.raises(InputError, match="no scene in the layout of Mip-NeRF 360"):
        scenes_of(tmp_path, 96)


def test_hard_frames_are_found_in_the_order_of_recording(frames):
    assert (frames.kind == "hard").tolist() == [3 <= number <= 6 for number in range(9)]


def test_a_run_of_hard_frames_is_a_capture_of_its_own(scenes, frames):
    (scene,) = scenes_of(scenes, 96)
    assert sequences_of(scene, frames) == []
    (run,) = sequences_of(scene, frames, SHORT)
    assert run == FrameRun("garden-1", scene, 3, 6)
    subject = run.load()
    assert [view.key for view in subject.judged.views] == [f"DSCF{number:04d}" for number in range(3, 7)]
    assert len(subject.judged.points) > 0


def test_frames_that_were_filtered_are_kept(scenes, frames, tmp_path):
    (scene,) = scenes_of(scenes, 96)
    first = filter_frames(scene, ["none"], DEUTAN, tmp_path, Reporter())
    (kept,) = tmp_path.iterdir()
    kept.write_text(kept.read_text().replace(",hard,", ",easy,"))
    second = filter_frames(scene, ["none"], DEUTAN, tmp_path, Reporter())
    pd.testing.assert_frame_equal(first["none"], frames)
    assert set(second["none"].kind) == {"easy"}
    pd.testing.assert_frame_equal(second["none"].drop(columns="kind"), frames.drop(columns="kind"), check_exact=True)


def tried(title: str, *modes: str) -> pd.DataFrame:
    """Two seeds of an enhancer in each mode; RWE and CCPR differ by seed."""
    figures = {"ccpr_input": 0.7, "ssim_input": 0.6, "ssim_simulated": 0.8, "rwe": 0.9}
    trials = [
        Trial(
            **described("garden", Recipe(mode, mode, seed=seed)),
            **figures,
            ccpr=0.8 + 0.02 * seed,
            rwe_absolute=0.04 + 0.02 * seed,
        )
        for mode in modes
        for seed in (0, 1)
    ]
    return frame_of(Trial, trials).assign(title=title, seconds=30.0)


def test_table_one_has_the_paper_s_rows_first_and_the_means_of_ours_behind_them():
    found = table_one(pd.concat([tried("network", "post", "layers"), tried("gain", "layers")]))
    theirs, ours = found[found.capture == PAPER], found[found.capture == "garden"]
    assert theirs.ccpr.tolist() == [0.713, 0.842, 0.839]
    assert ours.title.tolist() == ["photographs", "network", "network"]  # gain was not tried in mode post
    assert ours["mode"].tolist() == ["", "post", "layers"]
    assert ours.ccpr.tolist() == pytest.approx([0.7, 0.81, 0.81])
    assert ours.rwe.tolist()[1:] == pytest.approx([0.05, 0.05])  # absolute, as theirs seem to be
    assert math.isnan(ours.rwe.iloc[0])


def test_easy_frames_are_measured_separately():
    frames = pd.DataFrame(
        [("easy", 0.98, 35.0), ("easy", 1.0, math.inf), ("between", 0.9, 25.0), ("hard", 0.1, 5.0)],
        columns=["kind", "ssim", "psnr"],
    )
    found = summarise("garden", "cgan", frames.assign(sequence=0))
    assert [found[name] for name in ("frames", "hard", "longest_run", "easy")] == [4, 1, 1, 2]
    assert found["easy_ssim"] == pytest.approx(0.99)
    assert found["easy_psnr"] == pytest.approx(35.0)
    assert found["others_ssim"] == pytest.approx(0.96)
    assert found["others_psnr"] == pytest.approx(30.0)


@pytest.mark.parametrize(
    ("easy", "ssim", "psnr", "verdict"),
    [(3, 0.976, 34.1, "yes"), (3, 0.974, 34.1, "no"), (3, 0.976, 33.9, "no"), (0, math.nan, math.nan, "no easy frame")],
)
def test_both_figures_have_to_be_reached(tmp_path, easy, ssim, psnr, verdict):
    counts = {"frames": 9, "hard": 4, "longest_run": 4, "sequences": 0, "easy": easy}
    figures = {"easy_ssim": ssim, "easy_psnr": psnr, "others_ssim": ssim, "others_psnr": psnr}
    scene = pd.DataFrame([{"scene": "garden", "enhancer": "cgan", **counts, **figures}])
    lines = write_frames(tmp_path, scene, tried("lut", "post"), ["By `a command`."])
    (row,) = (line for line in lines if line.startswith("| garden | cgan"))
    assert f" {verdict} |" in row
    assert "garden,cgan,9,4,4,0" in (tmp_path / "frames.csv").read_text()
