"""Dense stereo: depth maps of photographs with known cameras, by plane sweep, and the points that they agree on."""

from .depth_maps import DepthMaps, StereoPlan, StereoView, compute_depth_maps
from .points import DensePoints, agreeing, thinned

__all__ = [
    "DensePoints",
    "DepthMaps",
    "StereoPlan",
    "StereoView",
    "agreeing",
    "compute_depth_maps",
    "thinned",
]
