"""Epipolar geometry: how far two photographs' matches are from what the poses of their cameras allow."""

from __future__ import annotations

import numpy as np
import pycolmap
from numpy.typing import NDArray


def sampson_distances(
    places: NDArray[np.float64], others: NDArray[np.float64], move: pycolmap.Rigid3d
) -> NDArray[np.float64]:
    """First-order distances of matches from their epipolar lines (Hartley and Zisserman 2004, 11.4.3).

    Args:
        places, others: (n, 2) of what was matched in the first and in the second photograph, x / z and y / z in the
            axes of its camera.
        move: from the first camera to the second.

    Returns:
        (n,); a focal length in pixels makes pixels of them.
    """
    essential = pycolmap.essential_matrix_from_pose(move)
    return np.sqrt(np.asarray(pycolmap.compute_squared_sampson_error(places, others, essential), np.float64))
