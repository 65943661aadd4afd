"""A run up to Blender: capture, enhancement, geometry, colour layers, evaluation, and the report of it all."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..capture.model import Capture, CaptureWarning
from ..capture.normalised import write_cameras, write_capture
from ..capture.reader import read_capture
from ..enhance import Enhancer, make_enhancer
from ..evaluate.advice import advise, note_exposure
from ..evaluate.evaluation import Split
from ..files.images import write_png
from ..runs.folder import remove_layer
from ..runs.layout import CAPTURE_FOLDER, PLACED_FILE
from ..runs.report import SCHEMA, without_non_finite
from ..runtime.progress import Clock
from ..runtime.protocol import Reporter
from ..runtime.resources import peak_memory_mb
from ..runtime.time_model import TIME_MODEL
from ..settings import Layer, Settings
from ..splats import raster
from ..splats.training.checkpoints import Checkpoints
from ..splats.training.trainer import TrainingResult
from .cameras import CheckedCameras, check_cameras
from .cleaning import Cleaned, propose_crop
from .continuation import CheckpointRequest, describe_run
from .device import choose_warp_device, describe_device, versions
from .kept_capture import digest_of, from_state, to_state
from .moving import keep_moving
from .resume import EarlierRun
from .stages import Reconstruction, Stages

# Longer side of the training images when --max-size is auto: what two cores train in minutes. The same on a graphics
# card, so that what a scene is trained on does not depend on the machine.
AUTO_MAX_SIZE = 640
_USUAL_VIEWS = 40  # as long as nobody has counted them


def run(
    settings: Settings,
    folder: Path,
    reporter: Reporter,
    *,
    previews: bool = False,
    checkpoint: CheckpointRequest | None = None,
) -> dict[str, Any]:
    """Do the job that `settings` ask for and write its files into `folder`; returns the report.

    With ``settings.resume``, `folder` holds the files of the finished run, and layers are added to them.

    Args:
        settings: what is asked for.
        folder: for the results.
        reporter: told of progress and warnings.
        previews: whether it receives pictures of the run's progress.
        checkpoint: where checkpoints of the geometry are kept; None keeps none.

    Raises:
        InputError: the capture or the options cannot be used.
    """
    clock, recorder = Clock(), _Recorder(reporter)
    device = choose_warp_device(settings.device)
    earlier = EarlierRun.read(folder, settings.out) if settings.resume else None
    settings = earlier.complete(settings) if earlier else settings
    enhancers = _make_enhancers(settings)  # refuses what cannot be simulated before anything takes time
    checkpoints = None if checkpoint is None else _checkpoints(checkpoint, settings, recorder)
    with clock.measure("capture"):
        if earlier:
            earlier.check_photographs(Path(settings.capture), recorder)
            for layer in settings.layers:
                remove_layer(folder, layer.name)
            capture = earlier.capture
        else:
            capture = _take_capture(settings, folder, checkpoints, recorder)
    sides = [(view.camera.width, view.camera.height) for view in capture.views]
    largest = map(max, zip(*sides, strict=True))
    recorder.forecast(_forecast(settings, len(sides), *largest, adds_layer=earlier is not None))
    raster.load(device, recorder)
    split = _split(capture, settings.holdout, recorder)
    context = (settings, folder, recorder, capture, split, raster.Rasterizer(device))
    stages = Stages.of(*context, previews=previews, checkpoints=checkpoints)
    cameras = CheckedCameras()
    if not earlier:
        stages.show_points()
        with clock.measure("capture"):
            cameras = check_cameras(stages)
            stages = cameras.applied(stages)
            capture = stages.capture
    with clock.measure("enhance"):
        stages.enhance(enhancers)
    trained: TrainingResult | None = None
    cleaned: Cleaned | None = None
    moving: dict[str, Any] = {}
    if earlier:
        with clock.measure("layers"):
            made = stages.reconstruction(earlier.gaussians, "layers", 0.0, 0.0)
    else:
        with clock.measure("geometry"):
            trained = stages.train()
            stages = stages.after(trained)
            if cameras.were_off or trained.moved_poses or trained.smears:
                write_cameras(stages.capture, folder / CAPTURE_FOLDER)
            moving = keep_moving(stages.capture, trained.moving, folder, recorder)
            cleaned = stages.clean(trained)
            trained = replace(trained, gaussians=cleaned.gaussians, decision={**trained.decision, **cleaned.in_words})
            made = stages.reconstruct(trained, cleaned.scores)
    with clock.measure("layers"):
        pictures = stages.fit_layers(made, enhancers)
    with clock.measure("evaluate"):
        figures = stages.evaluate(made, pictures)
    curve = trained.curve if trained else ()
    for found in advise(stages.capture, split, folder, curve, figures):
        recorder.warning(found.name, found.message)
    figures["notes"] |= note_exposure(curve)
    stages.end_previews()
    for layer in figures["layers"].values():
        layer.update(enhancer=settings.enhancer, strength=settings.strength)
    subject = {} if earlier else propose_crop([stages.capture.views[i] for i in split.train], made.original, figures)
    report = {
        "schema": SCHEMA,
        "versions": versions(),
        "device": describe_device(stages.rasterizer),
        "settings": settings.to_dict(),
        "capture": _describe_capture(capture, split),
        "seconds": {**clock.seconds, "blender": None, "total": None},
        "peak_memory_mb": peak_memory_mb(),
        "warnings": recorder.warnings,
        **(_describe_training(cameras, trained, made) if trained else {}),
        **({"clean": cleaned.figures} if cleaned and cleaned.figures else {}),
        **({"moving": moving} if moving else {}),
        **({"subject": subject} if subject else {}),
        **figures,
    }
    report = without_non_finite(report)
    return earlier.extend(report) if earlier else report


def _forecast(settings: Settings, views: int, width: int, height: int, *, adds_layer: bool = False) -> dict[str, float]:
    """Seconds of the stages on the reference machine, for views of this size."""
    return TIME_MODEL.stages(
        *(settings.iterations, max(width, height), views, width, height),
        adds_layer=adds_layer,
        scene_file=settings.blend,
        layers=len(settings.layers),
    )


def _describe_training(cameras: CheckedCameras, trained: TrainingResult, made: Reconstruction) -> dict[str, Any]:
    return {
        "gaussians": len(made.original),
        "gaussians_initial": trained.initial,
        "sh_degree": made.original.sh_degree,
        "curve": trained.curve,
        "decision": {**trained.decision, **cameras.in_words},
        "skipped_steps": trained.skipped,
    }


def _split(capture: Capture, holdout: int, reporter: Reporter) -> Split:
    """Every `holdout`-th view is for testing, unless fewer than two would stay for training."""
    count = len(capture.views)
    split = Split.every(count, holdout)
    if split.test and len(split.train) < 2:
        reporter.warning("no-holdout", f"only {count} views, so none is held out: all figures are on training views")
        return Split.every(count, 0)
    return split


def _take_capture(settings: Settings, folder: Path, checkpoints: Checkpoints | None, recorder: _Recorder) -> Capture:
    """Read the capture of a new run, and write what is used of it into the run's folder."""
    size = settings.max_size or AUTO_MAX_SIZE
    recorder.forecast(_forecast(settings, _USUAL_VIEWS, size, size * 3 // 4))
    capture = _capture_of(settings, size, checkpoints, recorder)
    capture = replace(capture, metres_per_unit=settings.metres_per_unit or capture.metres_per_unit)
    write_capture(capture, folder / CAPTURE_FOLDER)
    if capture.estimate and capture.estimate.sheet is not None:
        write_png(folder / CAPTURE_FOLDER / PLACED_FILE, capture.estimate.sheet)
    return capture


def _capture_of(settings: Settings, size: int, checkpoints: Checkpoints | None, recorder: _Recorder) -> Capture:
    """The capture that `settings` name; estimated cameras are kept, and come from there where a run goes on."""
    path, cameras, side = Path(settings.capture), settings.cameras_from, settings.tag_side
    kept = checkpoints.kept_capture(lambda: digest_of(path, cameras, size, side)) if checkpoints else None
    if kept:
        capture = from_state(kept, path)
        recorder.status("capture", f"taking the {len(capture.views)} cameras that were estimated before")
        for warning in capture.warnings:
            recorder.warning(warning.name, warning.message)
        return capture
    before = len(recorder.warnings)
    capture = read_capture(path, max_size=size, cameras=cameras, reporter=recorder, tag_side=side)
    if checkpoints and capture.estimate:
        given = [CaptureWarning(**warning) for warning in recorder.warnings[before:]]
        checkpoints.keep_capture(to_state(capture, given), digest_of(path, cameras, size, side))
    return capture


def _checkpoints(request: CheckpointRequest, settings: Settings, reporter: Reporter) -> Checkpoints:
    return Checkpoints(
        Path(request.folder),
        describe_run(settings),
        resume=request.resume,
        warn=lambda message: reporter.warning("checkpoint", message),
        every_seconds=request.seconds,
    )


def _make_enhancers(settings: Settings) -> dict[Layer, Enhancer]:
    return {
        layer: make_enhancer(
            settings.enhancer,
            layer.cvd,
            layer.severity,
            settings.simulation,
            settings.strength,
            settings.seed,
            settings.change_budget,
            settings.fit,
        )
        for layer in settings.layers
    }


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
        "up": [round(value, 6) for value in capture.up.direction.tolist()] if capture.up else None,
        "up_from": capture.up.source if capture.up else None,
        "metres_per_unit": capture.metres_per_unit,
        "estimate": capture.estimate.to_dict() if capture.estimate else None,
        "masks": _describe_masks(capture),
    }


def _describe_masks(capture: Capture) -> dict[str, Any]:
    """How many photographs have masks, and the share of all pixels that these leave out."""
    masks = [view.mask for view in capture.views if view.mask is not None]
    pixels = sum(view.camera.width * view.camera.height for view in capture.views)
    return {"views": len(masks), "share": round(sum(int((~mask).sum()) for mask in masks) / pixels, 6)}


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

    def forecast(self, seconds: Mapping[str, float]) -> None:
        self._inner.forecast(seconds)

    def preview(self, file: Path) -> None:
        self._inner.preview(file)
