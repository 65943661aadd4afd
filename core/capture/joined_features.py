"""Features of several photographs that matches join: each such set shows one point, if its matches are right."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components


def join_features(
    matches: Mapping[tuple[int, int], NDArray[np.int64]], counts: Mapping[int, int]
) -> tuple[dict[int, int], NDArray[np.int64]]:
    """Number the sets of features that matches join.

    Args:
        matches: by two photographs (n, 2) numbers of their features.
        counts: of each photograph's features.

    Returns:
        Where each photograph's features start when those of all stand one after the other in the order of `counts`, and
        of every feature the number of its set.
    """
    starts, total = {}, 0
    for photograph, count in counts.items():
        starts[photograph], total = total, total + count
    found = [places + [starts[photograph] for photograph in pair] for pair, places in matches.items()]
    joined = np.concatenate([np.zeros((0, 2), np.int64), *found])
    graph = coo_matrix((np.ones(len(joined), np.int8), (joined[:, 0], joined[:, 1])), shape=(total, total))
    return starts, connected_components(graph, directed=False)[1]
