"""A differentiable rasteriser of 3D Gaussians on Warp, with its loss and optimiser: native code, no compiler needed."""

from .adam import Adam, LearningRates
from .camera import RasterCamera
from .frame import Frame, Loss, Mask
from .loading import load
from .parameters import Gradients, ParameterSet
from .rasterizer import Rasterizer

__all__ = [
    "Adam",
    "Frame",
    "Gradients",
    "LearningRates",
    "Loss",
    "Mask",
    "ParameterSet",
    "RasterCamera",
    "Rasterizer",
    "load",
]
