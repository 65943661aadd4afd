"""Training learns from pairs, can be stopped anywhere, and goes on as if it had not been."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from cvdgs.core.enhance.gan.networks import GeneratorConfig
from cvdgs.core.enhance.gan.weights import load_generator
from cvdgs.core.errors import InputError
from cvdgs.core.runtime.protocol import Reporter
from cvdgs.scripts.training.gan.batches import Examples
from cvdgs.scripts.training.gan.training import (
    CHECKPOINT,
    LOG,
    WEIGHTS,
    Training,
    TrainingSettings,
    validate,
)
from cvdgs.scripts.training.sweep import BASE, CHANGES, changed, sweep

from .pairs import OBSERVERS, StripedPairs

QUICK = TrainingSettings(
    steps=8,
    batch=2,
    crop=32,
    learning_rate=2e-3,
    discriminator_width=4,
    average_decay=0.9,
    generator=GeneratorConfig(widths=(6, 8, 12), embedding=8),
)


@pytest.fixture(scope="module")
def examples() -> Examples:
    return Examples(StripedPairs(6), range(4))


@pytest.fixture(scope="module")
def validation() -> Examples:
    return Examples(StripedPairs(6), [4, 5])


def weights(folder: Path) -> list[torch.Tensor]:
    return list(load_generator(folder / WEIGHTS).parameters())


class Interrupts(Reporter):
    """Stops a training at a step, as Ctrl-C would."""

    def __init__(self, step: int) -> None:
        self._step = step

    def progress(self, stage: str, fraction: float, message: str = "") -> None:
        if message.startswith(f"step {self._step},"):
            raise KeyboardInterrupt


def test_an_untrained_generator_is_the_teacher(tmp_path, examples, validation):
    figures = validate(Training(tmp_path, examples, validation, QUICK).average, validation)
    assert figures["distance"] < 0.02 * figures["shift"]  # greyish pixels are held
    assert figures["ccpr"] == pytest.approx(figures["ccpr_teacher"], abs=0.01)
    assert figures["ccpr_teacher"] > figures["ccpr_input"]


def test_training_improves_on_the_teacher(tmp_path, examples, validation):
    settings = replace(QUICK, steps=120, structure_weight=100.0)
    training = Training(tmp_path, examples, validation, settings)
    training.run()
    after = validate(training.average, validation)
    assert after["ssim"] > after["ssim_teacher"] + 0.01
    assert after["ccpr"] > after["ccpr_teacher"] - 0.01


def test_an_interrupted_training_ends_where_an_uninterrupted_one_does(tmp_path, examples, validation):
    Training(tmp_path / "whole", examples, validation, QUICK).run()
    with pytest.raises(KeyboardInterrupt):
        Training(tmp_path / "parts", examples, validation, QUICK).run(Interrupts(3))
    resumed = Training(tmp_path / "parts", examples, validation, QUICK)
    assert resumed.step == 3
    resumed.run()
    for whole, parts in zip(weights(tmp_path / "whole"), weights(tmp_path / "parts"), strict=True):
        assert torch.allclose(whole, parts, atol=1e-6)


def test_a_training_can_start_from_weights(tmp_path, examples, validation):
    Training(tmp_path / "first", examples, validation, QUICK).run()
    second = Training(tmp_path / "second", examples, validation, QUICK, start=tmp_path / "first" / WEIGHTS)
    for given, taken in zip(weights(tmp_path / "first"), second.average.parameters(), strict=True):
        assert torch.equal(given, taken)


def test_workers_share_a_batch_and_change_nothing(tmp_path, examples, validation):
    for workers in (1, 2):
        Training(tmp_path / str(workers), examples, validation, QUICK, workers=workers).run()
    for alone, shared in zip(weights(tmp_path / "1"), weights(tmp_path / "2"), strict=True):
        assert torch.allclose(alone, shared, atol=2e-4)


def test_workers_have_to_divide_the_batch(tmp_path, examples, validation):
    with pytest.raises(ValueError, match="3 workers"):
        Training(tmp_path, examples, validation, QUICK, workers=3)


def test_the_log_has_a_line_for_every_interval(tmp_path, examples, validation):
    Training(tmp_path, examples, validation, QUICK).run(log_every=4)
    with open(tmp_path / LOG, newline="", encoding="utf-8") as file:
        assert [int(row["step"]) for row in csv.DictReader(file)] == [4, 8]


def test_other_settings_do_not_continue_a_run(tmp_path, examples, validation):
    Training(tmp_path, examples, validation, QUICK).save()
    with pytest.raises(InputError, match=r"other settings.*contrast_weight"):
        Training(tmp_path, examples, validation, replace(QUICK, contrast_weight=3.0))
    assert Training(tmp_path, examples, validation, replace(QUICK, steps=99)).step == 0


def test_a_damaged_checkpoint_is_refused(tmp_path, examples, validation):
    Training(tmp_path, examples, validation, QUICK).save()
    path = tmp_path / CHECKPOINT
    path.write_bytes(path.read_bytes()[:-50])
    with pytest.raises(InputError, match="checkpoint cannot be read"):
        Training(tmp_path, examples, validation, QUICK)


def test_without_adversary_only_the_generator_learns(tmp_path, examples, validation):
    training = Training(tmp_path, examples, validation, replace(QUICK, adversarial_weight=0.0))
    before = [value.clone() for value in training._discriminator.parameters()]
    training.run()
    assert all(torch.equal(a, b) for a, b in zip(before, training._discriminator.parameters(), strict=True))


def test_the_rate_is_constant_and_then_falls_to_zero():
    rates = [QUICK.rate(step) for step in range(QUICK.steps + 1)]
    assert rates[: QUICK.steps // 2 + 1] == [1.0] * (QUICK.steps // 2 + 1)
    assert rates[-1] == 0.0
    assert np.allclose(np.diff(rates[QUICK.steps // 2 :]), -2.0 / QUICK.steps)


def test_crops_keep_input_and_target_together(examples):
    batch = examples.draw(np.random.default_rng(0), 16, 32, 0.5)
    assert batch.original.shape == batch.target.shape == (16, 3, 32, 32)
    # In the striped pairs red becomes darker and green lighter by the same amount, wherever the crop lies.
    red = batch.original[:, 0] > batch.original[:, 1]
    change = (batch.target - batch.original)[:, 0]
    assert torch.allclose(change, torch.where(red, -30.0, 30.0) / 255.0, atol=1e-5)


def test_every_observer_of_an_image_is_an_example(examples):
    assert len(examples) == 4 * len(OBSERVERS)
    assert {(o.cvd, o.severity, o.simulation) for o in examples.whole(range(len(examples))).observers} == set(OBSERVERS)


def test_variants_of_the_sweep_differ_from_the_base_in_what_they_say():
    for name, changes in CHANGES.items():
        assert (changed(QUICK, changes) == QUICK) == (name == BASE)


def test_a_sweep_compares_variants_and_does_not_repeat_them(tmp_path, examples, validation):
    names = [BASE, "no discriminator"]
    sweep(tmp_path, examples, validation, replace(QUICK, steps=2), names, "cpu", Reporter())
    table = (tmp_path / "sweep.md").read_text(encoding="utf-8")
    assert all(f"| {name} |" in table for name in names)
    stamp = (tmp_path / "sweep.csv").stat().st_mtime_ns
    sweep(tmp_path, examples, validation, replace(QUICK, steps=2), names, "cpu", Reporter())
    assert (tmp_path / "sweep.csv").stat().st_mtime_ns == stamp
