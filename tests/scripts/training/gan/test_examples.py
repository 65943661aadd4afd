"""Scenes follow from seed and number; pairs are fitted once and come back from their files."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from cvdgs.core.enhance.gan.prediction import SIDE
from cvdgs.core.errors import InputError
from cvdgs.scripts.training.gan.examples import DRAWN, KEPT, PAIRED, Pairs, draw_scene, watched


def test_a_scene_follows_from_seed_and_number():
    first = draw_scene(3, DRAWN, 5)
    draw_scene.cache_clear()
    again = draw_scene(3, DRAWN, 5)
    assert all(np.array_equal(a, b) for a, b in zip(first.views, again.views, strict=True))
    assert all(view.shape == (SIDE, SIDE, 3) for view in first.views)
    others = [draw_scene(3, stream, 5).views[0] for stream in (PAIRED, KEPT)]
    assert not any(np.array_equal(first.views[0], other) for other in others)


def test_budgets_and_observers_vary_about_what_a_scene_needs():
    drawing = draw_scene(3, DRAWN, 5)
    scenes = [watched(drawing, np.random.default_rng(seed)) for seed in range(12)]
    assert len({scene.observer for scene in scenes}) > 6
    assert all(0.3 <= scene.budget <= 8.0 for scene in scenes)


def test_a_pair_is_fitted_once(pairs):
    first = Pairs(pairs, 0)[0]
    written = {path: path.stat().st_mtime_ns for path in pairs.iterdir()}
    again = Pairs(pairs, 0)[0]
    assert {path: path.stat().st_mtime_ns for path in pairs.iterdir()} == written
    for one, other in zip(first.fitted.parameters(), again.fitted.parameters(), strict=True):
        assert torch.equal(one, other)
    assert again.fitted.observer == again.observer


def test_a_damaged_pair_is_named(pairs):
    (path,) = pairs.glob(f"{PAIRED}-*")
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(InputError, match=path.name):
        Pairs(pairs, 0)[0]
