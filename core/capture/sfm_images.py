"""Copies of photographs in which features are sought: of bounded size, of any format we read, in names of our own.

pycolmap splits the lines of its list of pairs at spaces, reads fewer formats, and knows nothing of transparency.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..files.images import write_png
from .images import read_header, read_pixels
from .masks import read_mask, resized_mask
from .scaling import downscale_with_alpha, fit_size
from .sfm_job import SfmJob

PLAIN, EVEN, MASKS = "photographs", "even", "masks"
_COVERED = 128  # of 255: features of pixels below it are left out
# Of the longer side: over how much of a photograph contrast is made even. A 50th is a few features wide.
_NEIGHBOURHOOD = 1 / 50
_SPREAD = 45.0  # grey levels of a standard deviation, once it is even
# Grey levels of noise that is not to be made strong: of a dark frame's 8 bits, quantisation and compression.
_NOISE = 1.5


def copy_name(index: int) -> str:
    """Of the photograph `index` of a job."""
    return f"{index:06d}.png"


def index_of(copy: str) -> int:
    """The photograph of a copy's name."""
    return int(Path(copy).stem)


def copy_photographs(job: SfmJob, told: Callable[[int], None]) -> list[tuple[int, int]]:
    """Copy the job's photographs into its workspace, with masks where they have some or are transparent.

    Args:
        told: called with how many are done.

    Returns:
        (width, height) of each as it is stored.

    Raises:
        InputError: a photograph or a mask is damaged.
    """
    workspace = Path(job.workspace)
    (workspace / MASKS).mkdir(exist_ok=True)
    sizes = []
    # One after the other: decoded photographs are what costs memory.
    for index, name in enumerate(job.names):
        image, alpha = read_pixels(Path(job.folder) / name)
        sizes.append((image.shape[1], image.shape[0]))
        width, height = fit_size(*sizes[-1], job.settings.max_image_size)
        image, alpha = downscale_with_alpha(image, alpha, width, height)
        write_png(workspace / PLAIN / copy_name(index), image)
        covered = None if alpha is None else np.where(alpha >= _COVERED, 255, 0).astype(np.uint8)
        if name in job.masks:
            shown = read_mask(Path(job.masks[name]), read_header(Path(job.folder) / name), upright=False)
            shown = resized_mask(shown, width, height)
            covered = shown if covered is None else np.minimum(covered, shown)
        if covered is not None:
            write_png(workspace / MASKS / f"{copy_name(index)}.png", np.repeat(covered[..., None], 3, axis=2))
        told(index + 1)
    return sizes


def even_out(job: SfmJob) -> None:
    """Make copies in whose parts contrast is alike, so that dark and dull ones show features, too."""
    workspace = Path(job.workspace)

    def write(index: int) -> None:
        image, _ = read_pixels(workspace / PLAIN / copy_name(index))
        even = evened(image)
        write_png(workspace / EVEN / copy_name(index), np.repeat(even[..., None], 3, axis=2))

    with ThreadPoolExecutor(job.settings.threads) as pool:
        list(pool.map(write, range(len(job.names))))


def evened(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """(H, W) grey of an (H, W, 3) photograph, its local mean and local standard deviation made the same everywhere."""
    grey = image.astype(np.float32) @ np.array([0.299, 0.587, 0.114], np.float32)
    sigma = max(grey.shape) * _NEIGHBOURHOOD
    mean = ndimage.gaussian_filter(grey, sigma)
    spread = np.sqrt(np.maximum(ndimage.gaussian_filter(grey * grey, sigma) - mean * mean, 0.0))
    even = 128.0 + _SPREAD * (grey - mean) / (spread + _NOISE)
    return np.rint(np.clip(even, 0.0, 255.0)).astype(np.uint8)
