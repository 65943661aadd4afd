"""The simulation of 8-bit pictures against the differentiable one and an independent implementation."""

from __future__ import annotations

import daltonlens.simulate
import numpy as np
import pytest
import torch

from cvdgs.core.color.simulation import simulate
from cvdgs.core.color.srgb import simulate_bytes
from cvdgs.core.errors import InputError

CASES = [
    ("protan", 0.65, "machado"),
    ("deutan", 1.0, "machado"),
    ("deutan", 1.0, "vienot"),
    ("tritan", 0.5, "brettel"),
    ("achromat", 1.0, "machado"),
]


def picture(seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (300, 301, 3), np.uint8)


@pytest.mark.parametrize(("cvd", "severity", "model"), CASES)
def test_it_is_the_simulation_of_the_trainer_rounded_to_bytes(cvd, severity, model):
    pixels = picture()
    image = torch.from_numpy(pixels.astype(np.float64) / 255.0).permute(2, 0, 1)
    exact = simulate(image, cvd, severity, model).permute(1, 2, 0).numpy() * 255.0
    assert np.abs(simulate_bytes(pixels, cvd, severity, model) - exact).max() <= 0.5 + 1e-6


def test_it_agrees_with_daltonlens():
    simulator = daltonlens.simulate.Simulator_Machado2009()
    theirs = simulator.simulate_cvd(picture(), daltonlens.simulate.Deficiency.DEUTAN, severity=1.0)
    assert np.abs(simulate_bytes(picture(), "deutan", 1.0).astype(int) - theirs).max() <= 1


def test_severity_zero_changes_nothing():
    np.testing.assert_array_equal(simulate_bytes(picture(), "protan", 0.0), picture())


def test_what_cannot_be_simulated_is_refused():
    with pytest.raises(InputError, match="severity 2 is out of range"):
        simulate_bytes(picture(), "protan", 2.0)
