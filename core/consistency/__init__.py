"""Do the views of a scene agree? Correspondences between views, what agrees with the others, and the warping error."""

from .agreement import AgreementSettings, Consensus, SceneAgreement
from .correspondence import Correspondences, CorrespondenceSettings, find_correspondences, view_pairs
from .scene import SceneCorrespondences, nearest_views
from .warping_error import WarpingError, relative_warping_error

__all__ = [
    "AgreementSettings",
    "Consensus",
    "CorrespondenceSettings",
    "Correspondences",
    "SceneAgreement",
    "SceneCorrespondences",
    "WarpingError",
    "find_correspondences",
    "nearest_views",
    "relative_warping_error",
    "view_pairs",
]
