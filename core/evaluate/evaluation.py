"""Measures a finished run: renders its held-out views, writes them, and computes the figures of the report."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..capture import Capture, View
from ..color.simulated_bytes import simulate_bytes
from ..events import Reporter
from ..images import read_png, write_png
from ..run_files import ENHANCED_FOLDER, ORIGINAL, RENDERS_FOLDER, SIMULATED_FOLDER, SIMULATED_INPUT_FOLDER
from ..settings import Layer, Settings
from ..splats.gaussians import Gaussians
from ..splats.renderer import SceneRenderer
from .layer_scores import LayerImages, average, score_view
from .matches import SceneMatches

STAGE = "evaluate"
# The metrics cost about 0.3 s a view on two cores; more views than this move their means little.
MOST_SCORED_VIEWS = 24
VIEWS_SHOWN = 3


@dataclass(frozen=True)
class Split:
    """Indices of a capture's views."""

    train: list[int]
    test: list[int]

    @classmethod
    def every(cls, count: int, holdout: int = Settings.holdout) -> Split:
        """Of `count` views every `holdout`-th, from the first on, is held out for tests, as the field does; 0: none."""
        test = range(0, count, holdout) if holdout else range(0)
        return cls([i for i in range(count) if i not in test], list(test))


@dataclass
class Evaluation:
    """One evaluation of a run; `run` does it.

    Attributes:
        capture: the photographs.
        split: which of them were trained on.
        simulation: model behind the CVD simulation.
        scene: renders from the capture's cameras.
        folder: of the run; has ``enhanced/<layer>/<view>.png``, receives ``renders/``.
        reporter: hears of the progress.
    """

    capture: Capture
    split: Split
    simulation: str
    scene: SceneRenderer
    folder: Path
    reporter: Reporter
    _done: int = field(default=0, init=False)
    _steps: int = field(default=1, init=False)

    def run(
        self, original: Gaussians, layers: Mapping[Layer, Callable[[int], NDArray[np.uint8]]], matches: SceneMatches
    ) -> dict[str, Any]:
        """The report's ``reconstruction``, ``layers``, ``views_shown`` and ``notes``.

        Args:
            original: the scene in the photographs' colours.
            layers: how each layer looks from a view of this index, (H, W, 3).
            matches: between the views.
        """
        notes: dict[str, str] = {}
        tested = self.split.test or spread(self.split.train, MOST_SCORED_VIEWS // 3)
        if not self.split.test:
            notes["reconstruction"] = "no view is held out: the figures are on training views and flatter the result"
        scored = spread(tested, MOST_SCORED_VIEWS)
        self._steps = len(tested) * (1 + len(layers)) + len(layers)
        self.reporter.status(STAGE, f"rendering {len(tested)} views")
        unenhanced = self._render_original(original, tested)
        fidelity = [self.scene.fidelity(i, unenhanced[i]) for i in scored]
        if not matches.pairs:
            notes["rwe"] = "no two views share enough points that both see"
        return {
            "reconstruction": {key: float(np.mean([view[key] for view in fidelity])) for key in ("psnr", "ssim")},
            "layers": {
                layer.name: self._layer(layer, picture, tested, scored, unenhanced, matches)
                for layer, picture in layers.items()
            },
            "views_shown": [self.capture.views[i].key for i in spread(tested, VIEWS_SHOWN)],
            "notes": notes,
        }

    def _render_original(self, original: Gaussians, tested: Sequence[int]) -> dict[int, NDArray[np.uint8]]:
        rendered = {}
        for i in tested:
            rendered[i] = self.scene.color(original, i)
            write_png(self.folder / RENDERS_FOLDER / ORIGINAL / f"{self.capture.views[i].key}.png", rendered[i])
            self._advance("original colours")
        return rendered

    def _layer(
        self,
        layer: Layer,
        picture: Callable[[int], NDArray[np.uint8]],
        tested: Sequence[int],
        scored: Sequence[int],
        unenhanced: dict[int, NDArray[np.uint8]],
        matches: SceneMatches,
    ) -> dict[str, Any]:
        scores = []
        for i in tested:
            view = self.capture.views[i]
            rendered = picture(i)
            self._write_renders(layer, view, rendered)
            if i in scored:
                enhanced = read_png(enhanced_path(self.folder, layer, view))
                images = LayerImages(view.image, enhanced, rendered, unenhanced[i], self.scene.mask(i))
                scores.append(score_view(images, layer, self.simulation))
            self._advance(layer.name)
        originals = [self.capture.views[i].image for i in matches.views]
        enhanced_views = [read_png(enhanced_path(self.folder, layer, self.capture.views[i])) for i in matches.views]
        rendered_views = [picture(i) for i in matches.views]
        consistency = matches.warping_errors(originals, enhanced_views, rendered_views)
        self._advance(f"{layer.name}: view consistency")
        return {**average(scores), "rwe": consistency}

    def _write_renders(self, layer: Layer, view: View, rendered: NDArray[np.uint8]) -> None:
        path = render_path(self.folder, layer, view)
        place = path.parent
        write_png(path, rendered)
        observer = (layer.cvd, layer.severity, self.simulation)
        write_png(place / SIMULATED_FOLDER / f"{view.key}.png", simulate_bytes(rendered, *observer))
        write_png(place / SIMULATED_INPUT_FOLDER / f"{view.key}.png", simulate_bytes(view.image, *observer))

    def _advance(self, message: str) -> None:
        self._done += 1
        self.reporter.progress(STAGE, self._done / self._steps, message)


def enhanced_path(folder: Path, layer: Layer, view: View) -> Path:
    """Where a view's enhanced photograph is."""
    return folder / ENHANCED_FOLDER / layer.name / f"{view.key}.png"


def render_path(folder: Path, layer: Layer, view: View) -> Path:
    """Where the picture of a layer from a view is."""
    return folder / RENDERS_FOLDER / layer.name / f"{view.key}.png"


def spread(items: Sequence[int], count: int) -> list[int]:
    """At most `count` of `items`, evenly spread."""
    if len(items) <= count:
        return list(items)
    return [items[round(i)] for i in np.linspace(0, len(items) - 1, count)]
