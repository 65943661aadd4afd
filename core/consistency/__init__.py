"""Whether the views of a scene agree: correspondences between views, their consensus, and the warping error."""

from .agreement import AgreementSettings, Consensus, SceneAgreement
from .correspondence import Correspondences, CorrespondenceSettings, SceneCorrespondences, nearest_views, view_pairs
from .warping_error import WarpingError, relative_warping_error

__all__ = [
    "AgreementSettings",
    "Consensus",
    "CorrespondenceSettings",
    "Correspondences",
    "SceneAgreement",
    "SceneCorrespondences",
    "WarpingError",
    "nearest_views",
    "relative_warping_error",
    "view_pairs",
]
