"""Enhancers learn from a run's training views alone, and every photograph of it is recoloured by what they learned."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cvdgs.core.capture.model import Capture, PinholeCamera, View
from cvdgs.core.evaluate.evaluation import Split
from cvdgs.core.files.images import read_png
from cvdgs.core.pipeline.stages import Stages
from cvdgs.core.runtime.protocol import Reporter
from cvdgs.core.settings import Layer, Settings
from cvdgs.core.splats.raster import Rasterizer

LAYER = Layer("protan", 1.0)


class Negative:
    """An enhancer like a package's, which remembers what it was fitted to."""

    def fit(self, images, reporter=None, *, alphas=None) -> None:
        self.images, self.alphas = list(images), alphas

    def __call__(self, image: NDArray) -> NDArray[np.float32]:
        return 1.0 - image.astype(np.float32) / np.float32(255.0)


def noise(seed: int, *shape: int) -> NDArray[np.uint8]:
    return np.random.default_rng(seed).integers(0, 256, shape, np.uint8)


def capture_of(folder: Path) -> Capture:
    """Four views: one with a second photograph, one cut out, one with a mask."""
    camera = PinholeCamera(20, 16, 20.0, 20.0, 10.0, 8.0)
    views = [View(f"{i}", Path(f"{i}.png"), camera, np.eye(4), noise(i, 16, 20, 3)) for i in range(4)]
    views[0] = replace(views[0], again=noise(9, 16, 20, 3))
    views[1] = replace(views[1], alpha=noise(1, 16, 20))
    views[2] = replace(views[2], mask=noise(2, 16, 20) > 99)
    points = np.zeros((0, 3), np.float32)
    return Capture(folder, "rendered", tuple(views), points, points.astype(np.uint8))


def test_an_enhancer_learns_from_what_training_views_show_and_recolours_all_photographs(tmp_path: Path) -> None:
    capture, enhancer = capture_of(tmp_path), Negative()
    settings, split = Settings("photographs", str(tmp_path)), Split([1, 2], [0, 3])
    Stages.of(settings, tmp_path, Reporter(), capture, split, Rasterizer("cpu")).enhance({LAYER: enhancer})
    views = capture.views
    for image, index in zip(enhancer.images, split.train, strict=True):
        np.testing.assert_array_equal(image, views[index].image)
    cut_out, masked = enhancer.alphas
    np.testing.assert_array_equal(cut_out, views[1].alpha)
    np.testing.assert_array_equal(masked, np.where(views[2].mask, 255, 0))
    made = tmp_path / "enhanced" / LAYER.name
    for view in views:
        np.testing.assert_array_equal(read_png(made / f"{view.key}.png"), 255 - view.image)
    (second,) = made.glob("*/*.png")
    np.testing.assert_array_equal(read_png(second), 255 - views[0].again)
