"""Do the views of a scene agree? Correspondences between views and the warping error over them."""

from .correspondence import Correspondences, CorrespondenceSettings, find_correspondences, view_pairs
from .warping_error import WarpingError, relative_warping_error

__all__ = [
    "CorrespondenceSettings",
    "Correspondences",
    "WarpingError",
    "find_correspondences",
    "relative_warping_error",
    "view_pairs",
]
