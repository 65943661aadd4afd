"""The fused optimiser is torch's Adam on what was drawn, and leaves the rest alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
import warp as wp

from cvdgs.core.splats.raster import Adam, Gradients, LearningRates, ParameterSet, Rasterizer

from . import reference as reference

RATES = LearningRates(means=1e-2, log_scales=2e-2, quaternions=3e-2, opacity_logits=4e-2, sh0=5e-2, sh_rest=6e-3)


def gradients_of(values: dict[str, np.ndarray], touched: np.ndarray) -> Gradients:
    arrays = [wp.array(values[name], dtype=wp.float32, device="cpu") for name in reference.FIELDS]
    count = len(touched)
    return Gradients(
        *arrays,
        screen=wp.zeros(count, dtype=wp.float32, device="cpu"),
        screen_abs=wp.zeros(count, dtype=wp.float32, device="cpu"),
        touched=wp.array(touched.astype(np.uint8), dtype=wp.uint8, device="cpu"),
    )


def random_gradients(params: ParameterSet, seed: int) -> dict[str, np.ndarray]:
    """Of magnitudes from 1e-6 to 1, as they occur."""
    rng = np.random.default_rng(seed)
    shapes = {name: value.shape for name, value in params.numpy().items()}
    return {
        name: (rng.normal(size=shape) * 10 ** rng.uniform(-6, 0, size=shape)).astype(np.float32)
        for name, shape in shapes.items()
    }


class TorchAdam:
    """The oracle: torch.optim.Adam in float64, degree 0 and the higher degrees as groups of their own."""

    def __init__(self, params: ParameterSet, rates: LearningRates, betas=(0.9, 0.999), eps=1e-15) -> None:
        values = {name: torch.from_numpy(value.astype(np.float64)) for name, value in params.numpy().items()}
        values["sh0"], values["sh_rest"] = values["sh"][:, :1].clone(), values.pop("sh")[:, 1:].clone()
        self.values = {name: value.requires_grad_() for name, value in values.items()}
        groups = [{"params": [value], "lr": getattr(rates, name)} for name, value in self.values.items()]
        self.optimizer = torch.optim.Adam(groups, betas=betas, eps=eps)

    def step(self, gradients: dict[str, np.ndarray]) -> None:
        split = gradients | {"sh0": gradients["sh"][:, :1], "sh_rest": gradients["sh"][:, 1:]}
        for name, value in self.values.items():
            value.grad = torch.from_numpy(split[name].astype(np.float64))
        self.optimizer.step()

    def result(self) -> dict[str, np.ndarray]:
        out = {name: value.detach().numpy() for name, value in self.values.items()}
        out["sh"] = np.concatenate([out.pop("sh0"), out.pop("sh_rest")], 1)
        return out


def parameters(count: int, sh_degree: int) -> ParameterSet:
    return ParameterSet.from_gaussians(reference.random_scene(count, 64, 48, sh_degree=sh_degree, seed=count).gaussians)


@pytest.mark.parametrize("sh_degree", [0, 1, 3])
@pytest.mark.parametrize("count", [1, 64, 3001])
def test_steps_are_those_of_torch_where_everything_was_drawn(count, sh_degree):
    params = parameters(count, sh_degree)
    rasterizer = Rasterizer(threads=2)
    optimizer, oracle = Adam(params), TorchAdam(params, RATES)
    for step in range(12):
        gradients = random_gradients(params, step)
        optimizer.step(rasterizer, params, gradients_of(gradients, np.ones(count)), RATES)
        oracle.step(gradients)
    for name, value in params.numpy().items():
        # Twelve steps of at most 0.06 each, on values of order one, in float32.
        np.testing.assert_allclose(value, oracle.result()[name], atol=3e-6, rtol=1e-6, err_msg=name)


def test_bias_correction_holds_over_many_steps():
    params = parameters(3, 0)
    rasterizer = Rasterizer(threads=1)
    slow = LearningRates(*[1e-4] * 6)
    optimizer, oracle = Adam(params, betas=(0.8, 0.99), eps=1e-8), TorchAdam(params, slow, (0.8, 0.99), 1e-8)
    for step in range(700):
        gradients = random_gradients(params, step)
        optimizer.step(rasterizer, params, gradients_of(gradients, np.ones(3)), slow)
        oracle.step(gradients)
    for name, value in params.numpy().items():
        np.testing.assert_allclose(value, oracle.result()[name], atol=2e-4, err_msg=name)


def test_what_was_not_drawn_is_as_though_the_step_had_not_been():
    count = 200
    params = parameters(count, 1)
    before = {name: value.copy() for name, value in params.numpy().items()}
    rng = np.random.default_rng(0)
    rasterizer, optimizer = Rasterizer(threads=2), Adam(params)
    steps = [(random_gradients(params, seed), rng.uniform(size=count) < 0.5) for seed in range(6)]
    for gradients, touched in steps:
        optimizer.step(rasterizer, params, gradients_of(gradients, touched), RATES)
    for n in (0, 17, count - 1):
        alone = ParameterSet(
            *(wp.array(before[name][n : n + 1].copy(), dtype=wp.float32, device="cpu") for name in reference.FIELDS)
        )
        oracle = TorchAdam(alone, RATES)
        for gradients, touched in steps:
            if touched[n]:
                oracle.step({name: value[n : n + 1] for name, value in gradients.items()})
        for name, value in params.numpy().items():
            np.testing.assert_allclose(value[n], oracle.result()[name][0], atol=3e-6, err_msg=name)


def test_colour_gradients_move_the_degree_0_colours_alone():
    params = parameters(70, 1)
    before = {name: value.copy() for name, value in params.numpy().items()}
    gradients = random_gradients(params, 1)
    gradients["sh"][:, 1:] = 0.0
    given = replace(gradients_of(gradients, np.ones(70)), colors_only=True)
    Adam(params).step(Rasterizer(threads=1), params, given, RATES)
    after = params.numpy()
    for name in ("means", "log_scales", "quaternions", "opacity_logits"):
        np.testing.assert_array_equal(after[name], before[name])
    np.testing.assert_array_equal(after["sh"][:, 1:], before["sh"][:, 1:])
    assert (after["sh"][:, 0] != before["sh"][:, 0]).all()


def test_selection_carries_the_state_of_the_survivors_and_starts_the_fresh_anew():
    params = parameters(5, 0)
    rasterizer, optimizer = Rasterizer(threads=1), Adam(params)
    first, second = random_gradients(params, 1), random_gradients(params, 2)
    optimizer.step(rasterizer, params, gradients_of(first, np.ones(5)), RATES)
    index, fresh = np.array([4, 0, 0, 2]), np.array([False, False, True, False])
    chosen = ParameterSet(
        *(wp.array(value[index].copy(), dtype=wp.float32, device="cpu") for value in params.numpy().values())
    )
    start = {name: value.copy() for name, value in chosen.numpy().items()}
    optimizer.select(index, fresh)
    after = {name: value[index] for name, value in second.items()}
    optimizer.step(rasterizer, chosen, gradients_of(after, np.ones(4)), RATES)

    for row, source in enumerate(index):
        alone = ParameterSet(
            *(wp.array(start[name][row : row + 1].copy(), dtype=wp.float32, device="cpu") for name in reference.FIELDS)
        )
        oracle = TorchAdam(alone, LearningRates(0, 0, 0, 0, 0, 0))  # gathers moments without moving
        if not fresh[row]:
            oracle.step({name: value[source : source + 1] for name, value in first.items()})
        for group, name in zip(oracle.optimizer.param_groups, oracle.values, strict=True):
            group["lr"] = getattr(RATES, name)
        oracle.step({name: value[row : row + 1] for name, value in after.items()})
        for name, value in chosen.numpy().items():
            np.testing.assert_allclose(value[row], oracle.result()[name][0], atol=3e-6, err_msg=name)
