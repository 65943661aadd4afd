"""Which photographs are matched: neighbours in time, and those that look alike, so that cost grows with their number.

What looks alike is found without a vocabulary from elsewhere: descriptors are compared with centres of this capture's
own, and a photograph is what its descriptors lack to them (VLAD; Jégou et al., CVPR 2010).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pycolmap
from numpy.typing import NDArray
from scipy.cluster.vq import kmeans2

from .sfm_job import SfmSettings

_CENTRES = 64
_SAMPLES = 20_000  # descriptors that the centres are made of
_FROM_EACH = 400  # descriptors that stand for a photograph: of its largest features, which are seen from afar, too
_BLOCK = 512  # photographs compared with all others at a time


def pairs_in_time(count: int, settings: SfmSettings) -> set[tuple[int, int]]:
    """Every pair of few photographs; of more, each with its neighbours, in order."""
    if settings.matches_every_pair(count):
        return {(first, second) for second in range(count) for first in range(second)}
    return {(first, first + distance) for distance in settings.distances for first in range(count - distance)}


def pairs_alike(signatures: NDArray[np.float32], count: int) -> set[tuple[int, int]]:
    """Each photograph with the `count` others that look most like it.

    Args:
        signatures: (N, D) of `signatures_of`.
        count: of others; fewer where there are fewer.
    """
    pairs: set[tuple[int, int]] = set()
    total = len(signatures)
    count = min(count, total - 1)
    if count < 1:
        return pairs
    for start in range(0, total, _BLOCK):
        likeness = signatures[start : start + _BLOCK] @ signatures.T
        rows = np.arange(len(likeness))
        likeness[rows, rows + start] = -np.inf
        nearest = np.argpartition(-likeness, count - 1, axis=1)[:, :count]
        for row, others in enumerate(nearest.tolist(), start):
            pairs |= {(min(row, other), max(row, other)) for other in others}
    return pairs


def signatures_of(database: pycolmap.Database, images: Sequence[int], seed: int) -> NDArray[np.float32]:
    """(N, D) unit vectors, one for each image number of `images`; zero for one without features."""
    generator = np.random.default_rng(seed)
    described = [_largest(database, image) for image in images]
    pool = np.concatenate(described)
    signatures = np.zeros((len(images), _CENTRES * 128), np.float32)
    if len(pool) < _CENTRES:
        return signatures
    sample = pool[generator.permutation(len(pool))[:_SAMPLES]]
    centres, _ = kmeans2(sample, _CENTRES, iter=10, minit="points", seed=generator)
    for row, descriptors in enumerate(described):
        if len(descriptors):
            signatures[row] = _signature(descriptors, centres)
    return signatures


def _largest(database: pycolmap.Database, image: int) -> NDArray[np.float32]:
    """(n, 128) unit descriptors of an image's largest features."""
    if not database.num_descriptors_for_image(image):
        return np.zeros((0, 128), np.float32)
    descriptors = np.asarray(database.read_descriptors(image).data, np.float32)
    keypoints = np.asarray(database.read_keypoints(image), np.float32)
    # (x, y, a11, a12, a21, a22): the determinant is the feature's area.
    area = np.abs(keypoints[:, 2] * keypoints[:, 5] - keypoints[:, 3] * keypoints[:, 4])
    chosen = descriptors[np.argsort(-area, kind="stable")[:_FROM_EACH]]
    return chosen / np.maximum(np.linalg.norm(chosen, axis=1, keepdims=True), 1e-6)


def _signature(descriptors: NDArray[np.float32], centres: NDArray[np.float32]) -> NDArray[np.float32]:
    nearest = np.argmin((centres**2).sum(axis=1) - 2.0 * descriptors @ centres.T, axis=1)
    residuals = np.zeros_like(centres)
    np.add.at(residuals, nearest, descriptors - centres[nearest])
    # Each centre counts alike (intra-normalisation), so that what repeats within one photograph does not.
    residuals /= np.maximum(np.linalg.norm(residuals, axis=1, keepdims=True), 1e-6)
    flat = residuals.ravel()
    return flat / max(float(np.linalg.norm(flat)), 1e-6)


def write_pairs(file: Path, pairs: Sequence[tuple[int, int]], names: Sequence[str]) -> None:
    """Write the list that pycolmap matches; `names` must hold no spaces."""
    lines = [f"{names[first]} {names[second]}\n" for first, second in pairs]
    file.write_text("".join(lines), encoding="ascii")
