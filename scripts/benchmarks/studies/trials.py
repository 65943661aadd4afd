"""Makes and measures the scenes of several recipes on one capture; work that recipes share is done once."""

from __future__ import annotations

import shutil
import tempfile
import time
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....core.capture.model import Capture
from ....core.consistency import relative_warping_error
from ....core.enhance import Enhancer, enhance_bytes
from ....core.evaluate.advice import advise
from ....core.evaluate.evaluation import Evaluation, SceneMatches, enhanced_path
from ....core.files.images import to_bytes, write_png
from ....core.pipeline.cameras import CheckedCameras, check_cameras
from ....core.pipeline.stages import Reconstruction, Stages
from ....core.runs.layout import ENHANCED_FOLDER
from ....core.runtime.protocol import Reporter
from ....core.runtime.resources import peak_memory_mb
from ....core.settings import Layer
from ....core.splats import raster
from ....core.splats.gaussians import Gaussians
from ....core.splats.renderer import SceneRenderer
from ....core.splats.targets import Background
from ....core.splats.training.trainer import TrainingResult
from ..provenance import fingerprint
from .captures import Subject
from .recipe import Recipe, Trial, described, recipe_enhancer

_MODE_OF_SHARED_GEOMETRY = "layers"  # the same as that of `post`


@dataclass(frozen=True)
class _Cost:
    """Seconds of a piece of work."""

    wall: float
    processor: float


@dataclass(frozen=True)
class _Enhanced:
    """A fitted enhancer, and the folders with its pictures of the given and of the judged views."""

    enhancer: Enhancer
    folder: Path
    judged: Path
    cost: _Cost


@dataclass(frozen=True)
class _Geometry:
    """A trained geometry, and the judged capture with the camera poses aligned to it."""

    cameras: CheckedCameras
    result: TrainingResult
    made: Reconstruction
    judged: Capture
    scene: SceneRenderer
    warnings: tuple[str, ...]
    cost: _Cost


@dataclass(frozen=True)
class EnhancedScene:
    """The scene that a recipe makes of a capture.

    Attributes:
        original: in the photographs' colours.
        layer: in the layer's colours; None if renderings of `original` are enhanced one by one.
        enhancer: fitted to the scene.
    """

    original: Gaussians
    layer: Gaussians | None
    enhancer: Enhancer

    def picture(self, scene: SceneRenderer, index: int) -> NDArray[np.uint8]:
        """(H, W, 3) from the camera with this index."""
        if self.layer is not None:
            return scene.color(self.layer, index)
        return to_bytes(self.enhancer(scene.color(self.original, index)))


class CaptureTrials:
    """Tries recipes on one subject.

    Args:
        name: of the subject in tables.
        subject: the capture.
        matches: between the views of the judged capture.
        folder: for the recipes' files, under ``<seed>/<fingerprint>/``.
        threads: of the rasteriser; None for all cores.
    """

    def __init__(
        self, name: str, subject: Subject, matches: SceneMatches, folder: Path, threads: int | None = None
    ) -> None:
        self._name = name
        self.subject = subject
        self._matches = matches
        self._folder = folder
        self._rasterizer = raster.Rasterizer("cpu", threads)
        self._background = Background.of(subject.judged.views)
        self._enhanced: dict[str, _Enhanced] = {}
        self._geometries: dict[str, _Geometry] = {}
        self._unenhanced: dict[str, float] = {}

    def close(self) -> None:
        """Remove files that only further recipes would need."""
        for enhanced in self._enhanced.values():
            shutil.rmtree(enhanced.folder, ignore_errors=True)

    def make(self, recipe: Recipe) -> EnhancedScene:
        """Make the scene of a recipe.

        Raises:
            InputError: the recipe or the capture cannot be used.
        """
        enhanced = self._enhance(recipe)
        geometry = self._reconstruct(recipe, enhanced)
        return self._layer(recipe, self._stages_after(recipe, geometry, enhanced), geometry.made, enhanced)

    def try_recipe(self, recipe: Recipe) -> Trial:
        """Make the scene of a recipe and measure it.

        Raises:
            InputError: the recipe or the capture cannot be used.
        """
        whole = _Clock()
        enhanced = self._enhance(recipe)
        geometry = self._reconstruct(recipe, enhanced)
        folder = recipe_folder(self._folder, recipe)
        stages = self._stages_after(recipe, geometry, enhanced)
        started = _Clock()
        made = self._layer(recipe, stages, geometry.made, enhanced)
        layer_cost = started.cost()
        picture = cache(partial(made.picture, geometry.scene))
        shutil.copytree(enhanced.judged / ENHANCED_FOLDER, folder / ENHANCED_FOLDER, dirs_exist_ok=True)
        evaluation = Evaluation(
            geometry.judged, self.subject.judged_split, recipe.simulation, geometry.scene, folder, Reporter()
        )
        figures = evaluation.run(geometry.made.original, {recipe.layer: picture}, self._matches)
        warnings = geometry.warnings
        if recipe.advised:
            warnings += self._advice(recipe, stages, geometry, made, figures, folder)
        return Trial(
            **described(self._name, recipe),
            **_figures(figures),
            gaussians=len(geometry.made.original),
            sh_degree=geometry.made.original.sh_degree,
            rwe_unenhanced=self._unenhanced_rwe(recipe.geometry_key),
            geometry_seconds=geometry.cost.wall,
            enhance_seconds=enhanced.cost.wall,
            layer_seconds=layer_cost.wall,
            processor_seconds=geometry.cost.processor + enhanced.cost.processor + layer_cost.processor,
            peak_memory_mb=peak_memory_mb() or 0,
            trial_seconds=whole.cost().wall,
            skipped_steps=geometry.result.skipped,
            warnings=" ".join(warnings),
            decision=str(geometry.result.decision.get("gaussians", "")),
            decided_on_held_out=geometry.result.decided_on_held_out,
        )

    def _stages(self, recipe: Recipe, folder: Path, reporter: Reporter) -> Stages:
        given, split = self.subject.given, self.subject.split
        settings = recipe.settings(str(given.source), str(folder))
        return Stages.of(settings, folder, reporter, given, split, self._rasterizer, plans=recipe.plans)

    def _stages_after(self, recipe: Recipe, geometry: _Geometry, enhanced: _Enhanced) -> Stages:
        """The stages after the training."""
        stages = self._stages(recipe, enhanced.folder, Reporter())
        return geometry.cameras.applied(stages).after(geometry.result)

    def _enhance(self, recipe: Recipe) -> _Enhanced:
        """The enhancer, fitted to the given training views, and its pictures of all given views."""
        key = recipe.enhancement_key
        if key not in self._enhanced:
            self._folder.mkdir(parents=True, exist_ok=True)
            # Another process may be trying other recipes on the same subject.
            folder = Path(tempfile.mkdtemp(prefix="enhanced-", dir=self._folder))
            enhancer, started = recipe_enhancer(recipe), _Clock()
            self._stages(recipe, folder, Reporter()).enhance({recipe.layer: enhancer})
            cost = started.cost()
            judged = folder if self.subject.is_ordinary else folder / "judged"
            self._enhanced[key] = _Enhanced(enhancer, folder, judged, cost)
            if not self.subject.is_ordinary:
                self._enhance_judged(recipe.layer, self._enhanced[key])
        return self._enhanced[key]

    def _reconstruct(self, recipe: Recipe, enhanced: _Enhanced) -> _Geometry:
        key = recipe.geometry_key
        if key not in self._geometries:
            recipe = recipe if recipe.mode == "joint" else replace(recipe, mode=_MODE_OF_SHARED_GEOMETRY)
            noted, started = _Warnings(), _Clock()
            stages = self._stages(recipe, enhanced.folder, noted)
            cameras = check_cameras(stages)
            stages = cameras.applied(stages)
            result = stages.train()
            made = stages.after(result).reconstruct(result)
            cost = started.cost()
            # If the judged capture has its own, correct lens, results are judged by that.
            judged = (
                self.subject.judged.zoomed(cameras.lens.factor) if self.subject.is_ordinary else self.subject.judged
            )
            judged = judged.moved(cameras.poses.poses).moved(result.moved_poses)
            scene = SceneRenderer(self._rasterizer, judged.views, self._background)
            self._geometries[key] = _Geometry(cameras, result, made, judged, scene, tuple(noted.names), cost)
        return self._geometries[key]

    def _unenhanced_rwe(self, geometry_key: str) -> float:
        """The warping error that reconstruction and resampling leave without any enhancement."""
        if geometry_key not in self._unenhanced:
            geometry = self._geometries[geometry_key]
            photographs = [geometry.judged.views[i].image for i in self._matches.views]
            rendered = [geometry.scene.color(geometry.made.original, i) for i in self._matches.views]
            error = relative_warping_error(photographs, rendered, self._matches.short)
            self._unenhanced[geometry_key] = error.ratio
        return self._unenhanced[geometry_key]

    def _layer(self, recipe: Recipe, stages: Stages, made: Reconstruction, enhanced: _Enhanced) -> EnhancedScene:
        layer = None
        if recipe.mode != "post":
            layer = stages.fit_layer(made, recipe.layer, enhanced.enhancer, Reporter())
        return EnhancedScene(made.original, layer, enhanced.enhancer)

    def _advice(
        self,
        recipe: Recipe,
        stages: Stages,
        geometry: _Geometry,
        made: EnhancedScene,
        figures: dict[str, Any],
        folder: Path,
    ) -> tuple[str, ...]:
        """Names of the product's warnings about a run on the given capture, based on figures of that capture."""
        if not self.subject.is_ordinary:
            picture = cache(partial(made.picture, stages.scene))
            figures, folder = stages.evaluate(geometry.made, {recipe.layer: picture}), stages.folder
        advice = advise(stages.capture, self.subject.split, folder, geometry.result.curve, figures)
        return tuple(warning.name for warning in (*stages.capture.warnings, *advice))

    def _enhance_judged(self, layer: Layer, enhanced: _Enhanced) -> None:
        """Write the enhanced judged photographs that evaluations compare with."""
        for view in self.subject.judged.views:
            pixels = enhance_bytes(enhanced.enhancer, view.image, view.alpha)
            write_png(enhanced_path(enhanced.judged, layer, view), pixels)


def recipe_folder(folder: Path, recipe: Recipe) -> Path:
    """The folder of a recipe's files, under the folder of its subject; the same under any label."""
    return folder / str(recipe.seed) / fingerprint("", lambda: (recipe.identity,))


class _Clock:
    """Started when it is made."""

    def __init__(self) -> None:
        self._wall, self._processor = time.perf_counter(), time.process_time()

    def cost(self) -> _Cost:
        """Since then."""
        return _Cost(time.perf_counter() - self._wall, time.process_time() - self._processor)


class _Warnings(Reporter):
    """Collects the names of warnings."""

    def __init__(self) -> None:
        self.names: list[str] = []

    def warning(self, name: str, message: str) -> None:
        self.names.append(name)


def _figures(report: dict[str, Any]) -> dict[str, Any]:
    """The figures of a trial from a report with one layer."""
    (layer,) = report["layers"].values()
    ccpr, global_ccpr, simulated = layer["ccpr"], layer["ccpr_global"], layer["ssim_simulated"]
    natural, rwe = layer["naturalness"], layer["rwe"]
    return {
        **report["reconstruction"],
        "ccpr_input": ccpr["input"],
        "ccpr_enhanced": ccpr["enhanced"],
        "ccpr_unenhanced": ccpr["unenhanced"],
        "ccpr": ccpr["rendered"],
        "global_ccpr_input": global_ccpr["input"],
        "global_ccpr": global_ccpr["rendered"],
        "ccfr": layer["ccfr"]["rendered"],
        "ssim_input": simulated["input"],
        "ssim_simulated": simulated["rendered"],
        "natural_ssim": natural["ssim"],
        "natural_psnr": natural["psnr"],
        "delta_e": natural["delta_e"],
        "psnr_to_enhanced": layer["psnr_to_enhanced"],
        "rwe": rwe["ratio"],
        "rwe_absolute": rwe["absolute"],
        "rwe_long": rwe["long_range_ratio"],
        "rwe_normalised": rwe["normalised_ratio"],
        "rwe_enhanced": rwe["enhanced_ratio"],
    }
