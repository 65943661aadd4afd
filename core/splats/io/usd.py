"""Writes Gaussians as USD, with OpenUSD's own library (the optional package usd-core). numpy otherwise.

The scene is an Xform with a ParticleField3DGaussianSplat (UsdVol, from OpenUSD 26.3 on), which holds the geometry. Its
variant set `VARIANT_SET` has a variant for each layer with the colours. USD takes colours for linear light unless it is
told otherwise; these are display-referred sRGB, which the prim's ColorSpaceAPI says.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InputError
from ...files.untrusted import remove_abandoned, replacing
from ..gaussians import Gaussians
from .layers import first_of, turn_to_y
from .splat_file import normalised

SUFFIXES = (".usd", ".usda", ".usdc")
VARIANT_SET = "observer"
SCENE = "/Scene"
GAUSSIANS = f"{SCENE}/Gaussians"
_REACH = 3.0  # standard deviations that count as a Gaussian's extent, as in the original renderer
_MOST_LOG_SCALE = 80.0  # exp of which float32 holds, with room for the extent
_NOT_IN_VARIANTS = re.compile(r"[^A-Za-z0-9_-]")


def require_usd(where: Path) -> None:
    """Raise `InputError` unless OpenUSD's library is here."""
    _library(where)


def variant_name(layer: str) -> str:
    """`layer` as USD allows variants to be called: ``deutan-0.5`` is ``deutan-0_5``."""
    return _NOT_IN_VARIANTS.sub("_", layer)


def write_usd(path: str | Path, layers: Mapping[str, Gaussians], up: str = "", metres: float = 1.0) -> None:
    """Write `layers`, whose geometry is the first one's, to `path`; the first layer is the variant that is selected.

    Args:
        up: the axis of the scene that points up. Y and Z are what a stage can have; from another the scene is turned.
            Without it the scene stands as it is, in a stage whose Y points up.
        metres: in a unit of the stage.

    Raises:
        InputError: OpenUSD is not here, there are no Gaussians, two layers would be called alike, or the file cannot be
            written.
    """
    path = Path(path)
    pxr = _library(path)
    first = first_of(layers, path)
    variants = {variant_name(name): gaussians for name, gaussians in layers.items()}
    if len(variants) < len(layers):
        raise InputError("two layers have names that USD cannot tell apart", where=path, remedy="rename one")
    try:
        with replacing(path, contested=True) as temporary:
            temporary.touch()  # OpenUSD would make the folder
            stage = pxr.Usd.Stage.CreateNew(str(temporary))
            _fill(pxr, stage, first, variants, up, metres)
            stage.GetRootLayer().Save()
            del stage  # closes the file, which Windows wants before it gets its name
        remove_abandoned(path)
    except (OSError, pxr.Tf.ErrorException) as error:
        said = getattr(error, "strerror", None) or "OpenUSD refuses"
        raise InputError(
            f"cannot be written ({said})", where=path, remedy="check the folder and its free space"
        ) from None


def _library(where: Path) -> Any:
    """The package pxr with the modules that are used."""
    try:
        import pxr  # here, because it is optional
        from pxr import Gf, Kind, Sdf, Tf, Usd, UsdGeom, UsdVol, Vt  # noqa: F401

        UsdVol.ParticleField3DGaussianSplat  # noqa: B018 - older versions lack it
    except (ImportError, AttributeError):
        raise InputError(
            "USD needs the Python package 'usd-core' from version 26.3 on",
            where=where,
            remedy="install the extra 'usd' (pip install -e '.[usd]'), or write a .glb",
        ) from None
    return pxr


def _fill(pxr: Any, stage: Any, first: Gaussians, variants: Mapping[str, Gaussians], up: str, metres: float) -> None:
    is_z_up = up == "z"
    pxr.UsdGeom.SetStageUpAxis(stage, pxr.UsdGeom.Tokens.z if is_z_up else pxr.UsdGeom.Tokens.y)
    pxr.UsdGeom.SetStageMetersPerUnit(stage, metres)
    scene = pxr.UsdGeom.Xform.Define(stage, SCENE)
    stage.SetDefaultPrim(scene.GetPrim())
    pxr.Usd.ModelAPI(scene).SetKind(pxr.Kind.Tokens.component)
    turn = turn_to_y(up)
    if turn and up not in ("y", "z"):
        x, y, z, w = turn
        scene.AddOrientOp().Set(pxr.Gf.Quatf(w, x, y, z))
    field = pxr.UsdVol.ParticleField3DGaussianSplat.Define(stage, GAUSSIANS)
    _set_geometry(pxr, field, first)
    observers = scene.GetPrim().GetVariantSets().AddVariantSet(VARIANT_SET)
    for name, gaussians in variants.items():
        observers.AddVariant(name)
        observers.SetVariantSelection(name)
        with observers.GetVariantEditContext():
            colors = pxr.UsdVol.ParticleFieldSphericalHarmonicsAttributeAPI(field)
            colors.CreateRadianceSphericalHarmonicsDegreeAttr().Set(gaussians.sh_degree)
            coefficients = np.ascontiguousarray(gaussians.sh).reshape(-1, 3)
            colors.CreateRadianceSphericalHarmonicsCoefficientsAttr().Set(pxr.Vt.Vec3fArray.FromNumpy(coefficients))
    observers.SetVariantSelection(next(iter(variants)))


def _set_geometry(pxr: Any, field: Any, gaussians: Gaussians) -> None:
    vectors = pxr.Vt.Vec3fArray.FromNumpy
    scales = np.exp(np.minimum(gaussians.log_scales, _MOST_LOG_SCALE))
    reach = _REACH * scales.max(axis=1, keepdims=True)
    extent = np.stack([(gaussians.means - reach).min(axis=0), (gaussians.means + reach).max(axis=0)])
    prim, volume = field.GetPrim(), pxr.UsdVol
    volume.ParticleFieldPositionAttributeAPI(prim).CreatePositionsAttr().Set(vectors(gaussians.means))
    volume.ParticleFieldScaleAttributeAPI(prim).CreateScalesAttr().Set(vectors(scales))
    # In memory the real part stands last.
    quaternions = np.ascontiguousarray(normalised(gaussians.quaternions)[:, [1, 2, 3, 0]])
    orientations = volume.ParticleFieldOrientationAttributeAPI(prim).CreateOrientationsAttr()
    orientations.Set(pxr.Vt.QuatfArray.FromNumpy(quaternions))
    with np.errstate(over="ignore"):  # exp(-logit) of a logit below -709 is infinite, and the opacity zero
        opacities = pxr.Vt.FloatArray.FromNumpy(gaussians.opacities)
    volume.ParticleFieldOpacityAttributeAPI(prim).CreateOpacitiesAttr().Set(opacities)
    field.CreateExtentAttr().Set(vectors(extent.astype(np.float32)))
    pxr.Usd.ColorSpaceAPI.Apply(prim).CreateColorSpaceNameAttr().Set(pxr.Gf.ColorSpaceNames.SRGBRec709)
