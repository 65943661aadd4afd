"""The paired dataset: reproducible, resumable, and read only when it is whole."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cvdgs.core.color.simulation import Observer
from cvdgs.core.enhance.teacher import fit_luts
from cvdgs.core.errors import InputError
from cvdgs.core.files.images import to_bytes, write_png
from cvdgs.core.runtime.protocol import Reporter
from cvdgs.scripts.training.data.dataset import (
    FAST_TEACHER,
    MANIFEST,
    DatasetSettings,
    PairedDataset,
    make_dataset,
)
from cvdgs.scripts.training.data.kinds import PHOTOGRAPH, draw_observers
from cvdgs.scripts.training.gradient_teacher import GradientTeacher

SMALL = DatasetSettings(count=3, size=48, observers=2)
GRADIENT = replace(SMALL, teacher="gradient")  # sooner made where the teacher does not matter


@pytest.fixture(scope="module")
def lut_pairs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("pairs") / "lut"
    make_dataset(folder, SMALL)
    return folder


@pytest.fixture
def pairs(tmp_path: Path) -> Iterator[Path]:
    make_dataset(tmp_path / "pairs", GRADIENT)
    return tmp_path / "pairs"


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted((folder / "samples").iterdir())}


def test_targets_are_what_the_lut_teacher_makes_for_each_observer(lut_pairs: Path) -> None:
    dataset = PairedDataset(lut_pairs)
    assert len(dataset) == 3
    sample = dataset.sample(1)
    assert sample.input.shape == (48, 48, 3)
    assert sample.targets.shape == (2, 48, 48, 3)
    for observer, target in zip(sample.observers, sample.targets, strict=True):
        (lut,) = fit_luts([sample.input], [Observer(*observer)], settings=FAST_TEACHER, seed=1)
        assert np.array_equal(to_bytes(lut(sample.input)), target)


def test_targets_are_what_the_gradient_teacher_makes(pairs: Path) -> None:
    sample = PairedDataset(pairs).sample(0)
    teacher = GradientTeacher(*sample.observers[0], seed=0)
    teacher.fit([sample.input])
    assert np.array_equal(to_bytes(teacher(sample.input)), sample.targets[0])


def test_fitting_for_several_observers_at_once_gives_what_each_alone_gives() -> None:
    image = np.random.default_rng(0).integers(0, 256, (32, 32, 3), np.uint8)
    brief = replace(FAST_TEACHER, steps=10, relaxation_steps=5, pairs=200)
    observers = [Observer("deutan", 1.0), Observer("protan", 0.5, "brettel"), Observer("tritan", 0.3)]
    for observer, lut in zip(observers, fit_luts([image], observers, settings=brief), strict=True):
        (alone,) = fit_luts([image], [observer], settings=brief)
        assert np.allclose(lut.residual, alone.residual, atol=1e-6)
        assert lut.description == alone.description


@pytest.mark.slow
def test_the_result_does_not_depend_on_the_number_of_processes(pairs: Path, tmp_path: Path) -> None:
    make_dataset(tmp_path / "parallel", replace(GRADIENT, processes=2))
    assert contents(tmp_path / "parallel") == contents(pairs)


def test_a_second_run_makes_what_is_missing_or_damaged_and_keeps_the_rest(pairs: Path) -> None:
    before = contents(pairs)
    first, second, third = (pairs / "samples" / name for name in before)
    first.unlink()
    second.write_bytes(second.read_bytes()[:-1])
    kept = third.stat().st_mtime_ns
    make_dataset(pairs, GRADIENT)
    assert contents(pairs) == before
    assert third.stat().st_mtime_ns == kept


def test_an_interrupted_run_leaves_a_dataset_of_what_it_finished(tmp_path: Path) -> None:
    class Interrupted(Reporter):
        def progress(self, stage: str, fraction: float, message: str = "") -> None:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        make_dataset(tmp_path / "pairs", GRADIENT, Interrupted())
    dataset = PairedDataset(tmp_path / "pairs")
    assert len(dataset) == 1
    assert dataset.sample(0).input.shape == (48, 48, 3)


def test_a_dataset_can_grow(pairs: Path) -> None:
    before = contents(pairs)
    make_dataset(pairs, replace(GRADIENT, count=4))
    assert len(PairedDataset(pairs)) == 4
    assert {name: contents(pairs)[name] for name in before} == before


@pytest.mark.parametrize("change", [{"seed": 1}, {"size": 64}, {"teacher": "lut"}, {"observers": 1}])
def test_changed_settings_are_refused(pairs: Path, change: dict) -> None:
    with pytest.raises(InputError, match="other settings"):
        make_dataset(pairs, replace(GRADIENT, **change))


def test_a_folder_with_something_else_is_refused(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match="no paired dataset"):
        make_dataset(tmp_path, GRADIENT)
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]


@pytest.mark.parametrize(
    "change",
    [
        {"count": 0},
        {"size": 16},
        {"teacher": "nobody"},
        {"photograph_share": float("nan")},
        {"kind_shares": {"velvet": 1.0}},
        {"kind_shares": {"tartan": -1.0}},
        {"kind_shares": {}},
        {"photographs": ("no such folder",)},
    ],
)
def test_unusable_settings_are_refused(tmp_path: Path, change: dict) -> None:
    with pytest.raises(InputError):
        make_dataset(tmp_path / "pairs", replace(GRADIENT, **change))
    assert not (tmp_path / "pairs").exists()


def test_pieces_of_photographs_become_inputs(tmp_path: Path) -> None:
    shown = np.random.default_rng(0).integers(0, 256, (60, 80, 3), np.uint8)
    write_png(tmp_path / "photographs" / "a.png", shown)
    settings = replace(GRADIENT, count=1, photographs=(str(tmp_path / "photographs"),), photograph_share=1.0)
    make_dataset(tmp_path / "pairs", settings)
    assert PairedDataset(tmp_path / "pairs").sample(0).kind == PHOTOGRAPH
    entry = json.loads((tmp_path / "pairs" / MANIFEST).read_text())["samples"]["0"]
    assert entry["source"].startswith("photographs/a.png")


def test_images_drawn_to_confuse_a_type_are_seen_by_it() -> None:
    observers = draw_observers(4, "tritan", np.random.default_rng(0))
    assert [observer.cvd for observer in observers[:2]] == ["tritan", "tritan"]


def test_observers_are_of_all_types_and_severities_and_can_be_simulated() -> None:
    observers = draw_observers(2000, None, np.random.default_rng(0))
    shares = {cvd: np.mean([o.cvd == cvd for o in observers]) for cvd in ("protan", "deutan", "tritan", "achromat")}
    assert shares == pytest.approx({"protan": 0.32, "deutan": 0.36, "tritan": 0.22, "achromat": 0.10}, abs=0.04)
    assert np.mean([o.severity == 1.0 for o in observers]) == pytest.approx(0.45, abs=0.04)
    assert min(o.severity for o in observers) >= 0.2
    assert ("tritan", "vienot") not in {(o.cvd, o.simulation) for o in observers}


def test_a_damaged_sample_is_not_read(pairs: Path) -> None:
    path = pairs / "samples" / "000001.safetensors"
    content = bytearray(path.read_bytes())
    content[-1] ^= 1
    path.write_bytes(content)
    dataset = PairedDataset(pairs)
    dataset.sample(0)
    with pytest.raises(InputError, match="damaged"):
        dataset.sample(1)
    path.unlink()
    with pytest.raises(InputError, match="cannot be read"):
        dataset.sample(1)


def test_a_damaged_manifest_is_refused(pairs: Path) -> None:
    path = pairs / MANIFEST
    whole = json.loads(path.read_text())
    entry = whole["samples"]["0"]
    damaged = [
        "{",
        "[]",
        json.dumps({**whole, "format": "other"}),
        json.dumps({**whole, "version": 99}),
        json.dumps({**whole, "samples": []}),
        json.dumps({**whole, "samples": {"0": {**entry, "file": "../../secret"}}}),
        json.dumps({**whole, "samples": {"0": {**entry, "observers": [["deutan", 7.0, "machado"]]}}}),
        json.dumps({**whole, "samples": {"0": {"file": entry["file"]}}}),
    ]
    for text in damaged:
        path.write_text(text)
        with pytest.raises(InputError):
            PairedDataset(pairs)
    path.unlink()
    with pytest.raises(InputError, match="no paired dataset"):
        PairedDataset(pairs)


def test_the_summary_says_what_the_samples_are(pairs: Path) -> None:
    summary = PairedDataset(pairs).summary
    assert summary["samples"] == 3
    assert sum(summary["kinds"].values()) == 3
    assert summary["seed"] == 0
