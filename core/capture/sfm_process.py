"""The process in which pycolmap estimates cameras; `sfm` starts and watches it.

A process of its own, because pycolmap looks at its cancellation token between photographs only at some steps, and ends
the whole process when its database fails.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import sys
import traceback
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pycolmap

from ..errors import InputError
from ..runtime.devices import explain_fault
from ..runtime.process import follow_parent
from .sfm_images import EVEN, MASKS, PLAIN, copy_name, copy_photographs, even_out, index_of
from .sfm_job import DATABASE, REFUSAL, RESULT, Placed, SfmJob, SfmSettings
from .sfm_mapping import Mapped, focal_ratio, map_photographs
from .sfm_pairs import pairs_alike, pairs_in_time, signatures_of, write_pairs

_PEAK = 0.02 / 3  # least contrast of a feature, COLMAP's own
_FAINT = 0.004  # likewise, where contrast was made even
# With fewer features in the median photograph the plain ones are not even matched: it is dark, blurred or bare.
_HOPELESS = 250
_PORTION = 100  # pairs that are matched at a time, since pycolmap does not say how far it is; each costs 0.2 s more


def main() -> None:
    """Read one JSON object of `SfmJob` fields from stdin, estimate, and report on stdout, one JSON value a line."""
    # The terminal sends Ctrl-C to every process; the parent decides.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    job = SfmJob.from_json(sys.stdin.readline())
    follow_parent(lambda: _end_alone(Path(job.workspace)))
    try:
        _estimate(job)
    except InputError as refusal:  # a photograph whose pixels are damaged
        _tell({REFUSAL: [refusal.what, refusal.where, refusal.remedy]})
    except Exception as error:
        explanation = explain_fault(error)
        if not explanation:
            raise
        traceback.print_exc()
        _tell({REFUSAL: [explanation, "", ""]})


def _end_alone(workspace: Path) -> None:
    """End without the parent, which can no longer remove the workspace."""
    shutil.rmtree(workspace, ignore_errors=True)
    os._exit(1)


def _estimate(job: SfmJob) -> None:
    """Write the largest reconstruction of the photographs to the workspace.

    Tells the name of each step as it begins ("reading", "features", "matching", "mapping"), with "more " before it when
    it is done again with more effort; how far it is, as a number; and at the end the fields of `Placed`.
    """
    pycolmap.logging.minloglevel = int(pycolmap.logging.Level.FATAL.value)
    pycolmap.set_random_seed(job.settings.seed)
    _tell("reading")
    count, best, placed = len(job.names), None, Placed()
    sizes: list[tuple[int, int]] = []
    for effort, round_ in enumerate(_rounds(job.settings)):
        own = replace(job, settings=round_.settings)
        more = "more " if effort else ""
        if not round_.is_even:
            if effort:
                _tell("more reading")
            sizes = copy_photographs(own, _tell)
        database = Path(job.workspace) / f"{effort}-{DATABASE}"
        _tell(f"{more}features")
        if round_.is_even:
            even_out(own)
        _extract(database, own, round_.is_even)
        if not round_.is_even and _median_features(database) < _HOPELESS:
            continue
        _tell(f"{more}matching")
        matched = _match(database, own, round_.settings)
        _tell(f"{more}mapping")
        found = map_photographs(database, count, round_.settings, _tell)
        if best is None or (found and found.score > best.score):
            placed = _describe(found, job, matched)
            best = found
        if best and best.placed >= job.settings.enough * count:
            break
    if best:
        _write(best, job, sizes)
    _tell(placed.to_dict())


@dataclass(frozen=True)
class _Round:
    """One way of placing the photographs.

    Attributes:
        settings: see there.
        is_even: whether faint features are sought, too, in copies whose contrast was made even.
    """

    settings: SfmSettings
    is_even: bool = False


def _rounds(settings: SfmSettings) -> list[_Round]:
    """Ways of placing photographs, until one places enough."""
    limit, alike = settings.exhaustive_limit, settings.alike
    # Of photographs with many weak features, pairs that have nothing in common cost most.
    faint = replace(settings, exhaustive_limit=limit // 2, alike=2 * alike, max_features=2 * settings.max_features)
    first = [_Round(settings.first)] if settings.first else []
    return [*first, _Round(settings), _Round(faint, is_even=True)]


def _tell(message: str | int | dict[str, Any]) -> None:
    print(json.dumps(message), flush=True)


def _extract(database: Path, job: SfmJob, is_even: bool) -> None:
    """Find the features of all photographs, those of one camera with one lens."""
    settings = job.settings
    options = pycolmap.FeatureExtractionOptions()
    options.max_image_size = settings.max_image_size
    options.num_threads = settings.threads
    options.sift.max_num_features = settings.max_features
    options.sift.peak_threshold = _FAINT if is_even else _PEAK
    pycolmap.Database.open(str(database)).close()  # makes it
    for camera in sorted(set(job.cameras)):
        indices = [index for index, one in enumerate(job.cameras) if one == camera]
        reader = pycolmap.ImageReaderOptions()
        reader.camera_model = settings.camera_model
        reader.mask_path = str(Path(job.workspace) / MASKS) if _has_masks(job) else ""
        images, names = Path(job.workspace) / (EVEN if is_even else PLAIN), [copy_name(index) for index in indices]
        # Otherwise they are numbered as the threads finish them, and the mappers start elsewhere every time.
        pycolmap.import_images(database, images, pycolmap.CameraMode.SINGLE, names, reader)
        pycolmap.extract_features(
            database,
            images,
            names,
            camera_mode=pycolmap.CameraMode.SINGLE,
            reader_options=reader,
            extraction_options=options,
            device=pycolmap.Device.cpu,
        )
        _take_prior(database, Path(job.folder) / job.names[indices[0]], copy_name(indices[0]), settings.camera_model)


def _has_masks(job: SfmJob) -> bool:
    return any((Path(job.workspace) / MASKS).iterdir())


def _take_prior(database: Path, photograph: Path, copy: str, camera_model: str) -> None:
    """Give a camera the focal length that EXIF data of `photograph` tell, where they do."""
    options = pycolmap.ImageReaderOptions()
    options.camera_model = camera_model
    try:
        told = pycolmap.infer_camera_from_image(photograph, options)
    except (RuntimeError, ValueError):  # of a format that pycolmap does not read
        return
    if not told.has_prior_focal_length:
        return
    with pycolmap.Database.open(str(database)) as opened:
        image = opened.read_image_with_name(copy)
        if image is None:
            return
        camera = opened.read_camera(image.camera_id)
        told.rescale(camera.width, camera.height)
        camera.focal_length = told.mean_focal_length()
        camera.has_prior_focal_length = True
        opened.update_camera(camera)


def _image_ids(database: pycolmap.Database) -> dict[int, int]:
    """Number of each photograph's image in the database, by its place in the job."""
    return {index_of(image.name): image.image_id for image in database.read_all_images()}


def _median_features(database: Path) -> int:
    with pycolmap.Database.open(str(database)) as opened:
        counts = sorted(opened.num_keypoints_for_image(image) for image in _image_ids(opened).values())
    return counts[len(counts) // 2] if counts else 0


def _match(database: Path, job: SfmJob, settings: SfmSettings) -> list[int]:
    """Match pairs of photographs; returns for each photograph with how many others it has enough in common."""
    count = len(job.names)
    pairs = pairs_in_time(count, settings)
    with pycolmap.Database.open(str(database)) as opened:
        ids = _image_ids(opened)
        if not settings.matches_every_pair(count):
            signatures = signatures_of(opened, [ids[index] for index in range(count)], settings.seed)
            pairs |= pairs_alike(signatures, settings.alike)
    listed, copies = Path(job.workspace) / "pairs.txt", [copy_name(index) for index in range(count)]
    options = pycolmap.FeatureMatchingOptions()
    options.num_threads = settings.threads
    pairing = pycolmap.ImportedPairingOptions()
    pairing.match_list_path = str(listed)
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = settings.seed  # of each pair; otherwise each thread goes on with its own
    ordered = sorted(pairs)
    for first in range(0, len(ordered), _PORTION):
        some = ordered[first : first + _PORTION]
        write_pairs(listed, some, copies)
        pycolmap.match_image_pairs(database, options, pairing, verification, pycolmap.Device.cpu)
        _tell(first + len(some))
    with pycolmap.Database.open(str(database)) as opened:
        found, inliers = opened.read_two_view_geometry_num_inliers()
        partners = [0] * count
        indices = {image: index for index, image in ids.items()}
        for pair, number in zip(found, inliers, strict=True):
            if number:
                for image in pycolmap.pair_id_to_image_pair(pair):
                    partners[indices[image]] += 1
    return partners


def _describe(found: Mapped | None, job: SfmJob, matched: list[int]) -> Placed:
    if found is None:
        return Placed(matched=matched)
    model = found.model
    images = [model.image(image) for image in model.reg_image_ids()]
    used = {image.camera_id for image in images}
    return Placed(
        names=[job.names[index] for index in sorted(index_of(image.name) for image in images)],
        pieces=found.pieces,
        lenses=[focal_ratio(model.camera(camera)) for camera in sorted(used)],
        matched=matched,
        method=found.method,
    )


def _write(found: Mapped, job: SfmJob, sizes: list[tuple[int, int]]) -> None:
    """Write the model under the photographs' own names, for their own sizes."""
    model = found.model
    scaled: set[int] = set()
    for image in model.images.values():
        index = index_of(image.name)
        camera = model.camera(image.camera_id)
        if image.camera_id not in scaled:
            camera.rescale(*sizes[index])
            scaled.add(image.camera_id)
        image.name = job.names[index]
    folder = Path(job.workspace) / RESULT
    folder.mkdir()
    model.write_binary(str(folder))
