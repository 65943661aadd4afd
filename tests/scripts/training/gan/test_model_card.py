"""Published weights come with a card that says what they are, how they were made, and what was measured."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from cvdgs.core.enhance.gan.weights import SHIPPED, load_shipped, save_generator
from cvdgs.core.errors import InputError
from cvdgs.scripts.training.gan.training import TrainingSettings
from cvdgs.scripts.training.model_card import publish

from ....core.enhance.gan.networks import random_generator

DATASET = {"samples": 12, "kinds": {"plate": 5, "tartan": 7}, "size": 96, "observers": 4, "seed": 3, "teacher": "lut"}
REPORT = (
    "# Enhancers compared\n\nImages: some.\n\n## Figures to reach: cgan\n\n| what | measured |\n\n## Plates\n\nmore\n"
)


@pytest.fixture
def training(tmp_path: Path) -> Path:
    notes = {
        "settings": json.dumps(TrainingSettings(seed=3).to_dict()),
        "dataset": json.dumps(DATASET),
        "date": "2026-11-21",
        "device": "2 processor cores",
        "step": "70",
    }
    (tmp_path / "training").mkdir()
    save_generator(random_generator(), tmp_path / "training" / "enhancer.safetensors", notes)
    return tmp_path / "training"


def test_weights_are_published_with_a_card(training, tmp_path):
    (tmp_path / "bench").mkdir()
    (tmp_path / "bench" / "enhancer.md").write_text(REPORT, encoding="utf-8")
    card = publish(training, [tmp_path / "bench"], tmp_path / "shipped").read_text(encoding="utf-8")
    load_shipped(tmp_path / "shipped" / SHIPPED.name)
    for said in (
        "2026-11-21",
        "seed 3",
        "5 plate, 7 tartan",
        "Images: some.",
        "| what | measured |",
    ):
        assert said in card
    assert "more" not in card


def test_nothing_is_published_without_a_measurement(training, tmp_path):
    with pytest.raises(InputError, match="no comparison"):
        publish(training, [tmp_path / "bench"], tmp_path / "shipped")
    assert not (tmp_path / "shipped").exists()
