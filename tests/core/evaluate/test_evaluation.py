"""What is measured of a run, and the pictures that are left of it, are of the right views in the right colours."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cvdgs.core.capture.model import Capture, PinholeCamera, View
from cvdgs.core.color.simulation import Observer
from cvdgs.core.color.srgb import simulate_bytes
from cvdgs.core.evaluate.evaluation import Evaluation, SceneMatches, Split
from cvdgs.core.evaluate.scores import Scorer
from cvdgs.core.files.images import read_png, write_png
from cvdgs.core.runtime.protocol import Reporter
from cvdgs.core.settings import Layer
from cvdgs.core.splats.raster import Rasterizer
from cvdgs.core.splats.renderer import SceneRenderer

from ..splats.training.test_trainer import BLACK, look_at, wall

LAYER, MODEL = Layer("deutan", 0.6), "vienot"
HELD_OUT = 1


def patches(seed: int) -> np.ndarray:
    """(48, 64, 3) in random colours."""
    return np.random.default_rng(seed).integers(0, 256, (6, 8, 3), np.uint8).repeat(8, 0).repeat(8, 1)


def test_a_held_out_view_is_scored_and_shown_as_it_is_and_as_the_observer_sees_it(tmp_path: Path) -> None:
    camera = PinholeCamera(64, 48, 70.0, 70.0, 32.0, 24.0)
    poses = [look_at(np.array([x, 0.0, 0.0]), [0.0, 100.0, 0.0]) for x in (-9.0, 0.0, 9.0)]
    views = tuple(View(f"{i}", Path(f"{i}.png"), camera, pose, patches(i)) for i, pose in enumerate(poses))
    enhanced, rendered = patches(10), {i: patches(20 + i) for i in range(3)}
    for view in views:
        write_png(tmp_path / "enhanced" / LAYER.name / f"{view.key}.png", enhanced)
    points = np.zeros((0, 3), np.float32)
    capture = Capture(tmp_path, "rendered", views, points, points.astype(np.uint8))
    scene, original = SceneRenderer(Rasterizer("cpu"), views, BLACK), wall(300)
    evaluation = Evaluation(capture, Split([0, 2], [HELD_OUT]), MODEL, scene, tmp_path, Reporter())
    figures = evaluation.run(original, {LAYER: rendered.__getitem__}, SceneMatches([0, 1, 2], [], []))

    unenhanced = scene.color(original, HELD_OUT)
    renders = tmp_path / "renders"
    for place, picture in {
        "original": unenhanced,
        f"{LAYER.name}": rendered[HELD_OUT],
        f"{LAYER.name}/simulated": simulate_bytes(rendered[HELD_OUT], "deutan", 0.6, MODEL),
        f"{LAYER.name}/simulated_input": simulate_bytes(views[HELD_OUT].image, "deutan", 0.6, MODEL),
    }.items():
        assert [path.name for path in (renders / place).glob("*.png")] == [f"{HELD_OUT}.png"]
        np.testing.assert_array_equal(read_png(renders / place / f"{HELD_OUT}.png"), picture)

    found, scorer = figures["layers"][LAYER.name], Scorer(views[HELD_OUT].image, Observer("deutan", 0.6, MODEL))
    versions = {
        "input": views[HELD_OUT].image,
        "enhanced": enhanced,
        "rendered": rendered[HELD_OUT],
        "unenhanced": unenhanced,
    }
    for name, version in versions.items():
        assert found["ccpr"][name] == pytest.approx(scorer.ccpr(version)), name
    assert found["psnr_to_enhanced"] == pytest.approx(scorer.psnr_between(enhanced, rendered[HELD_OUT]))
    assert found["naturalness"]["delta_e"] == pytest.approx(scorer.naturalness(enhanced).delta_e_2000)
    assert figures["reconstruction"]["psnr"] == pytest.approx(scorer.psnr_between(views[HELD_OUT].image, unenhanced))
