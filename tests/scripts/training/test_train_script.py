"""scripts/train_enhancer.py: from nothing to weights that can be used, and complaints in one line."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from cvdgs.core.bootstrap import ROOT
from cvdgs.core.color.metrics import ccpr
from cvdgs.core.color.simulation import simulate
from cvdgs.core.color.spaces import image_to_tensor
from cvdgs.core.enhance import CganEnhancer
from cvdgs.scripts.training.data.kinds import draw

SCRIPT = ROOT / "scripts" / "train_enhancer.py"


def run(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, SCRIPT, *arguments], capture_output=True, text=True, check=False)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [(["--steps", "many"], "--steps"), (["--steps", "0"], "--steps"), (["--threads", "0"], "--threads")],
)
def test_unusable_arguments_get_one_line_and_exit_code_2(tmp_path, arguments, said):
    done = run(tmp_path / "out", *arguments)
    assert done.returncode == 2
    assert said in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_a_short_training_gives_weights_that_help(tmp_path):
    """Minutes on two cores: pairs, training, and the weights applied to cloth that was not trained on."""
    first = run(tmp_path, "--steps", "60")
    assert first.returncode == 0, first.stderr
    again = run(tmp_path, "--steps", "80")  # goes on from step 60 with the pairs that are there
    assert again.returncode == 0, again.stderr

    gains = []
    for seed in range(6):
        image = draw("tartan", 96, 96, np.random.default_rng([99, seed]), "deutan").image
        enhancer = CganEnhancer("deutan", 1.0, weights=tmp_path / "enhancer.safetensors", fit_steps=0)
        enhancer.fit([image])
        original, enhanced = image_to_tensor(image), image_to_tensor(enhancer(image))
        before, after = (ccpr(original, simulate(x, "deutan", 1.0))[0] for x in (original, enhanced))
        gains.append(after - before)
    assert np.nanmean(gains) > 0.03
