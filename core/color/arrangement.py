"""A colour arrangement test like Farnsworth's panel D-15, which suggests whose eyes to make a scene for. No diagnosis.

Fifteen caps of one lightness are put in a row, each next to the most similar one, starting from a fixed cap. Neighbours
that lie far apart in colour space tell along which axis colours are confused. The analysis is Vingrys and King-Smith's
(1988, "A quantitative scoring technique for panel tests of color vision", IOVS 29): the moments of inertia of the
differences between neighbours.

numpy only, as Blender needs it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from . import srgb
from .matrices import RGB_TO_XYZ

NO_DIAGNOSIS = (
    "This is not a diagnosis: screens and room light vary, and only a specialist can test colour vision. "
    "It only suggests settings for this scene."
)

CAP_COUNT = 15

# CIELUV u* and v* of the reference cap and of caps 1 to 15 under illuminant C (Vingrys and King-Smith 1988, appendix).
CAPS_UV = np.array(
    [
        (-21.54, -38.39),
        (-23.26, -25.56),
        (-22.41, -15.53),
        (-23.11, -7.45),
        (-22.45, 1.10),
        (-21.67, 7.35),
        (-14.08, 18.74),
        (-2.72, 28.13),
        (14.84, 31.13),
        (23.87, 26.35),
        (31.82, 14.76),
        (31.42, 6.99),
        (29.79, 0.10),
        (26.64, -9.38),
        (22.92, -18.65),
        (11.20, -24.61),
    ]
)
_LIGHTNESS = 51.57  # L* of Munsell value 5, which all caps have (Newhall, Nickerson and Judd 1943)

LARGEST_NORMAL_CONFUSION = 1.78
"""Above this C-index an arrangement counts as failed. A few exchanged neighbours stay below 1.4, simulated dichromats
(Machado 2009) who take the nearest cap reach 2.7 and more."""
LEAST_SELECTIVITY = 1.7
"""Below this S-index the errors have no common axis; caps in perfect order have 1.38."""


@dataclass(frozen=True)
class ConfusionAxis:
    """Where the confusion axis of a type lies, and how its C-index tells the severity.

    Attributes:
        cvd: the type.
        low, high: angles in degrees between which the axis lies.
        confusion: C-indices of simulated observers (Machado 2009) who always take the nearest cap ...
        severity: ... and their severities. Weaker deficiencies arrange the caps in order.
    """

    cvd: str
    low: float
    high: float
    confusion: tuple[float, ...]
    severity: tuple[float, ...]


# Patients' mean angles are +8.8 (protan), -7.4 (deutan) and -82.8 degrees (tritan; Vingrys and King-Smith), those of
# the simulated observers +4, -12 and -85: the bounds lie between both. An axis at -90 degrees is the same as at +90.
AXES = (
    ConfusionAxis("protan", -2.0, 35.0, (1.0, 2.2, 3.4, 4.0), (0.4, 0.6, 0.8, 1.0)),
    ConfusionAxis("deutan", -40.0, -2.0, (1.0, 2.1, 3.5, 4.0), (0.4, 0.6, 0.8, 1.0)),
    ConfusionAxis("tritan", -115.0, -65.0, (1.0, 1.6, 2.7), (0.6, 0.8, 1.0)),
)


@dataclass(frozen=True)
class ArrangementScore:
    """Vingrys and King-Smith's figures of an arrangement.

    Attributes:
        angle: of the confusion axis, degrees in (-90, 90]; 62 for caps in perfect order.
        confusion: C-index: the major radius in units of that of caps in perfect order.
        selectivity: S-index: how much longer the major radius is than the minor one.
    """

    angle: float
    confusion: float
    selectivity: float


@dataclass(frozen=True)
class Suggestion:
    """What an arrangement suggests.

    Attributes:
        message: one sentence.
        cvd: the type, or None where there is nothing to suggest.
        severity: of the type, 0 to 1.
    """

    message: str
    cvd: str | None = None
    severity: float = 0.0


def score_arrangement(caps: Sequence[int]) -> ArrangementScore:
    """Score the caps 1 to 15 in the order in which they were put beside the reference cap.

    Raises:
        ValueError: a cap is missing or there twice.
    """
    if sorted(caps) != list(range(1, CAP_COUNT + 1)):
        raise ValueError("an arrangement has each of the caps 1 to 15 once")
    perfect, _, _ = _moments(range(1, CAP_COUNT + 1))
    major, minor, axis = _moments(caps)
    angle = float(np.degrees(np.arctan2(axis[1], axis[0])))
    return ArrangementScore(90.0 - (90.0 - angle) % 180.0, major / perfect, major / minor)


def suggest(score: ArrangementScore) -> Suggestion:
    """The viewer's type and severity, as far as an arrangement tells."""
    if score.confusion <= LARGEST_NORMAL_CONFUSION:
        return Suggestion("The caps are in order or nearly so. This test shows no deficiency.")
    if score.selectivity >= LEAST_SELECTIVITY:
        for axis in AXES:
            if any(axis.low <= angle < axis.high for angle in (score.angle, score.angle - 180.0)):
                severity = round(float(np.interp(score.confusion, axis.confusion, axis.severity)), 1)
                message = f"The mistakes lie along one axis, as for {axis.cvd} vision of severity {severity:g}."
                return Suggestion(message, axis.cvd, severity)
    return Suggestion("This order fits no type. Try again in better light.")


def cap_colors() -> NDArray[np.float64]:
    """(16, 3) display-referred sRGB of the reference cap and the caps 1 to 15, as if the screen's white were theirs."""
    white = RGB_TO_XYZ.sum(axis=1)
    denominator = white @ (1.0, 15.0, 3.0)
    u = CAPS_UV[:, 0] / (13.0 * _LIGHTNESS) + 4.0 * white[0] / denominator
    v = CAPS_UV[:, 1] / (13.0 * _LIGHTNESS) + 9.0 * white[1] / denominator
    luminance = ((_LIGHTNESS + 16.0) / 116.0) ** 3
    xyz = luminance * np.stack([9.0 * u, 4.0 * v, 12.0 - 3.0 * u - 20.0 * v]) / (4.0 * v)
    return srgb.encode(np.clip(np.linalg.solve(RGB_TO_XYZ, xyz).T, 0.0, 1.0))


def _moments(caps: Sequence[int] | range) -> tuple[float, float, NDArray[np.float64]]:
    """Major and minor radius of the differences between neighbours, and the major one's direction (2,)."""
    differences = np.diff(CAPS_UV[[0, *caps]], axis=0)
    moments, directions = np.linalg.eigh(differences.T @ differences / CAP_COUNT)
    minor, major = np.sqrt(moments)
    return float(major), float(minor), directions[:, 1]
