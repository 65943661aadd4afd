"""The pipeline without Blender: capture, colour, enhancement, Gaussian training, evaluation. Never imports bpy.

The names below are for use from Python (``from cvdgs.core import simulate``); each is imported when it is first asked
for, so that importing this package costs nothing and needs no more than the standard library.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .capture.reader import read_capture as read_capture
    from .color.metrics import contrast_scores as contrast_scores
    from .color.simulation import simulate as simulate
    from .enhance.lut_fit import fit_lut as fit_lut
    from .enhance.registry import make_enhancer as make_enhancer
    from .pipeline.launch import run as run
    from .settings import Settings as Settings
    from .splats.gaussians import Gaussians as Gaussians
    from .splats.io.files import read_gaussians as read_gaussians
    from .splats.io.files import write_gaussians as write_gaussians
    from .splats.raster import ParameterSet as ParameterSet
    from .splats.raster import RasterCamera as RasterCamera
    from .splats.raster import Rasterizer as Rasterizer
    from .splats.training.plan import TrainingPlan as TrainingPlan
    from .splats.training.trainer import Trainer as Trainer

_NAMES_BY_MODULE = {
    ".capture.reader": ("read_capture",),
    ".color.metrics": ("contrast_scores",),
    ".color.simulation": ("simulate",),
    ".enhance.registry": ("make_enhancer",),
    ".enhance.lut_fit": ("fit_lut",),
    ".pipeline.launch": ("run",),
    ".settings": ("Settings",),
    ".splats.gaussians": ("Gaussians",),
    ".splats.io.files": ("read_gaussians", "write_gaussians"),
    ".splats.raster": ("ParameterSet", "RasterCamera", "Rasterizer"),
    ".splats.training.plan": ("TrainingPlan",),
    ".splats.training.trainer": ("Trainer",),
}
_MODULE_OF = {name: module for module, names in _NAMES_BY_MODULE.items() for name in names}
__all__ = sorted(_MODULE_OF)


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_MODULE_OF[name], __name__), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
