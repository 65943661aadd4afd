"""From matched features to placed photographs: global and incremental mapping by pycolmap, checked and refined."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np
import pycolmap

from .bundle import THREADS, adjust, extended_params
from .sfm_images import PLAIN
from .sfm_job import SfmSettings

LENSES = (0.3, 5.0)
"""Focal lengths of telephones and cameras, as multiples of the longer side: from the widest action camera, with its
distortion, to a long telephoto lens."""
_DISTORTION = 1.0  # the largest number of it that an ordinary lens has
_ATTEMPTS = 3  # at an incremental reconstruction
_MOST = 0.5  # of the photographs, after which no further incremental one is made
_LEAST_POINTS = 15  # that hold a photograph in its place; RANSAC finds fewer by chance
_REPROJECTION = 4.0  # pixels, of the copies
_ANGLE = 1.5  # degrees between rays, below which a point's depth is not known
# Of the time of global mapping and what follows it, when its model changes: placed, adjusted, triangulated, adjusted.
_GLOBAL_SHARES = (0.35, 0.5, 0.55, 0.65)
_SAMPLE = 2000  # points whose angles are looked at


@dataclass(frozen=True)
class Mapped:
    """A reconstruction and how it was made.

    Attributes:
        model: of the largest piece.
        pieces: number of photographs in each piece, largest first.
        method: "global" or "incremental".
    """

    model: pycolmap.Reconstruction
    pieces: list[int]
    method: str

    @property
    def score(self) -> tuple[int, int]:
        """To compare reconstructions by: photographs placed by lenses that exist, then points."""
        return self.model.num_reg_images(), self.model.num_points3D()


def map_photographs(database: Path, count: int, settings: SfmSettings, told: Callable[[int], None]) -> Mapped | None:
    """Place as many of the photographs as can be.

    Global mapping comes first: it sees all pairs at once, so that it neither depends on a first pair nor breaks where a
    walk is held together by few matches. Where it leaves photographs out, incremental mapping is asked, too.

    Args:
        database: of matched features; not changed.
        count: of photographs.
        settings: see there.
        told: called with the number of photographs placed so far.

    Returns:
        None where nothing hangs together.
    """
    workspace = database.parent / f"{database.stem}-models"
    workspace.mkdir()
    images = database.parent / PLAIN
    calibrated = workspace / "calibrated.db"
    shutil.copy(database, calibrated)
    usable = _calibrate(calibrated, settings)
    found = _checked(_map_globally(calibrated, images, count, settings, told), "global", settings)
    if found:
        told(found.model.num_reg_images())
    for attempt in range(_ATTEMPTS):
        if found and found.model.num_reg_images() >= (_MOST if attempt else settings.enough) * count:
            break
        # A first pair can bend the lens until it fits itself alone, as when walking straight ahead; no third one fits
        # then. So lenses are taken as straight when it is tried again. Such attempts end in seconds.
        models = _map_one_by_one(
            calibrated if usable and attempt != 1 else database,
            images,
            workspace / f"incremental-{attempt}",
            settings,
            settings.seed + attempt,
            attempt == 0,
            told,
        )
        other = _checked(models, "incremental", settings)
        found = max(filter(None, (found, other)), key=lambda mapped: mapped.score, default=None)
    return found


def _calibrate(database: Path, settings: SfmSettings) -> bool:
    """Estimate focal lengths from all pairs together, into the database; whether they are such as lenses have."""
    options = pycolmap.ViewGraphCalibrationOptions()
    options.random_seed = settings.seed
    options.min_focal_length_ratio, options.max_focal_length_ratio = LENSES
    with pycolmap.Database.open(str(database)) as opened:
        before = opened.read_all_cameras()
    if not pycolmap.calibrate_view_graph(str(database), options):
        return False
    with pycolmap.Database.open(str(database)) as opened:
        strange = [camera for camera in opened.read_all_cameras() if not _is_lens(camera)]
        for camera in strange:
            opened.update_camera(next(one for one in before if one.camera_id == camera.camera_id))
    return not strange


def _map_globally(
    database: Path, images: Path, count: int, settings: SfmSettings, told: Callable[[int], None]
) -> list[pycolmap.Reconstruction]:
    """All photographs at once; `told` gets the part that is done as if so many of `count` were placed."""
    options = pycolmap.GlobalPipelineOptions()
    options.image_path = str(images)  # for the points' colours
    options.num_threads = THREADS
    options.min_model_size = max(settings.min_model_size, 2)
    mapper = options.mapper
    # The first does not reach the others, which otherwise take numbers from a common stream.
    for part in (options, mapper, mapper.rotation_averaging, mapper.global_positioning, mapper.retriangulation):
        part.random_seed = settings.seed
    found = pycolmap.ReconstructionManager()
    updates = iter(_GLOBAL_SHARES)
    with pycolmap.Database.open(str(database)) as opened:
        pipeline = pycolmap.GlobalPipeline(options, opened, found)
        pipeline.add_callback(
            pycolmap.GlobalPipelineCallback.MODEL_UPDATE_CALLBACK, lambda: told(int(next(updates, 1.0) * count))
        )
        pipeline.run()
    return [found.get(index) for index in range(found.size())]


def _map_one_by_one(
    database: Path,
    images: Path,
    output: Path,
    settings: SfmSettings,
    seed: int,
    distortion: bool,
    told: Callable[[int], None],
) -> list[pycolmap.Reconstruction]:
    """One attempt, in the new folder `output`; without `distortion`, lenses are taken as straight."""
    pycolmap.set_random_seed(seed)
    options = pycolmap.IncrementalPipelineOptions()
    options.num_threads = THREADS
    options.random_seed = seed
    options.min_model_size = settings.min_model_size
    options.ba_refine_extra_params = distortion
    output.mkdir()
    found = 0

    def count_camera() -> None:
        nonlocal found
        found += 1
        told(found)

    models = pycolmap.incremental_mapping(database, images, output, options, next_image_callback=count_camera)
    return list(models.values())


def _checked(models: list[pycolmap.Reconstruction], method: str, settings: SfmSettings) -> Mapped | None:
    """The largest of `models` without what cannot be right; None where nothing is left."""
    models = sorted(models, key=lambda model: model.num_reg_images(), reverse=True)
    pieces = [model.num_reg_images() for model in models]
    for model in models[:1]:
        _refine(model, settings)
        _drop_unheld(model)
        if model.num_reg_images() >= settings.min_model_size:
            adjust(model, robust=True)
            _drop_unheld(model)
        if model.num_reg_images() >= settings.min_model_size:
            return Mapped(model, [model.num_reg_images(), *pieces[1:]], method)
    return None


def _refine(model: pycolmap.Reconstruction, settings: SfmSettings) -> None:
    """Adjust all of a reconstruction at once, with `settings.refined_model` for its cameras."""
    for camera in model.cameras.values():
        (focal,) = (camera.params[index] for index in camera.focal_length_idxs())
        refined = pycolmap.Camera.create_from_model_name(
            camera.camera_id, settings.refined_model, focal, camera.width, camera.height
        )
        params = extended_params(list(camera.params), refined)
        camera.model, camera.params = refined.model, params
    adjust(model, robust=True)


def _drop_unheld(model: pycolmap.Reconstruction) -> None:
    """Take out points that do not fit, photographs that too few points hold, and those of a lens that none has."""
    observations = pycolmap.ObservationManager(model)
    observations.filter_all_points3D(_REPROJECTION, _ANGLE)
    for image_id in list(model.reg_image_ids()):
        image = model.image(image_id)
        if image.num_points3D < _LEAST_POINTS or not _is_lens(model.camera(image.camera_id)):
            observations.deregister_frame(image.frame_id)


def _is_lens(camera: pycolmap.Camera) -> bool:
    low, high = LENSES
    further = [camera.params[index] for index in camera.extra_params_idxs()]
    return low <= focal_ratio(camera) <= high and all(abs(number) <= _DISTORTION for number in further)


def focal_ratio(camera: pycolmap.Camera) -> float:
    """Focal length as a multiple of the longer side."""
    return camera.mean_focal_length() / max(camera.width, camera.height)


def median_angle(model: pycolmap.Reconstruction) -> float:
    """Median over points of the largest angle, in degrees, between two rays to one; 0 without points."""
    points = list(model.points3D.values())
    angles = []
    for point in points[:: max(1, len(points) // _SAMPLE)]:
        centres = [model.image(element.image_id).projection_center() for element in point.track.elements]
        rays = np.array(centres) - point.xyz
        rays /= np.maximum(np.linalg.norm(rays, axis=1, keepdims=True), 1e-12)
        least = min((float(a @ b) for a, b in combinations(rays[:: max(1, len(rays) // 8)], 2)), default=1.0)
        angles.append(np.degrees(np.arccos(np.clip(least, -1.0, 1.0))))
    return float(np.median(angles)) if angles else 0.0
