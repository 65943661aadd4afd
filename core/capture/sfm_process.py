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
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import pycolmap

from ..runtime.process import follow_parent

DATABASE = "database.db"
RESULT = "result"
_ATTEMPTS = 4  # at a reconstruction
_ENOUGH = 0.5  # of the photographs, after which no further one is made


@dataclass(frozen=True)
class SfmSettings:
    """What trades time for completeness.

    Attributes:
        max_image_size: longer side in pixels at which features are sought; COLMAP's "medium" quality.
        max_features: for each photograph.
        exhaustive_limit: up to this many photographs every pair is matched; above, each with its neighbours in order
            of their names, as a walk around the scene or a video gives them.
        sequential_overlap: number of neighbours, besides those at distances of powers of two.
        camera_model: while photographs are added one by one. One focal length, because two cannot be told apart where
            the camera is only carried around something: of the demo, taken on an arc, they came out as 485 and 749
            pixels and not as 480. One number of distortion, because more take up what a guessed focal length leaves,
            and then no third photograph fits the first two: of a street, 2 of 29 were placed instead of 27.
        refined_model: at the end, when all photographs hold it; suits phones and cameras with ordinary lenses.
        min_model_size: photographs; a capture of two is still one.
        threads: for every step.
        seed: of RANSAC and the mapper.
    """

    max_image_size: int = 1600
    max_features: int = 4096
    exhaustive_limit: int = 80
    sequential_overlap: int = 10
    camera_model: str = "SIMPLE_RADIAL"
    refined_model: str = "RADIAL"
    min_model_size: int = 2
    threads: int = 2
    seed: int = 0

    def matches_every_pair(self, count: int) -> bool:
        """Whether `count` photographs are few enough to match each with each."""
        return count <= self.exhaustive_limit

    def pairs(self, count: int) -> int:
        """Number of pairs that are matched among `count` photographs."""
        if self.matches_every_pair(count):
            return count * (count - 1) // 2
        powers = {2**exponent for exponent in range(self.sequential_overlap)}
        distances = {*range(1, self.sequential_overlap + 1), *powers}
        return sum(max(count - distance, 0) for distance in distances)


@dataclass(frozen=True)
class SfmJob:
    """What to do.

    Attributes:
        folder: holds the photographs.
        names: of the photographs, a list for each camera that took some.
        workspace: an empty folder for database and result.
        settings: see there.
    """

    folder: str
    names: list[list[str]]
    workspace: str
    settings: SfmSettings

    def to_json(self) -> str:
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> SfmJob:
        fields = json.loads(text)
        return cls(**{**fields, "settings": SfmSettings(**fields["settings"])})


def main() -> None:
    """Read one JSON object of `SfmJob` fields from stdin, estimate, and report on stdout, one JSON value a line."""
    # The terminal sends Ctrl-C to every process; the parent decides.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    job = SfmJob.from_json(sys.stdin.readline())
    follow_parent(lambda: _end_alone(Path(job.workspace)))
    _estimate(job)


def _end_alone(workspace: Path) -> None:
    """End without the parent, which can no longer remove the workspace."""
    shutil.rmtree(workspace, ignore_errors=True)
    os._exit(1)


def _estimate(job: SfmJob) -> None:
    """Write the largest reconstruction of the photographs to the workspace.

    Tells the name of each step as it begins ("features", "matching", "mapping"), the number of cameras found so far,
    and at the end "done" or, where nothing could be reconstructed, "nothing".
    """
    pycolmap.logging.minloglevel = int(pycolmap.logging.Level.FATAL.value)
    pycolmap.set_random_seed(job.settings.seed)
    workspace = Path(job.workspace)
    database = workspace / DATABASE
    _tell("features")
    for names in job.names:
        _extract(database, Path(job.folder), names, job.settings)
    _tell("matching")
    _match(database, sum(map(len, job.names)), job.settings)
    _tell("mapping")
    best = _largest(database, job)
    if best is None:
        _tell("nothing")
        return
    _refine(best, job.settings)
    (workspace / RESULT).mkdir()
    best.write_binary(str(workspace / RESULT))
    _tell("done")


def _tell(message: str | int) -> None:
    print(json.dumps(message), flush=True)


def _extract(database: Path, folder: Path, names: Sequence[str], settings: SfmSettings) -> None:
    """Find the features of photographs of one camera."""
    options = pycolmap.FeatureExtractionOptions()
    options.max_image_size = settings.max_image_size
    options.num_threads = settings.threads
    options.sift.max_num_features = settings.max_features
    reader = pycolmap.ImageReaderOptions()
    reader.camera_model = settings.camera_model
    pycolmap.extract_features(
        database,
        folder,
        list(names),
        camera_mode=pycolmap.CameraMode.SINGLE,
        reader_options=reader,
        extraction_options=options,
        device=pycolmap.Device.cpu,
    )


def _match(database: Path, count: int, settings: SfmSettings) -> None:
    options = pycolmap.FeatureMatchingOptions()
    options.num_threads = settings.threads
    if settings.matches_every_pair(count):
        pycolmap.match_exhaustive(database, matching_options=options, device=pycolmap.Device.cpu)
        return
    pairing = pycolmap.SequentialPairingOptions()
    pairing.overlap = settings.sequential_overlap
    pycolmap.match_sequential(database, matching_options=options, pairing_options=pairing, device=pycolmap.Device.cpu)


def _largest(database: Path, job: SfmJob) -> pycolmap.Reconstruction | None:
    """The reconstruction of most photographs; begun anew, from another pair, while most have no place in it.

    A first pair can bend the lens until it fits itself alone, as when walking straight ahead; no third one fits then.
    So lenses are taken as straight when it is tried again. Such attempts end in seconds.
    """
    count = sum(map(len, job.names))
    best = None
    for attempt in range(_ATTEMPTS):
        folder = Path(job.workspace) / f"models-{attempt}"
        found = _map(database, Path(job.folder), folder, job.settings, job.settings.seed + attempt, attempt == 0)
        best = max(filter(None, (best, found)), key=lambda model: model.num_reg_images(), default=None)
        if best is not None and best.num_reg_images() >= _ENOUGH * count:
            break
    return best


def _map(
    database: Path, folder: Path, output: Path, settings: SfmSettings, seed: int, distortion: bool
) -> pycolmap.Reconstruction | None:
    """One attempt, in the new folder `output`; without `distortion`, lenses are taken as straight."""
    pycolmap.set_random_seed(seed)
    options = pycolmap.IncrementalPipelineOptions()
    options.num_threads = settings.threads
    options.random_seed = seed
    options.min_model_size = settings.min_model_size
    options.ba_refine_extra_params = distortion
    output.mkdir()
    found = 0

    def count_camera() -> None:
        nonlocal found
        found += 1
        _tell(found)

    models = pycolmap.incremental_mapping(database, folder, output, options, next_image_callback=count_camera)
    return max(models.values(), key=lambda model: model.num_reg_images(), default=None)


def _refine(model: pycolmap.Reconstruction, settings: SfmSettings) -> None:
    """Adjust all of a reconstruction at once, with `settings.refined_model` for its cameras."""
    for camera in model.cameras.values():
        (focal,) = (camera.params[index] for index in camera.focal_length_idxs())
        refined = pycolmap.Camera.create_from_model_name(
            camera.camera_id, settings.refined_model, focal, camera.width, camera.height
        )
        params = refined.params
        # Both models are one family: the further numbers of the larger one stand last and begin at zero.
        params[: len(camera.params)] = camera.params
        camera.model, camera.params = refined.model, params
    config = pycolmap.BundleAdjustmentConfig()
    for image in model.reg_image_ids():
        config.add_image(image)
    config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    options = pycolmap.BundleAdjustmentOptions(print_summary=False)
    pycolmap.create_default_bundle_adjuster(options, config, model).solve()
