"""The step benchmark measures what it says and changes nothing."""

from __future__ import annotations

import numpy as np
import pytest

from cvdgs.core.splats.raster.benchmark import (
    STAGES,
    benchmark_camera,
    benchmark_step,
    random_gaussians,
)


def test_the_step_is_the_sum_of_its_stages():
    times = benchmark_step(
        random_gaussians(500, 64, 48, sh_degree=1), benchmark_camera(64, 48), threads=2, repetitions=9
    )
    assert set(times.stages) == {*STAGES, "step"}
    assert times.gaussians == 500
    assert times.intersections > 500
    assert all(0.0 < stage.fastest <= stage.wall for stage in times.stages.values())
    fastest = [times.stages[name].fastest for name in STAGES]
    assert sum(fastest) <= times.stages["step"].fastest * 1.001


@pytest.mark.parametrize("kind", [np.uint8, np.float32])
def test_photographs_of_either_kind_are_taken_and_left_alone(kind):
    gaussians = random_gaussians(50, 20, 10)
    target = np.random.default_rng(0).integers(0, 2, (10, 20, 3)).astype(kind)
    before = target.copy(), gaussians.means.copy()
    benchmark_step(gaussians, benchmark_camera(20, 10), target, threads=1, repetitions=2)
    np.testing.assert_array_equal(target, before[0])
    np.testing.assert_array_equal(gaussians.means, before[1])


def test_most_random_gaussians_lie_in_the_image():
    gaussians, camera = random_gaussians(2000, 90, 60), benchmark_camera(90, 60)
    x, y, z = gaussians.means.T
    u, v = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
    assert ((u >= 0) & (u < 90) & (v >= 0) & (v < 60)).mean() > 0.75
