"""The pictures of a study are those of the methods, and the control changes them as much as the scene network."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cvdgs.core.errors import InputError
from cvdgs.core.files.images import write_png
from cvdgs.core.runs.layout import ORIGINAL, TURNTABLE_FOLDER, picture_name
from cvdgs.scripts.benchmark import main
from cvdgs.scripts.benchmarks.baselines import mean_delta_e_2000
from cvdgs.scripts.benchmarks.observers.page import PAGE_FILE
from cvdgs.scripts.benchmarks.observers.stimuli import matched_by_gain, turntables
from cvdgs.scripts.benchmarks.observers.study import read_key

from .sessions import saved, session


def photographs(seed: int) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    return [np.kron(rng.integers(40, 200, (6, 8, 3)), np.ones((8, 8, 1))).astype(np.uint8) for _ in range(3)]


def finished_run(folder: Path, *, frames: int = 6, layers: tuple[str, ...] = ("deutan-1.0",), level: int = 90) -> Path:
    for number, layer in enumerate((ORIGINAL, *layers)):
        for frame in range(1, frames + 1):
            picture = np.full((30, 40, 3), level + 20 * number + frame, np.uint8)
            write_png(folder / TURNTABLE_FOLDER / layer / picture_name(frame), picture)
    return folder


def test_the_gain_changes_the_photographs_by_the_same_delta_e_2000() -> None:
    originals = photographs(0)
    enhanced = [np.clip(image + np.array([12, -8, 0]), 0, 255).astype(np.uint8) for image in originals]
    gained = matched_by_gain(originals, enhanced)
    changes = [
        np.mean([mean_delta_e_2000(*pair) for pair in zip(originals, some, strict=True)]) for some in (enhanced, gained)
    ]
    assert changes[1] == pytest.approx(changes[0], rel=0.03)


def test_turntables_of_two_runs_are_compared_with_the_original_one(tmp_path: Path) -> None:
    runs = {name: finished_run(tmp_path / name, level=level) for name, level in (("ours", 90), ("theirs", 120))}
    (stimulus,) = turntables(runs, "deutan", frames=3, max_size=20)
    assert [version.method for version in stimulus.versions] == [ORIGINAL, "ours", "theirs"]
    assert {len(version.frames) for version in stimulus.versions} == {3}
    changes = [version.delta_e for version in stimulus.versions]
    assert changes == sorted(changes)
    assert changes[0] == 0.0


def test_no_run_is_no_turntable() -> None:
    assert turntables({}, "deutan", 3, 20) == []


def test_a_run_without_a_layer_for_the_type_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="protan"):
        turntables({"ours": finished_run(tmp_path)}, "protan", 3, 20)


def test_turntables_have_the_severity_of_the_stills(tmp_path: Path) -> None:
    both = finished_run(tmp_path / "both", layers=("deutan-0.4", "deutan-1.0"))
    for picture in (both / TURNTABLE_FOLDER / "deutan-0.4").iterdir():
        picture.write_bytes(b"not looked at")
    assert len(turntables({"both": both}, "deutan", 3, 20)) == 1
    weaker = finished_run(tmp_path / "weaker", layers=("deutan-0.4",))
    with pytest.raises(InputError, match=r"no turntable for deutan-1\.0"):
        turntables({"weaker": weaker}, "deutan", 3, 20)


def test_turns_of_other_lengths_are_refused(tmp_path: Path) -> None:
    runs = {"a": finished_run(tmp_path / "a"), "b": finished_run(tmp_path / "b", frames=4)}
    with pytest.raises(InputError, match="4 frames"):
        turntables(runs, "deutan", 3, 20)


@pytest.mark.parametrize(
    "options", [["--cvd", "achromat"], ["--cvd", "deutan,deutan"], ["--stills", "0"], ["--run", "original=x"]]
)
def test_options_that_cannot_work_are_refused_before_anything_is_made(tmp_path: Path, options: list[str]) -> None:
    assert main(["observers", "--out", str(tmp_path), *options]) == 2
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_study_of_the_demo_is_made_and_analysed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = finished_run(tmp_path / "run")
    small = ["--max-size", "96", "--stills", "2", "--cvd", "deutan", "--run", f"ours={run}", "--frames", "3"]
    assert main(["observers", "--out", str(tmp_path / "study"), *small]) == 0
    key = read_key(tmp_path / "study")
    assert key.methods("still") == ["original", "lut", "scene", "gain"]
    assert key.methods("turntable") == ["original", "ours"]
    changes = {name: [i.delta_e for i in key.shown.values() if i.method == name] for name in ("scene", "gain")}
    assert np.mean(changes["gain"]) == pytest.approx(np.mean(changes["scene"]), rel=0.05)
    assert (tmp_path / "study" / PAGE_FILE).stat().st_size > 10_000
    assert str(tmp_path) not in (tmp_path / "study" / "observers-key.json").read_text(encoding="utf-8")
    files = [str(saved(tmp_path, session(key, seed))) for seed in range(4)]
    assert main(["observers", "--out", str(tmp_path / "study"), "--analyse", *files]) == 0
    assert "| all | visibility | scene | 4 |" in capsys.readouterr().out
    broken = tmp_path / "broken.json"
    broken.write_text("{", encoding="utf-8")
    assert main(["observers", "--out", str(tmp_path / "study"), "--analyse", str(broken)]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1
