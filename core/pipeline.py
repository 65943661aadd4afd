"""The stages of a run up to Blender: capture, geometry, enhancement, colour layers, evaluation."""

from __future__ import annotations

import importlib.metadata
import platform
import resource
import sys
import time
from collections.abc import Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from .capture import Capture, View, read_capture, write_capture
from .consistency import find_correspondences, relative_warping_error, view_pairs
from .enhance import make_enhancer
from .errors import InputError
from .evaluate.layer_scores import LayerImages, average, score_view, simulated_bytes
from .events import Reporter
from .images import read_png, to_bytes, write_png
from .report import SCHEMA
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
# Upper bound of the number of Gaussians when --gaussians is auto.
AUTO_GAUSSIANS = 40_000
# The metrics cost about 0.3 s a view on two cores; more views than this move their means little.
MOST_SCORED_VIEWS = 24
MOST_CONSISTENCY_VIEWS = 48
SHORT_RANGE, LONG_RANGE = 1, 7  # steps between the views of a pair, in file order (notes/colour.md)


@dataclass(frozen=True)
class Split:
    """Indices of a capture's views."""

    train: list[int]
    test: list[int]


def run(settings: Settings, folder: Path, reporter: Reporter) -> dict[str, Any]:
    """Do the job that `settings` ask for and write its files into `folder`; returns the report.

    Raises:
        InputError: the capture or the options cannot be used.
    """
    clock = _Clock()
    recorder = _Recorder(reporter)
    device = _choose_device(settings.device)
    with clock.measure("capture"):
        size = settings.max_size or AUTO_MAX_SIZE[device]
        capture = read_capture(Path(settings.capture), max_size=size, sfm=settings.sfm, reporter=recorder)
        for warning in capture.warnings:
            recorder.warning(warning.name, warning.message)
        split = _split(capture, settings.holdout, recorder)
        write_capture(capture, folder / "capture")
    rasterizer = _load_rasterizer(device, recorder)
    background = Background.of(capture.views)
    with clock.measure("geometry"):
        trained = _train(settings, capture, split, rasterizer, background, recorder)
    write_ply(folder / "splats.ply", trained.gaussians)
    with clock.measure("enhance"):
        _enhance(settings, capture, split, folder, recorder)
    with clock.measure("layers"):
        layers = _fit_layers(settings, capture, split, trained.gaussians, rasterizer, background, folder, recorder)
    with clock.measure("evaluate"):
        scene = SceneRenderer(rasterizer, capture.views, background)
        evaluation = _evaluate(settings, capture, split, trained.gaussians, layers, scene, folder, recorder)
    return {
        "schema": SCHEMA,
        "versions": _versions(),
        "device": _describe_device(device, rasterizer),
        "settings": settings.to_dict(),
        "capture": _describe_capture(capture, split),
        "gaussians": len(trained.gaussians),
        "gaussians_initial": trained.initial,
        "sh_degree": trained.gaussians.sh_degree,
        "seconds": {**clock.seconds, "blender": None, "total": None},
        "peak_memory_mb": _peak_memory_mb(),
        "curve": trained.curve,
        "warnings": recorder.warnings,
        **evaluation,
    }


# ---------------------------------------------------------------------------------------------------------- the stages


def _split(capture: Capture, holdout: int, reporter: Reporter) -> Split:
    """Every `holdout`-th view, from the first on, is for testing; at least two stay for training."""
    count = len(capture.views)
    test = list(range(0, count, holdout)) if holdout else []
    if test and count - len(test) < 2:
        reporter.warning("no-holdout", f"only {count} views, so none is held out: all figures are on training views")
        test = []
    kept = set(test)
    return Split([i for i in range(count) if i not in kept], test)


def _train(
    settings: Settings,
    capture: Capture,
    split: Split,
    rasterizer: raster.Rasterizer,
    background: Background,
    reporter: Reporter,
) -> TrainingResult:
    plan = TrainingPlan(
        steps=settings.iterations,
        limit=settings.gaussians or AUTO_GAUSSIANS,
        sh_degree=settings.sh_degree or 0,
    )
    trainer = Trainer(
        rasterizer,
        [capture.views[i] for i in split.train],
        [capture.views[i] for i in split.test],
        capture.points,
        capture.point_colors,
        plan,
        background,
        settings.seed,
    )
    return trainer.train(reporter)


def _enhance(settings: Settings, capture: Capture, split: Split, folder: Path, reporter: Reporter) -> None:
    """Write ``enhanced/<layer>/<view>.png`` for every view; the enhancer sees the training views only."""
    total = len(settings.layers) * (len(capture.views) + 1)
    done = 0
    for layer in settings.layers:
        reporter.status("enhance", f"{layer.name}: fitting the enhancer")
        enhancer = make_enhancer(
            settings.enhancer, layer.cvd, layer.severity, settings.simulation, settings.strength, settings.seed
        )
        enhancer.fit([capture.views[i].image for i in split.train], reporter)
        done += 1
        for view in capture.views:
            write_png(_enhanced_path(folder, layer, view), to_bytes(enhancer(view.image)))
            done += 1
            reporter.progress("enhance", done / total, f"{layer.name}: {view.key}")


def _fit_layers(
    settings: Settings,
    capture: Capture,
    split: Split,
    gaussians: Gaussians,
    rasterizer: raster.Rasterizer,
    background: Background,
    folder: Path,
    reporter: Reporter,
) -> dict[str, Gaussians]:
    """Fit and write ``splats.<layer>.ply`` for every layer."""
    fitted: dict[str, Gaussians] = {}
    for index, layer in enumerate(settings.layers):
        reporter.status("layers", f"{layer.name}: fitting colours")
        views = [
            _with_image(capture.views[i], read_png(_enhanced_path(folder, layer, capture.views[i])))
            for i in split.train
        ]

        def progress(fraction: float, index: int = index, name: str = layer.name) -> None:
            reporter.progress("layers", (index + fraction) / len(settings.layers), f"{name}: fitting colours")

        fitted[layer.name] = fit_layer(rasterizer, gaussians, views, LayerPlan(), background, settings.seed, progress)
        write_ply(folder / f"splats.{layer.name}.ply", fitted[layer.name])
    return fitted


def _evaluate(
    settings: Settings,
    capture: Capture,
    split: Split,
    gaussians: Gaussians,
    layers: dict[str, Gaussians],
    scene: SceneRenderer,
    folder: Path,
    reporter: Reporter,
) -> dict[str, Any]:
    """Render the held-out views, write them, and compute the report's figures."""
    notes: dict[str, str] = {}
    tested = split.test or _spread(split.train, MOST_SCORED_VIEWS // 3)
    if not split.test:
        notes["reconstruction"] = "no view is held out: the figures are on training views and flatter the result"
    scored = set(_spread(tested, MOST_SCORED_VIEWS))
    steps = len(tested) * (1 + len(layers)) + len(layers) + 1
    done = 0

    def advance(message: str) -> None:
        nonlocal done
        done += 1
        reporter.progress("evaluate", done / steps, message)

    reporter.status("evaluate", f"rendering {len(tested)} views")
    reconstruction = []
    unenhanced = {}
    for i in tested:
        view = capture.views[i]
        rendered = scene.color(gaussians, i)
        write_png(folder / "renders" / "original" / f"{view.key}.png", rendered)
        if i in scored:
            unenhanced[i] = rendered
            reconstruction.append(scene.fidelity(i, rendered))
        advance(f"original: {view.key}")
    correspondences = _Correspondences(scene, gaussians, len(capture.views))
    advance("matching points between views")
    entries = {}
    for layer in settings.layers:
        scores = []
        for i in tested:
            view = capture.views[i]
            rendered = scene.color(layers[layer.name], i)
            _write_layer_renders(folder, layer, view, rendered, settings.simulation)
            if i in scored:
                enhanced = read_png(_enhanced_path(folder, layer, view))
                images = LayerImages(view.image, enhanced, rendered, unenhanced[i], scene.mask(i))
                scores.append(score_view(images, layer, settings.simulation))
            advance(f"{layer.name}: {view.key}")
        entries[layer.name] = {
            **average(scores),
            "rwe": correspondences.error(capture, layer, layers[layer.name], scene, folder),
        }
        advance(f"{layer.name}: view consistency")
    if correspondences.pairs == 0:
        notes["rwe"] = "no two views share enough points that both see"
    return {
        "reconstruction": {key: float(np.mean([r[key] for r in reconstruction])) for key in ("psnr", "ssim")},
        "layers": entries,
        "views_shown": [capture.views[i].key for i in _spread(tested, 3)],
        "notes": notes,
    }


class _Correspondences:
    """Points that pairs of views share, found once on the unenhanced reconstruction and used for every layer."""

    def __init__(self, scene: SceneRenderer, gaussians: Gaussians, count: int) -> None:
        # A run of neighbouring views, so that pairs of the defined distance exist however many views there are.
        self._views = list(range(min(count, MOST_CONSISTENCY_VIEWS)))
        depths, alphas = zip(*(scene.depth(gaussians, i) for i in self._views), strict=True)
        cameras = [scene.views[i] for i in self._views]
        self._short, self._long = (
            find_correspondences(depths, alphas, cameras, view_pairs(len(self._views), step))
            for step in (SHORT_RANGE, LONG_RANGE)
        )

    @property
    def pairs(self) -> int:
        """Pairs of neighbouring views that share points."""
        return sum(len(found) > 0 for found in self._short)

    def error(
        self, capture: Capture, layer: Layer, gaussians: Gaussians, scene: SceneRenderer, folder: Path
    ) -> dict[str, float | int]:
        """RWE of the rendered layer against the photographs, and of the enhanced views before reconstruction."""
        originals = [capture.views[i].image for i in self._views]
        enhanced = [read_png(_enhanced_path(folder, layer, capture.views[i])) for i in self._views]
        rendered = [scene.color(gaussians, i) for i in self._views]
        short = relative_warping_error(originals, rendered, self._short)
        long = relative_warping_error(originals, rendered, self._long)
        before = relative_warping_error(originals, enhanced, self._short)
        return {
            "ratio": short.ratio,
            "absolute": short.absolute,
            "long_range_ratio": long.ratio,
            "normalised_ratio": short.normalised_ratio,
            "enhanced_ratio": before.ratio,
            "pairs": self.pairs,
        }


# ------------------------------------------------------------------------------------------------------------- helpers


def _write_layer_renders(folder: Path, layer: Layer, view: View, rendered: NDArray[np.uint8], simulation: str) -> None:
    place = folder / "renders" / layer.name
    write_png(place / f"{view.key}.png", rendered)
    write_png(place / "simulated" / f"{view.key}.png", simulated_bytes(rendered, layer, simulation))
    write_png(place / "simulated_input" / f"{view.key}.png", simulated_bytes(view.image, layer, simulation))


def _enhanced_path(folder: Path, layer: Layer, view: View) -> Path:
    return folder / "enhanced" / layer.name / f"{view.key}.png"


def _with_image(view: View, image: NDArray[np.uint8]) -> View:
    return replace(view, image=image)


def _spread(items: Sequence[int], count: int) -> list[int]:
    """At most `count` of `items`, evenly spread."""
    if len(items) <= count:
        return list(items)
    return [items[round(i)] for i in np.linspace(0, len(items) - 1, count)]


def _choose_device(asked: str) -> str:
    if asked == "cuda" and not wp.is_cuda_available():
        raise InputError("no CUDA device is found", where="--device", remedy="use --device cpu, or check the driver")
    # The CUDA kernels compile but have not been measured yet, so they run only when asked for.
    return "cuda" if asked == "cuda" else "cpu"


def _load_rasterizer(device: str, reporter: Reporter) -> raster.Rasterizer:
    raster.load(device, reporter)
    return raster.Rasterizer(device)


def _describe_device(device: str, rasterizer: raster.Rasterizer) -> str:
    if device == "cuda":
        return f"cuda: {wp.get_device('cuda').name}"
    return f"cpu: {platform.processor() or platform.machine()}, {rasterizer.threads} threads"


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


def _versions() -> dict[str, str]:
    from .. import __version__

    names = ("torch", "warp-lang", "numpy", "pycolmap", "OpenImageIO", "kornia", "colour-science")
    return {
        "cvdgs": __version__,
        "python": platform.python_version(),
        **{name: importlib.metadata.version(name) for name in names},
    }


def _peak_memory_mb() -> int:
    """Largest resident size of this process so far, in MiB."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return round(peak / (1024 * 1024 if sys.platform == "darwin" else 1024))


class _Clock:
    """Seconds of each stage."""

    def __init__(self) -> None:
        self.seconds: dict[str, float | None] = {}

    @contextmanager
    def measure(self, stage: str):
        """Time the block as `stage`."""
        started = time.perf_counter()
        yield
        self.seconds[stage] = round(time.perf_counter() - started, 2)


class _Recorder(Reporter):
    """Passes everything on and keeps the warnings for the report."""

    def __init__(self, inner: Reporter) -> None:
        self._inner = inner
        self.warnings: list[dict[str, str]] = []
        self.status = inner.status  # type: ignore[method-assign]
        self.progress = inner.progress  # type: ignore[method-assign]

    def warning(self, name: str, message: str) -> None:
        self.warnings.append({"name": name, "message": message})
        self._inner.warning(name, message)
