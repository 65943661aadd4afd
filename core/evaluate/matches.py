"""Points that pairs of a scene's views share, found once on the unenhanced reconstruction and used for every layer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from numpy.typing import NDArray

from ..consistency import Correspondences, SceneCorrespondences, relative_warping_error, view_pairs
from ..consistency.correspondence import LONG_RANGE_STEP, SHORT_RANGE_STEP

# A run of neighbouring views, so that pairs of the defined distance exist however many views there are.
MOST_CONSISTENCY_VIEWS = 48


@dataclass(frozen=True)
class SceneMatches:
    """Correspondences between views.

    Attributes:
        views: indices of the views that take part.
        short, long: of pairs `SHORT_RANGE_STEP` and `LONG_RANGE_STEP` views apart, numbered within `views`.
    """

    views: list[int]
    short: list[Correspondences]
    long: list[Correspondences]

    @classmethod
    def find(cls, correspondences: SceneCorrespondences) -> SceneMatches:
        """Match the first views of a scene, each pair unless that was done before."""
        count = min(len(correspondences.views), MOST_CONSISTENCY_VIEWS)
        short, long = (
            correspondences.of_pairs(view_pairs(count, step)) for step in (SHORT_RANGE_STEP, LONG_RANGE_STEP)
        )
        return cls(list(range(count)), short, long)

    @property
    def pairs(self) -> int:
        """Pairs of neighbouring views that share points."""
        return sum(len(found) > 0 for found in self.short)

    def warping_errors(
        self, originals: Sequence[NDArray], enhanced: Sequence[NDArray], rendered: Sequence[NDArray]
    ) -> dict[str, float | int]:
        """RWE of the rendered layer against the photographs, and of the enhanced views before reconstruction."""
        short = relative_warping_error(originals, rendered, self.short)
        return {
            "ratio": short.ratio,
            "absolute": short.absolute,
            "long_range_ratio": relative_warping_error(originals, rendered, self.long).ratio,
            "normalised_ratio": short.normalised_ratio,
            "enhanced_ratio": relative_warping_error(originals, enhanced, self.short).ratio,
            "pairs": self.pairs,
        }
