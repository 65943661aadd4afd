"""Measures a finished run: renders its held-out views, writes them, and computes the figures of the report."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..capture.model import Capture, View
from ..color.metrics import CCPR_THRESHOLD
from ..color.simulation import Observer
from ..color.srgb import simulate_bytes
from ..consistency import (
    Correspondences,
    CorrespondenceSettings,
    SceneCorrespondences,
    relative_warping_error,
    view_pairs,
)
from ..consistency.correspondence import LONG_RANGE_STEP, SHORT_RANGE_STEP
from ..files.images import read_png, write_png
from ..intake.sampling import evenly_spread
from ..runs.layout import (
    AGAIN_FOLDER,
    ENHANCED_FOLDER,
    ORIGINAL,
    RENDERS_FOLDER,
    SIMULATED_FOLDER,
    SIMULATED_INPUT_FOLDER,
)
from ..runtime.protocol import Reporter
from ..settings import Layer, Settings
from ..splats.gaussians import Gaussians
from ..splats.renderer import SceneRenderer
from .scores import Scorer, average, score_layer
from .second_photograph import ESTIMATED_FIGURES, SecondPhotographs, resampled, views_beside

STAGE = "evaluate"
# The metrics take about 0.3 s per view on two cores; more views hardly change their means.
MOST_SCORED_VIEWS = 24
VIEWS_SHOWN = 3
# Of which the second photographs are estimated: two surfaces are rendered and two pictures resampled for each.
MOST_ESTIMATED_VIEWS = 5
# Consecutive views, so that pairs at the defined distance exist however many views there are.
MOST_CONSISTENCY_VIEWS = 48

_SMEARED = "for PSNR and SSIM of the original colours each rendering is smeared like its photograph first"
_NOT_ESTIMATED = "not estimated at every size: too few places with contrast are seen in three photographs"


@dataclass(frozen=True)
class Split:
    """Indices of a capture's views."""

    train: list[int]
    test: list[int]

    @classmethod
    def every(cls, count: int, holdout: int = Settings.holdout) -> Split:
        """Hold out every `holdout`-th of `count` views for testing, from the first on, as the field does; 0: none."""
        test = range(0, count, holdout) if holdout else range(0)
        return cls([i for i in range(count) if i not in test], list(test))


@dataclass
class Evaluation:
    """The evaluation of one run.

    Attributes:
        capture: the photographs.
        split: the views that were trained on, and those held out.
        simulation: model of the CVD simulation.
        scene: renders from the capture's cameras.
        folder: of the run; ``enhanced/<layer>/<view>.png`` is read, ``renders/`` is written.
        reporter: receives the progress.
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
            layers: renders each layer, (H, W, 3), from the view with this index.
            matches: correspondences between the views.
        """
        notes: dict[str, str] = {}
        tested = self.split.test or evenly_spread(self.split.train, MOST_SCORED_VIEWS // 3)
        scored = evenly_spread(tested, MOST_SCORED_VIEWS)
        if not self.split.test:
            notes["reconstruction"] = "no view is held out: the figures come from training views and are optimistic"
        if any(self.capture.views[i].smear is not None for i in scored):
            notes["motion blur"] = _SMEARED
        self._steps = len(tested) * (1 + len(layers)) + 2 * len(layers)
        self.reporter.status(STAGE, f"rendering {len(tested)} views")
        unenhanced = self._render_original(original, tested)
        fidelity = [self.scene.fidelity(i, unenhanced[i]) for i in scored]
        if not matches.pairs:
            notes["rwe"] = "no two views have enough visible points in common"
        figures = {
            layer.name: self._layer(layer, picture, tested, scored, unenhanced, matches)
            for layer, picture in layers.items()
        }
        if not any(layer["pairs"] > 0.0 for layer in figures.values()):
            notes["contrast"] = f"no neighbouring pixels of the measured photographs differ by ΔE {CCPR_THRESHOLD:g}"
        surfaces = SceneCorrespondences(
            self.capture.views, lambda index: self.scene.depth(original, index), CorrespondenceSettings()
        )
        for layer in layers:
            for figure, values in self._estimated(layer, scored, surfaces).items():
                figures[layer.name][figure] |= values
                if len(values) < 2:
                    notes["second photographs"] = _NOT_ESTIMATED
        return {
            "reconstruction": {key: float(np.mean([view[key] for view in fidelity])) for key in ("psnr", "ssim")},
            "layers": figures,
            "views_shown": [self.capture.views[i].key for i in evenly_spread(tested, VIEWS_SHOWN)],
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
                photograph = view.blanked(view.image)
                scorer = Scorer(photograph, Observer(layer.cvd, layer.severity, self.simulation), self.scene.mask(i))
                again = {name: view.blanked(second) for name, second in self._again(layer, view).items()}
                enhanced, shown, unchanged = (view.blanked(one) for one in (enhanced, rendered, unenhanced[i]))
                scores.append(score_layer(scorer, photograph, enhanced, shown, unchanged, again))
            self._advance(layer.name)
        views = [self.capture.views[i] for i in matches.views]
        originals = [view.blanked(view.image) for view in views]
        enhanced_views = [view.blanked(read_png(enhanced_path(self.folder, layer, view))) for view in views]
        rendered_views = [view.blanked(picture(i)) for i, view in zip(matches.views, views, strict=True)]
        consistency = matches.warping_errors(originals, enhanced_views, rendered_views)
        self._advance(f"{layer.name}: view consistency")
        return {**average(scores), "rwe": consistency}

    def _estimated(
        self, layer: Layer, scored: Sequence[int], surfaces: SceneCorrespondences
    ) -> dict[str, dict[str, float]]:
        """CCPR at each size that second photographs would have, as taken and enhanced, where it can be told."""
        observer = Observer(layer.cvd, layer.severity, self.simulation)
        found: dict[str, dict[str, float]] = {figure: {} for figure in ESTIMATED_FIGURES}
        views = self.capture.views
        beside = views_beside(views, evenly_spread(scored, MOST_ESTIMATED_VIEWS))
        versions: dict[str, Callable[[int], NDArray[np.uint8]]] = {
            "again_estimated": lambda index: views[index].image,
            "again_enhanced_estimated": lambda index: read_png(enhanced_path(self.folder, layer, views[index])),
        }
        for name, picture in versions.items():
            estimate = SecondPhotographs(observer)
            for index, others in beside.items():
                photograph = views[index].image
                seen = [
                    resampled(picture(other), surfaces.between(index, other), photograph.shape[:2]) for other in others
                ]
                estimate.add(photograph, picture(index), seen, self.scene.mask(index))
            for figure, value in estimate.figures().items():
                if np.isfinite(value):
                    found[figure][name] = value
        self._advance(f"{layer.name}: second photographs")
        return found

    def _again(self, layer: Layer, view: View) -> dict[str, NDArray[np.uint8]]:
        """The second photograph of a view and the same enhanced, where there are any."""
        path = enhanced_path(self.folder, layer, view, again=True)
        if view.again is None or not path.is_file():
            return {}
        return {"again": view.again, "again_enhanced": read_png(path)}

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


def enhanced_path(folder: Path, layer: Layer, view: View, *, again: bool = False) -> Path:
    """Where a view's enhanced photograph is, or its enhanced second photograph."""
    place = folder / ENHANCED_FOLDER / layer.name
    return (place / AGAIN_FOLDER if again else place) / f"{view.key}.png"


def render_path(folder: Path, layer: Layer, view: View) -> Path:
    """Path of a layer's rendering from a view."""
    return folder / RENDERS_FOLDER / layer.name / f"{view.key}.png"


@dataclass(frozen=True)
class SceneMatches:
    """Correspondences between views.

    Attributes:
        views: indices of the matched views.
        short, long: between views that are `SHORT_RANGE_STEP` and `LONG_RANGE_STEP` apart, numbered within `views`.
    """

    views: list[int]
    short: list[Correspondences]
    long: list[Correspondences]

    @classmethod
    def find(cls, correspondences: SceneCorrespondences) -> SceneMatches:
        """Match the first views of a scene; pairs that were matched before are not matched again."""
        count = min(len(correspondences.views), MOST_CONSISTENCY_VIEWS)
        short, long = (
            correspondences.of_pairs(view_pairs(count, step)) for step in (SHORT_RANGE_STEP, LONG_RANGE_STEP)
        )
        return cls(list(range(count)), short, long)

    @property
    def pairs(self) -> int:
        """Number of pairs of neighbouring views with points in common."""
        return sum(len(found) > 0 for found in self.short)

    def warping_errors(
        self, originals: Sequence[NDArray], enhanced: Sequence[NDArray], rendered: Sequence[NDArray]
    ) -> dict[str, float | int]:
        """RWE of the rendered layer against the photographs, and of the enhanced views before reconstruction."""
        short = relative_warping_error(originals, rendered, self.short)
        return {
            "ratio": short.ratio,
            "absolute": short.absolute,
            "long_range_ratio": relative_warping_error(originals, rendered, self.long).ratio,
            "normalised_ratio": short.normalised_ratio,
            "enhanced_ratio": relative_warping_error(originals, enhanced, self.short).ratio,
            "pairs": self.pairs,
        }
