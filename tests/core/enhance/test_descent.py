"""Our Adam against torch's own, and what it is there for."""

import subprocess
import sys

import torch

from cvdgs.core.enhance.descent import Adam

FITS = """
import sys
import numpy as np
from cvdgs.core.color.simulation import Observer
from cvdgs.core.enhance.lut_fit import LutSettings, fit_lut
from cvdgs.core.enhance.scene.fit import FitSettings, fit_network
stripes = [np.tile(np.array([(200, 50, 25), (100, 125, 25)], np.uint8), (16, 8, 1))]
fit_lut(stripes, "deutan", 1.0, settings=LutSettings(steps=2, relaxations=0))
fit_network(stripes, Observer("deutan", 1.0), settings=FitSettings(start_steps=1, table_steps=1, steps=2))
sys.exit("torch._dynamo" in sys.modules)
"""


def test_its_steps_are_those_of_torchs_optimiser_to_the_last_bit():
    generator = torch.Generator().manual_seed(0)
    ours, theirs = ([torch.linspace(-1.0, 1.0, 12).view(3, 4), torch.ones(5)] for _ in range(2))
    for one in (*ours, *theirs):
        one.requires_grad_()
    adam, oracle = Adam(ours, (0.9, 0.99)), torch.optim.Adam(theirs, 1.0, (0.9, 0.99))
    for step in range(30):
        target, rate = torch.rand((3, 4), generator=generator), 0.1 / (step + 1)
        losses = [((first - target) ** 2).sum() * (second**3).mean() for first, second in (ours, theirs)]
        adam.descend(losses[0], rate)
        oracle.param_groups[0]["lr"] = rate
        oracle.zero_grad()
        losses[1].backward()
        oracle.step()
    for mine, its in zip(ours, theirs, strict=True):
        assert torch.equal(mine, its)


def test_no_fit_waits_for_torchs_compiler_to_be_imported():
    assert subprocess.run([sys.executable, "-c", FITS], timeout=240).returncode == 0
