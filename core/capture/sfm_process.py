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

from ..parent import follow_parent

DATABASE = "database.db"
RESULT = "result"


@dataclass(frozen=True)
class SfmSettings:
    """What trades time for completeness.

    Attributes:
        max_image_size: longer side in pixels at which features are sought; COLMAP's "medium" quality.
        max_features: for each photograph.
        exhaustive_limit: up to this many photographs every pair is matched; above, each with its neighbours in order
            of their names, as a walk around the scene or a video gives them.
        sequential_overlap: number of neighbours, besides those at distances of powers of two.
        camera_model: one whose distortion suits phones and cameras with ordinary lenses.
        min_model_size: photographs; a capture of two is still one.
        threads: for every step.
        seed: of RANSAC and the mapper.
    """

    max_image_size: int = 1600
    max_features: int = 4096
    exhaustive_limit: int = 80
    sequential_overlap: int = 10
    camera_model: str = "OPENCV"
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
    """What to do: the photographs `names` in `folder`, and an empty `workspace` for database and result."""

    folder: str
    names: list[str]
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
    _extract(database, Path(job.folder), job.names, job.settings)
    _tell("matching")
    _match(database, len(job.names), job.settings)
    _tell("mapping")
    models = _map(database, Path(job.folder), workspace, job.settings)
    if not models:
        _tell("nothing")
        return
    best = max(models.values(), key=lambda model: model.num_reg_images())
    (workspace / RESULT).mkdir()
    best.write_binary(str(workspace / RESULT))
    _tell("done")


def _tell(message: str | int) -> None:
    print(json.dumps(message), flush=True)


def _extract(database: Path, folder: Path, names: Sequence[str], settings: SfmSettings) -> None:
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
        # Photographs of one size and focal length in sequence share their intrinsics.
        camera_mode=pycolmap.CameraMode.AUTO,
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


def _map(database: Path, folder: Path, workspace: Path, settings: SfmSettings) -> dict[int, pycolmap.Reconstruction]:
    options = pycolmap.IncrementalPipelineOptions()
    options.num_threads = settings.threads
    options.random_seed = settings.seed
    options.min_model_size = settings.min_model_size
    output = workspace / "models"
    output.mkdir()
    found = 0

    def count_camera() -> None:
        nonlocal found
        found += 1
        _tell(found)

    return pycolmap.incremental_mapping(database, folder, output, options, next_image_callback=count_camera)
