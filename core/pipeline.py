"""The stages of a run up to Blender: capture, geometry, enhancement, colour layers, evaluation."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import warp as wp

from .capture import Capture, View, read_capture, write_capture
from .enhance import Enhancer, LutEnhancer, make_enhancer
from .errors import InputError
from .evaluate.evaluation import Evaluation, Split, enhanced_path
from .events import Reporter, StageSpan
from .images import read_png, to_bytes, write_png
from .report import SCHEMA, without_non_finite
from .run_facts import describe_device, peak_memory_mb, versions
from .settings import Layer, Settings
from .splats import raster
from .splats.gaussians import Gaussians
from .splats.layers import LayerPlan, fit_layer
from .splats.ply import write_ply
from .splats.renderer import SceneRenderer
from .splats.targets import Background
from .splats.trainer import Trainer, TrainingPlan, TrainingResult

# Longer side of the training images when --max-size is auto: what two cores train in minutes, and a GPU in one.
AUTO_MAX_SIZE = {"cpu": 640, "cuda": 1600}
# Upper bound of the number of Gaussians when --gaussians is auto: so many, and no more than the pixels can determine.
AUTO_GAUSSIANS = 40_000
PIXELS_PER_GAUSSIAN = 100
# A LUT's fit takes as long as applying it to so many views of 640 pixels.
LUT_FIT_VIEWS = 100


def run(settings: Settings, folder: Path, reporter: Reporter) -> dict[str, Any]:
    """Do the job that `settings` ask for and write its files into `folder`; returns the report.

    Raises:
        InputError: the capture or the options cannot be used.
    """
    clock = _Clock()
    recorder = _Recorder(reporter)
    device = _choose_device(settings.device)
    enhancers = _make_enhancers(settings, device)  # refuses what cannot be simulated before anything takes time
    with clock.measure("capture"):
        size = settings.max_size or AUTO_MAX_SIZE[device]
        capture = read_capture(Path(settings.capture), max_size=size, sfm=settings.sfm, reporter=recorder)
        write_capture(capture, folder / "capture")
    raster.load(device, recorder)
    split = _split(capture, settings.holdout, recorder)
    stages = _Stages(
        settings, folder, recorder, capture, split, raster.Rasterizer(device), Background.of(capture.views)
    )
    with clock.measure("geometry"):
        trained = stages.train()
    with clock.measure("enhance"):
        stages.enhance(enhancers)
    with clock.measure("layers"):
        layers = stages.fit_layers(trained.gaussians)
    with clock.measure("evaluate"):
        figures = stages.evaluate(trained.gaussians, layers)
    report = {
        "schema": SCHEMA,
        "versions": versions(),
        "device": describe_device(stages.rasterizer),
        "settings": settings.to_dict(),
        "capture": _describe_capture(capture, split),
        "gaussians": len(trained.gaussians),
        "gaussians_initial": trained.initial,
        "sh_degree": trained.gaussians.sh_degree,
        "seconds": {**clock.seconds, "blender": None, "total": None},
        "peak_memory_mb": peak_memory_mb(),
        "curve": trained.curve,
        "warnings": recorder.warnings,
        **figures,
    }
    return without_non_finite(report)


@dataclass(frozen=True)
class _Stages:
    """What the stages after the capture have in common, and the stages."""

    settings: Settings
    folder: Path
    reporter: Reporter
    capture: Capture
    split: Split
    rasterizer: raster.Rasterizer
    background: Background

    def train(self) -> TrainingResult:
        """Fit geometry and original colours to the photographs; writes ``splats.ply``."""
        views = self._views(self.split.train)
        plan = TrainingPlan(
            steps=self.settings.iterations,
            limit=self.settings.gaussians or _gaussian_limit(views),
            sh_degree=self.settings.sh_degree or 0,
        )
        trainer = Trainer(
            self.rasterizer,
            views,
            self._views(self.split.test),
            self.capture.points,
            self.capture.point_colors,
            plan,
            self.background,
            self.settings.seed,
        )
        result = trainer.train(self.reporter)
        write_ply(self.folder / "splats.ply", result.gaussians)
        return result

    def enhance(self, enhancers: dict[Layer, Enhancer]) -> None:
        """Write ``enhanced/<layer>/<view>.png`` for every view; the enhancers are fitted to the training views only.

        A LUT is also written as ``layer.<layer>.cube``, for grading tools.
        """
        training = self._views(self.split.train)
        costs = {layer: _fit_cost(enhancer) for layer, enhancer in enhancers.items()}
        total, done = sum(costs.values()) + len(enhancers) * len(self.capture.views), 0
        for layer, enhancer in enhancers.items():
            fit_cost = costs[layer]
            self.reporter.status("enhance", f"{layer.name}: fitting the enhancer")
            span = StageSpan(
                self.reporter, "enhance", done / total, (done + fit_cost) / total, f"{layer.name}: fitting"
            )
            enhancer.fit([view.image for view in training], span, alphas=[view.alpha for view in training])
            if isinstance(enhancer, LutEnhancer) and enhancer.lut is not None:
                cube = self.folder / f"layer.{layer.name}.cube"
                enhancer.lut.export_cube(cube, strength=self.settings.strength, title=f"cvdgs {layer.name}")
            done += fit_cost
            for view in self.capture.views:
                write_png(enhanced_path(self.folder, layer, view), to_bytes(enhancer(view.image)))
                done += 1
                self.reporter.progress("enhance", done / total, f"{layer.name}: {view.key}")

    def fit_layers(self, geometry: Gaussians) -> dict[Layer, Gaussians]:
        """Fit each layer's colours to its enhanced views; writes ``splats.<layer>.ply``."""
        fitted: dict[Layer, Gaussians] = {}
        for layer in self.settings.layers:
            message = f"{layer.name}: fitting colours"
            self.reporter.status("layers", message)
            views = [
                replace(view, image=read_png(enhanced_path(self.folder, layer, view)))
                for view in self._views(self.split.train)
            ]

            def progress(fraction: float, done: int = len(fitted), message: str = message) -> None:
                self.reporter.progress("layers", (done + fraction) / len(self.settings.layers), message)

            fitted[layer] = fit_layer(
                self.rasterizer, geometry, views, LayerPlan(), self.background, self.settings.seed, progress
            )
            write_ply(self.folder / f"splats.{layer.name}.ply", fitted[layer])
        return fitted

    def evaluate(self, original: Gaussians, layers: dict[Layer, Gaussians]) -> dict[str, Any]:
        """The report's figures; writes ``renders/``."""
        scene = SceneRenderer(self.rasterizer, self.capture.views, self.background)
        evaluation = Evaluation(self.capture, self.split, self.settings.simulation, scene, self.folder, self.reporter)
        return evaluation.run(original, layers)

    def _views(self, indices: list[int]) -> list[View]:
        return [self.capture.views[i] for i in indices]


def _split(capture: Capture, holdout: int, reporter: Reporter) -> Split:
    """Every `holdout`-th view, from the first on, is for testing; at least two stay for training."""
    count = len(capture.views)
    test = list(range(0, count, holdout)) if holdout else []
    if test and count - len(test) < 2:
        reporter.warning("no-holdout", f"only {count} views, so none is held out: all figures are on training views")
        test = []
    return Split([i for i in range(count) if i not in test], test)


def _make_enhancers(settings: Settings, device: str) -> dict[Layer, Enhancer]:
    return {
        layer: make_enhancer(
            settings.enhancer,
            layer.cvd,
            layer.severity,
            settings.simulation,
            settings.strength,
            settings.seed,
            device,
        )
        for layer in settings.layers
    }


def _fit_cost(enhancer: Enhancer) -> int:
    """As how many applications to a view a fit counts for the progress."""
    return LUT_FIT_VIEWS if isinstance(enhancer, LutEnhancer) else 1


def _gaussian_limit(views: list[View]) -> int:
    pixels = sum(view.camera.width * view.camera.height for view in views)
    return min(AUTO_GAUSSIANS, max(pixels // PIXELS_PER_GAUSSIAN, 1000))


def _choose_device(asked: str) -> str:
    if asked == "cuda" and not wp.is_cuda_available():
        raise InputError("no CUDA device is found", where="--device", remedy="use --device cpu, or check the driver")
    # The CUDA kernels compile but have not been measured yet, so they run only when asked for.
    return "cuda" if asked == "cuda" else "cpu"


def _describe_capture(capture: Capture, split: Split) -> dict[str, Any]:
    first = capture.views[0].camera
    return {
        "format": capture.format,
        "views": len(capture.views),
        "train": len(split.train),
        "test": len(split.test),
        "width": first.width,
        "height": first.height,
        "points": len(capture.points),
    }


class _Clock:
    """Seconds of each stage."""

    def __init__(self) -> None:
        self.seconds: dict[str, float | None] = {}

    @contextmanager
    def measure(self, stage: str) -> Iterator[None]:
        """Time the block as `stage`."""
        started = time.perf_counter()
        yield
        self.seconds[stage] = round(time.perf_counter() - started, 2)


class _Recorder(Reporter):
    """Passes everything on and keeps the warnings for the report."""

    def __init__(self, inner: Reporter) -> None:
        self._inner = inner
        self.warnings: list[dict[str, str]] = []

    def status(self, stage: str, message: str) -> None:
        self._inner.status(stage, message)

    def progress(self, stage: str, fraction: float, message: str = "") -> None:
        self._inner.progress(stage, fraction, message)

    def warning(self, name: str, message: str) -> None:
        self.warnings.append({"name": name, "message": message})
        self._inner.warning(name, message)
