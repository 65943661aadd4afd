"""High dynamic range (HLG and PQ, BT.2020) as sRGB.

Rec. ITU-R BT.2100-2 gives the transfer functions and HLG's OOTF, Report BT.2408 the reference white, Report BT.2390
(5.4.1) the curve that brings highlights into a smaller range, BT.2087 the change of primaries.

Light up to about half of the reference white keeps its value, what is brighter is rolled off. The curve is applied to
the largest of red, green and blue, and the others keep their ratio to it: hue and chromaticity stay as they were
photographed, down to what sRGB does not hold, which is clipped.
"""

from __future__ import annotations

import statistics
from collections.abc import Sequence

import torch
from torch import Tensor

from .matrices import RGB_TO_XYZ
from .spaces import apply_matrix, linear_to_srgb

TRANSFERS = {16: "pq", 18: "hlg"}
"""By ITU-T H.273's number of the transfer characteristics."""
REFERENCE_WHITE = 203.0
"""cd/m² of diffuse white (BT.2408, table 1), which becomes the white of sRGB before the roll-off."""
PEAK = 1000.0
"""cd/m² of the display that HLG is defined on, and that telephones' PQ is graded for."""

# BT.2100-2, table 5.
_HLG_A, _HLG_B, _HLG_C = 0.17883277, 0.28466892, 0.55991073
_HLG_GAMMA = 1.2  # of a display of 1000 cd/m²
# BT.2100-2, table 4.
_PQ_M1, _PQ_M2 = 2610 / 16384, 2523 / 4096 * 128
_PQ_C1, _PQ_C2, _PQ_C3 = 3424 / 4096, 2413 / 4096 * 32, 2392 / 4096 * 32
_PQ_PEAK = 10_000.0
# BT.2020, table 4, to CIE XYZ under D65, as BT.2087 derives it from the primaries.
_BT2020_TO_XYZ = torch.tensor(
    [[0.636958048, 0.144616904, 0.168880975], [0.262700212, 0.677998072, 0.059301716], [0.0, 0.028072693, 1.060985058]],
    dtype=torch.float64,
)
_BT2020_TO_SRGB = (torch.linalg.inv(torch.from_numpy(RGB_TO_XYZ)) @ _BT2020_TO_XYZ).numpy()
_LEAST = 1e-6
_BRIGHT = 0.95  # of the pixels are darker than what becomes white
_MOST_WHITE = 600.0


def hlg_to_light(encoded: Tensor) -> Tensor:
    """(3, H, W) HLG values in [0, 1] to cd/m² of a display of `PEAK` (inverse OETF, then OOTF)."""
    scene = torch.where(
        encoded <= 0.5, encoded.square() / 3.0, (torch.exp((encoded - _HLG_C) / _HLG_A) + _HLG_B) / 12.0
    )
    luminance = torch.einsum("c,chw->hw", _BT2020_TO_XYZ[1].to(scene.dtype), scene)
    return PEAK * luminance.clamp(min=_LEAST).pow(_HLG_GAMMA - 1.0) * scene


def pq_to_light(encoded: Tensor) -> Tensor:
    """PQ values in [0, 1] to cd/m²."""
    power = encoded.pow(1.0 / _PQ_M2)
    return _PQ_PEAK * ((power - _PQ_C1).clamp(min=0.0) / (_PQ_C2 - _PQ_C3 * power)).pow(1.0 / _PQ_M1)


def light_to_pq(light: Tensor) -> Tensor:
    """The inverse of `pq_to_light`."""
    power = (light / _PQ_PEAK).clamp(min=0.0).pow(_PQ_M1)
    return ((_PQ_C1 + _PQ_C2 * power) / (1.0 + _PQ_C3 * power)).pow(_PQ_M2)


def roll_off(light: Tensor, white: float = REFERENCE_WHITE) -> Tensor:
    """cd/m² up to `PEAK` brought below `white`: the EETF of BT.2390, section 5.4.1, without a black lift."""
    peak, top = light_to_pq(torch.tensor([PEAK, white], dtype=torch.float64)).tolist()
    largest = top / peak
    knee = 1.5 * largest - 0.5
    value = (light_to_pq(light) / peak).clamp(max=1.0)
    t = (value - knee) / (1.0 - knee)
    spline = (
        (2.0 * t**3 - 3.0 * t**2 + 1.0) * knee
        + (t**3 - 2.0 * t**2 + t) * (1.0 - knee)
        + (-2.0 * t**3 + 3.0 * t**2) * largest
    )
    return torch.where(value <= knee, light, pq_to_light(spline * peak))


def to_light(encoded: Tensor, transfer: str) -> Tensor:
    """(3, H, W) values in [0, 1], "hlg" or "pq", to cd/m² of BT.2020's primaries."""
    return (hlg_to_light if transfer == "hlg" else pq_to_light)(encoded.clamp(0.0, 1.0))


def brightness_of(light: Tensor) -> float:
    """The luminance in cd/m² that 95 % of the pixels of a (3, H, W) `to_light` stay below; above it are highlights."""
    return float(torch.quantile(light.amax(0).flatten(), _BRIGHT))


def white_of(bright: Sequence[float]) -> float:
    """The luminance in cd/m² that is mapped to white in all pictures of one capture, from the `brightness_of` of each.

    It is the reference white unless more than highlights exceed it: telephones expose a white wall up to twice that.
    """
    return min(max(statistics.median(bright), REFERENCE_WHITE), _MOST_WHITE) if bright else REFERENCE_WHITE


def tone_map(encoded: Tensor, transfer: str, white: float = REFERENCE_WHITE) -> Tensor:
    """(3, H, W) BT.2020 values in [0, 1] to display-referred sRGB in [0, 1].

    Args:
        transfer: "hlg" or "pq".
        white: see `white_of`.
    """
    light = to_light(encoded, transfer)
    largest = light.amax(0).clamp(min=_LEAST)
    kept = light * (roll_off(largest, white) / largest / white)
    return linear_to_srgb(apply_matrix(_BT2020_TO_SRGB, kept).clamp(0.0, 1.0)).clamp(0.0, 1.0)
