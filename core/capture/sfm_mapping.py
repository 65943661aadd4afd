"""From matched features to placed photographs: global and incremental mapping by pycolmap, checked and refined."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import pycolmap

from .bundle import THREADS, adjust, extended_params
from .sfm_images import PLAIN
from .sfm_job import DATABASE, SfmSettings
from .sfm_pieces import join_pieces
from .sfm_support import Matches, Support, read_matches, support_of

LENSES = (0.3, 5.0)
"""Focal lengths of telephones and cameras, as multiples of the longer side: from the widest action camera, with its
distortion, to a long telephoto lens."""
_DISTORTION = 1.0  # the largest number of it that an ordinary lens has
_ATTEMPTS = 3  # at an incremental reconstruction
_MOST = 0.5  # of the photographs, after which no further incremental one is made
# Of a photograph's matches, the share that has to fit its place; neighbours on all sides give it .95 to 1. Below the
# second a place is bent, and so may be others below the first; below the third it is wrong.
_DOUBTFUL, _BENT, _WRONG = 0.95, 0.85, 0.5
_GROUP = 2  # bent photographs, that hold each other and hang loosely on the rest; one alone has false matches
_MOST_DOUBTFUL = 1 / 3  # of the photographs; where more are, matches are worse than places
_LEAST_POINTS = 15  # that hold a photograph in its place; RANSAC finds fewer by chance
_REPROJECTION = 4.0  # pixels, of the copies
_ANGLE = 1.5  # degrees between rays, below which a point's depth is not known
# Of the time of global mapping and what follows it, when its model changes: placed, adjusted, triangulated, adjusted.
_GLOBAL_SHARES = (0.35, 0.5, 0.55, 0.65)


@dataclass(frozen=True)
class Mapped:
    """A reconstruction and how it was made.

    Attributes:
        model: of the largest piece.
        pieces: number of photographs in each piece, largest first.
        method: "global", "incremental", or "pieces" (of either, joined).
        support: what the matches say of it.
    """

    model: pycolmap.Reconstruction
    pieces: list[int]
    method: str
    support: Support

    @property
    def placed(self) -> int:
        """Number of photographs with a place."""
        return int(self.model.num_reg_images())

    @property
    def score(self) -> tuple[int, int]:
        """To compare reconstructions from different features by: photographs with a place, then points."""
        return self.placed, self.model.num_points3D()

    @property
    def is_bent(self) -> bool:
        """Whether several photographs have places that many of their matches contradict."""
        return len(self.below(_BENT)) >= _GROUP

    def below(self, share: float) -> list[int]:
        """Numbers of the images with places that fewer of their matches fit."""
        return [image for image, own in self.support.shares.items() if own < share]


def map_photographs(database: Path, count: int, settings: SfmSettings, told: Callable[[int], None]) -> Mapped | None:
    """Place as many of the photographs as can be.

    Global mapping comes first: it sees all pairs at once, so that it neither depends on a first pair nor breaks where a
    walk is held together by few matches. Where it leaves photographs out, incremental mapping is asked, too, and pieces
    that hang together are joined. What has no place then, or a doubtful one, is placed anew by its matches with the
    rest. Of several reconstructions that one is taken which explains the matches best that none was made from.

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
    matches = read_matches(calibrated)
    models = _map_globally(calibrated, images, count, settings, told)
    in_pieces = [_copied(models)]
    found = _checked(models, "global", matches, settings)
    if found:
        told(found.placed)
    for attempt in range(_ATTEMPTS):
        if found and found.placed >= (_MOST if attempt else settings.enough) * count:
            break
        # A first pair can bend the lens until it fits itself alone, as when walking straight ahead; no third one fits
        # then. So lenses are taken as straight when it is tried again. Such attempts end in seconds.
        options = _options(settings, settings.seed + attempt)
        options.ba_refine_extra_params = attempt == 0
        source = calibrated if usable and attempt != 1 else database
        models = _map_one_by_one(source, images, workspace / f"incremental-{attempt}", options, told)
        in_pieces.append(_copied(models))
        found = _better(found, _checked(models, "incremental", matches, settings), settings.enough * count)
    for number, pieces in enumerate(in_pieces):
        if found and found.placed < settings.enough * count and len(pieces) > 1:
            joined = _joined(pieces, calibrated, images, workspace / f"joined-{number}", matches, settings)
            found = _better(found, joined, settings.enough * count)
    if found and (found.is_bent or found.placed < count):
        again = _placed_anew(found, calibrated, images, workspace / "again", matches, settings)
        found = _better(found, again, settings.enough * count)
    return found


def _copied(models: list[pycolmap.Reconstruction]) -> list[pycolmap.Reconstruction]:
    """Models as they are before they are checked, where there are several."""
    return [pycolmap.Reconstruction(model) for model in models] if len(models) > 1 else []


def _joined(
    pieces: list[pycolmap.Reconstruction],
    database: Path,
    images: Path,
    workspace: Path,
    matches: Matches,
    settings: SfmSettings,
) -> Mapped | None:
    """What pieces become together; None where they have too little in common."""
    whole = join_pieces(pieces, database, images, workspace, settings.seed)
    return _checked([whole], "pieces", matches, settings) if whole else None


def _better(first: Mapped | None, second: Mapped | None, enough: float) -> Mapped | None:
    """The one that the matches speak for, but never one that leaves out too many where the other does not."""
    return max(
        filter(None, (first, second)),
        key=lambda mapped: (mapped.placed >= enough, -mapped.support.cost),
        default=None,
    )


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


def _options(settings: SfmSettings, seed: int) -> pycolmap.IncrementalPipelineOptions:
    options = pycolmap.IncrementalPipelineOptions()
    options.num_threads = THREADS
    options.random_seed = seed
    options.min_model_size = settings.min_model_size
    return options


def _map_one_by_one(
    database: Path,
    images: Path,
    output: Path,
    options: pycolmap.IncrementalPipelineOptions,
    told: Callable[[int], None],
    start: Path | None = None,
) -> list[pycolmap.Reconstruction]:
    """One attempt, in the new folder `output`; it goes on from the reconstruction in `start`."""
    pycolmap.set_random_seed(options.random_seed)
    output.mkdir()
    found = 0

    def count_camera() -> None:
        nonlocal found
        found += 1
        told(found)

    models = pycolmap.incremental_mapping(
        database, images, output, options, input_path=start or "", next_image_callback=count_camera
    )
    return list(models.values())


def _placed_anew(
    found: Mapped, database: Path, images: Path, workspace: Path, matches: Matches, settings: SfmSettings
) -> Mapped | None:
    """`found` without photographs of a doubtful place, and then with all that their matches with the rest place.

    Points that a photograph shares with the rest may be too few to place it by; its matches are more, and hold it where
    they agree on a relative pose ("structure-less" in COLMAP).
    """
    start = workspace / "start"
    start.mkdir(parents=True)
    model = pycolmap.Reconstruction(found.model)
    doubtful = found.below(_DOUBTFUL) if found.is_bent else []
    if len(doubtful) <= _MOST_DOUBTFUL * found.placed:
        _take_out(model, doubtful)
    if model.num_reg_images() < settings.min_model_size:
        return None
    adjust(model, robust=True)
    _drop_unheld(model)
    model.write_binary(str(start))
    own = workspace / DATABASE
    shutil.copy(database, own)
    with pycolmap.Database.open(str(own)) as opened:
        for camera in model.cameras.values():
            opened.update_camera(camera)
    options = _options(settings, settings.seed)
    options.multiple_models = False
    options.structure_less_registration_only = True
    options.mapper.abs_pose_min_num_inliers = _LEAST_POINTS
    models = _map_one_by_one(own, images, workspace / "models", options, lambda _: None, start)
    again = _checked(models, found.method, matches, settings)
    return again and replace(again, pieces=[again.placed, *found.pieces[1:]])


def _checked(
    models: list[pycolmap.Reconstruction], method: str, matches: Matches, settings: SfmSettings
) -> Mapped | None:
    """The largest of `models` without what cannot be right; None where nothing is left."""
    models = sorted(models, key=lambda model: model.num_reg_images(), reverse=True)
    pieces = [model.num_reg_images() for model in models]
    for model in models[:1]:
        _refine(model, settings)
        _drop_unheld(model)
        if model.num_reg_images() >= settings.min_model_size:
            adjust(model, robust=True)
            _drop_unheld(model)
        support = support_of(model, matches)
        wrong = [image for image, share in support.shares.items() if share < _WRONG]
        if wrong:
            _take_out(model, wrong)
            support = support_of(model, matches)
        if model.num_reg_images() >= settings.min_model_size:
            return Mapped(model, [model.num_reg_images(), *pieces[1:]], method, support)
    return None


def _take_out(model: pycolmap.Reconstruction, images: list[int]) -> None:
    observations = pycolmap.ObservationManager(model)
    for image in images:
        observations.deregister_frame(model.image(image).frame_id)


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
