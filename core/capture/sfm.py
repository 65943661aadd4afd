"""Estimates the cameras of photographs with pycolmap: SIFT, matching and incremental mapping on the CPU."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures import TimeoutError as StillRunning
from dataclasses import dataclass
from pathlib import Path

import pycolmap

from ..errors import InputError
from ..events import Reporter
from .colmap import add_views, sparse_points
from .source import SourceModel

STAGE = "sfm"
_POLL_SECONDS = 0.5


@dataclass(frozen=True)
class SfmSettings:
    """What trades time for completeness.

    Attributes:
        max_image_size: longer side in pixels at which features are sought; COLMAP's "medium" quality.
        max_features: for each photograph.
        exhaustive_limit: up to this many photographs every pair is matched; above, each with its neighbours in order
            of their names, as a walk around the scene or a video gives them.
        sequential_overlap: number of neighbours, besides those at distances of powers of two.
        threads: for every step.
        seed: of RANSAC and the mapper.
    """

    max_image_size: int = 1600
    max_features: int = 4096
    exhaustive_limit: int = 80
    sequential_overlap: int = 10
    threads: int = 2
    seed: int = 0


def estimate_cameras(
    folder: Path, names: Sequence[str], workspace: Path, reporter: Reporter, settings: SfmSettings | None = None
) -> SourceModel:
    """Estimate the cameras of photographs; photographs taken with one lens at one size share their intrinsics.

    Args:
        folder: holds the photographs; nothing is written there.
        names: of the photographs, relative to `folder`, in the order in which they were taken.
        workspace: an empty folder for the database.
        reporter: told of the steps and their progress.
        settings: defaults suit two cores.

    Raises:
        InputError: the photographs do not overlap enough.
    """
    settings = settings or SfmSettings()
    database = workspace / "database.db"
    pycolmap.logging.minloglevel = int(pycolmap.logging.Level.ERROR.value)
    pycolmap.set_random_seed(settings.seed)

    reporter.status(STAGE, f"finding features in {len(names)} photographs")
    _run(_extract(database, folder, names, settings), _rows(database, "keypoints", len(names)), reporter, "features")

    exhaustive = len(names) <= settings.exhaustive_limit
    reporter.status(STAGE, f"matching {'every pair' if exhaustive else 'neighbours'} of {len(names)} photographs")
    pairs = len(names) * (len(names) - 1) // 2 if exhaustive else _sequential_pairs(len(names), settings)
    _run(_match(database, exhaustive, settings), _rows(database, "two_view_geometries", pairs), reporter, "pairs")

    reporter.status(STAGE, "estimating cameras")
    registered = _Counter(len(names))
    models = _run(_map(database, folder, workspace, registered, settings), registered, reporter, "cameras")
    remedy = "take photographs that overlap by two thirds, sharp and from different positions, or give cameras"
    if not models:
        raise InputError("no cameras could be estimated from the photographs", where=folder, remedy=remedy)
    best = max(models.values(), key=lambda reconstruction: reconstruction.num_reg_images())
    if best.num_reg_images() < 2:
        raise InputError("the camera of one photograph only could be estimated", where=folder, remedy=remedy)
    model = SourceModel("sfm", folder, [])
    add_views(model, best, folder)
    model.points, model.point_colors = sparse_points(best)
    return model


Step = Callable[[pycolmap.CancellationToken], object]


def _extract(database: Path, folder: Path, names: Sequence[str], settings: SfmSettings) -> Step:
    options = pycolmap.FeatureExtractionOptions()
    options.max_image_size = settings.max_image_size
    options.num_threads = settings.threads
    options.sift.max_num_features = settings.max_features
    reader = pycolmap.ImageReaderOptions()
    reader.camera_model = "OPENCV"

    return lambda token: pycolmap.extract_features(
        database,
        folder,
        list(names),
        camera_mode=pycolmap.CameraMode.AUTO,
        reader_options=reader,
        extraction_options=options,
        device=pycolmap.Device.cpu,
        cancellation_token=token,
    )


def _match(database: Path, exhaustive: bool, settings: SfmSettings) -> Step:
    options = pycolmap.FeatureMatchingOptions()
    options.num_threads = settings.threads
    if exhaustive:
        return lambda token: pycolmap.match_exhaustive(
            database, matching_options=options, device=pycolmap.Device.cpu, cancellation_token=token
        )
    pairing = pycolmap.SequentialPairingOptions()
    pairing.overlap = settings.sequential_overlap
    return lambda token: pycolmap.match_sequential(
        database,
        matching_options=options,
        pairing_options=pairing,
        device=pycolmap.Device.cpu,
        cancellation_token=token,
    )


def _map(database: Path, folder: Path, workspace: Path, registered: _Counter, settings: SfmSettings) -> Step:
    options = pycolmap.IncrementalPipelineOptions()
    options.num_threads = settings.threads
    options.random_seed = settings.seed
    # A capture of five photographs is still one.
    options.min_model_size = 2
    output = workspace / "models"
    output.mkdir()
    return lambda token: pycolmap.incremental_mapping(
        database, folder, output, options, next_image_callback=registered.increase, cancellation_token=token
    )


class _Counter:
    """Counts up to a total; called, gives the fraction."""

    def __init__(self, total: int) -> None:
        self._total = total
        self._count = 0

    def increase(self) -> None:
        self._count += 1

    def __call__(self) -> float:
        return min(self._count / self._total, 1.0)


def _rows(database: Path, table: str, total: int) -> Callable[[], float]:
    """The fraction of `total` rows that `table` holds; 0 while the database is busy."""

    def fraction() -> float:
        try:
            connection = sqlite3.connect(f"{database.as_uri()}?mode=ro", uri=True, timeout=0.05)
            try:
                (rows,) = connection.execute(f"SELECT COUNT(*) FROM {table}").fetchone()
            finally:
                connection.close()
        except sqlite3.Error:
            return 0.0
        return min(rows / total, 1.0)

    return fraction


def _sequential_pairs(count: int, settings: SfmSettings) -> int:
    """Pairs of COLMAP's quadratic overlap: neighbours at the distances 1 to n and at powers of two below 2^n."""
    distances = {*range(1, settings.sequential_overlap + 1), *(2**i for i in range(settings.sequential_overlap))}
    return sum(max(count - distance, 0) for distance in distances)


def _run(step: Step, fraction: Callable[[], float], reporter: Reporter, unit: str):
    """Run a step of pycolmap in a thread, report its progress, and stop it when the user cancels."""
    token = pycolmap.CancellationToken()
    with ThreadPoolExecutor(1, thread_name_prefix="sfm") as pool:
        future = pool.submit(step, token)
        reached = 0.0
        try:
            while True:
                try:
                    return future.result(timeout=_POLL_SECONDS)
                except StillRunning:
                    reached = max(reached, fraction())
                    reporter.progress(STAGE, reached, unit)
        except BaseException:
            token.cancel()
            raise
