"""A differentiable rasteriser of 3D Gaussians on Warp, with its loss and optimiser: native code, no compiler needed."""

from .adam import Adam, LearningRates
from .contrast import ContrastHinge, ContrastPlan
from .frame import Frame, Loss, Mask, RasterCamera
from .parameters import Gradients, ParameterSet
from .rasterizer import Rasterizer
from .runner import load

__all__ = [
    "Adam",
    "ContrastHinge",
    "ContrastPlan",
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
