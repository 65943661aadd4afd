"""Training improves the prediction, can be stopped anywhere, and goes on as if it had not been."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from cvdgs.core.enhance.gan.networks import Generator, GeneratorConfig
from cvdgs.core.enhance.gan.weights import load_generator
from cvdgs.core.errors import InputError
from cvdgs.core.runtime.protocol import Reporter
from cvdgs.scripts.training.gan.examples import Pairs
from cvdgs.scripts.training.gan.training import (
    CHECKPOINT,
    LOG,
    WEIGHTS,
    Training,
    TrainingSettings,
    judge_kept,
)
from cvdgs.scripts.training.model_card import publish

QUICK = TrainingSettings(
    steps=4,
    correction_share=0.5,
    drawn=1,
    window=3,
    pairs=(1, 1),
    log_every=2,
    checkpoint_every=0.0,
    kept=1,
    generator=GeneratorConfig(widths=(4, 6, 8, 8), attentions=3, embedding=8, code=6),
)


class Interrupts(Reporter):
    """Stops a training after a step, as Ctrl-C would."""

    def __init__(self, step: int) -> None:
        self._step = step

    def progress(self, stage: str, fraction: float, message: str = "") -> None:
        if message == f"step {self._step}":
            raise KeyboardInterrupt


def weights(folder: Path) -> list[torch.Tensor]:
    return list(load_generator(folder / WEIGHTS).parameters())


def test_an_interrupted_training_ends_where_an_uninterrupted_one_does(tmp_path, pairs):
    Training(tmp_path, QUICK).run(Reporter())
    whole = weights(tmp_path)
    for path in (CHECKPOINT, WEIGHTS, LOG):
        (tmp_path / path).unlink()
    with pytest.raises(KeyboardInterrupt):
        Training(tmp_path, QUICK).run(Interrupts(3))
    with open(tmp_path / LOG, "a", encoding="utf-8") as file:
        file.write("4,1,1.0,1.0,1.0,1.0,1.0,1.0\n")  # of a step that the checkpoint does not hold
    resumed = Training(tmp_path, QUICK)
    assert resumed.step == 2  # what the checkpoint before the interruption says
    resumed.run(Reporter())
    for one, other in zip(whole, weights(tmp_path), strict=True):
        assert torch.allclose(one, other, atol=1e-6)
    with open(tmp_path / LOG, newline="", encoding="utf-8") as file:
        assert [int(row["step"]) for row in csv.DictReader(file)] == [2, 4]


@pytest.mark.slow
def test_training_improves_on_the_scenes_it_sees(tmp_path, pairs):
    settings = replace(QUICK, steps=24, window=1, rate=4e-3, average_decay=0.5, log_every=24)
    seen = [Pairs(pairs, 0)[0]]
    torch.manual_seed(0)
    before, _ = judge_kept(Generator(settings.generator), seen, corrected=False)
    training = Training(tmp_path, settings)
    training.run(Reporter())
    after, _ = judge_kept(training.average, seen, corrected=False)
    assert after < before


def test_at_the_end_nothing_but_the_sizes_of_corrections_is_learned(tmp_path, pairs):
    with pytest.raises(KeyboardInterrupt):
        Training(tmp_path, QUICK).run(Interrupts(3))
    before = load_generator(tmp_path / WEIGHTS).state_dict()
    training = Training(tmp_path, QUICK)
    assert training.step == 2
    training.run(Reporter())
    after = load_generator(tmp_path / WEIGHTS).state_dict()
    assert [name for name, value in after.items() if not torch.equal(value, before[name])] == ["rates"]
    untrained = Generator(QUICK.generator).rates
    assert torch.equal(before["rates"], untrained)


def test_the_log_has_a_line_for_every_interval(tmp_path, pairs):
    Training(tmp_path, QUICK).run(Reporter())
    with open(tmp_path / LOG, newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [int(row["step"]) for row in rows] == [2, 4]
    assert all(float(row["discriminator"]) > 0.0 for row in rows)


def test_other_settings_do_not_continue_a_run(tmp_path, pairs):
    Training(tmp_path, QUICK).run(Reporter())
    with pytest.raises(InputError, match=r"other settings.*l1_weight"):
        Training(tmp_path, replace(QUICK, l1_weight=3.0))
    assert Training(tmp_path, replace(QUICK, steps=99)).step == QUICK.steps


def test_a_damaged_checkpoint_is_refused(tmp_path, pairs):
    Training(tmp_path, QUICK).run(Reporter())
    path = tmp_path / CHECKPOINT
    path.write_bytes(path.read_bytes()[:-50])
    with pytest.raises(InputError, match="checkpoint cannot be read"):
        Training(tmp_path, QUICK)


def test_without_an_adversary_only_the_generator_learns(tmp_path, pairs):
    training = Training(tmp_path, replace(QUICK, adversarial_weight=0.0))
    before = [value.clone() for value in training._discriminator.parameters()]
    training.run(Reporter())
    assert all(torch.equal(a, b) for a, b in zip(before, training._discriminator.parameters(), strict=True))


def test_weights_are_published_with_a_card(tmp_path, pairs):
    notes = {"settings": '{"seed": 7, "steps": 4}', "date": "2026-11-23"}
    Training(tmp_path, QUICK).run(Reporter(), notes)
    card = publish(tmp_path / WEIGHTS, tmp_path / "shipped").read_text(encoding="utf-8")
    assert "2026-11-23, seed 7, step 4 of 4" in card
    assert (tmp_path / "shipped" / WEIGHTS).read_bytes() == (tmp_path / WEIGHTS).read_bytes()
