"""Models of colour vision deficiency as matrices on linear sRGB. numpy only: Blender's Python imports this.

Three models are available. None of them covers achromatopsia, which is simulated as linear luminance under each.

- `machado`: Machado et al. 2009. The severity is a shift of a cone's spectral sensitivity; the published matrices for
  severities 0, 0.1 ... 1 are interpolated linearly. The only model that describes anomalous trichromacy.
- `vienot`: Viénot, Brettel and Mollon 1999, "Digital video colourmaps for checking the legibility of displays by
  dichromats". One plane in cone space; protan and deutan only.
- `brettel`: Brettel, Viénot and Mollon 1997, "Computerized simulation of color appearance for dichromats". Two
  half-planes in cone space; the accepted model of tritanopia.

Viénot and Brettel describe dichromats. For severities below 1 their result is blended linearly with the original in
linear RGB, as DaltonLens does, and so is achromatopsia. That is a convention, not a model of the eye.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..settings import CVD_TYPES, SIMULATIONS
from . import machado2009

Matrix = NDArray[np.float64]

_REC709_PRIMARIES = np.array([[0.64, 0.33], [0.30, 0.60], [0.15, 0.06]])  # ITU-R BT.709, xy of red, green, blue
_D65 = np.array([0.95047, 1.0, 1.08883])  # ASTM E308, XYZ of white for the 2° observer

_CONE_AXIS = {"protan": 0, "deutan": 1, "tritan": 2}  # the missing one of L, M and S

# Cone fundamentals of Smith and Pokorny 1975, as given by Viénot et al. 1999.
_XYZ_TO_LMS = np.array([[0.15514, 0.54312, -0.03286], [-0.15514, 0.45684, 0.03286], [0.0, 0.0, 0.01608]])

# CIE 1931 2° tristimulus values of the monochromatic anchors of Brettel et al. 1997: the hues that dichromats and
# trichromats are believed to see alike.
_RED_GREEN_ANCHORS = np.array([[0.1421, 0.1126, 1.0419], [0.8425, 0.9154, 0.0018]])  # 475 and 575 nm
_TRITAN_ANCHORS = np.array([[0.05795, 0.1693, 0.6162], [0.1649, 0.0610, 0.0000]])  # 485 and 660 nm


def _rgb_to_xyz() -> Matrix:
    """Linear sRGB to CIE XYZ from the primaries and the white point (SMPTE RP 177)."""
    x, y = _REC709_PRIMARIES.T
    primaries = np.stack([x / y, np.ones(3), (1.0 - x - y) / y])
    return primaries * np.linalg.solve(primaries, _D65)


RGB_TO_XYZ: Matrix = _rgb_to_xyz()
"""(3, 3) linear sRGB to CIE XYZ, Y of white = 1. Its row sums are the white point D65."""

LUMINANCE: NDArray[np.float64] = RGB_TO_XYZ[1]
"""(3,) linear sRGB to relative luminance."""

_RGB_TO_LMS = _XYZ_TO_LMS @ RGB_TO_XYZ


@dataclass(frozen=True)
class LinearSimulation:
    """A simulation as a piecewise linear map of linear sRGB, before clipping.

    Attributes:
        matrix: (3, 3), used where `separator` · rgb >= 0.
        matrix_below: (3, 3), used elsewhere; None where one matrix serves all colours.
        separator: (3,) normal of the plane between the two, in linear sRGB; None where `matrix_below` is.
    """

    matrix: Matrix
    matrix_below: Matrix | None = None
    separator: NDArray[np.float64] | None = None

    def blended(self, severity: float) -> LinearSimulation:
        """This simulation mixed linearly with the identity: 0 is the identity, 1 this simulation."""

        def mix(matrix: Matrix) -> Matrix:
            return (1.0 - severity) * np.eye(3) + severity * matrix

        below = None if self.matrix_below is None else mix(self.matrix_below)
        return LinearSimulation(mix(self.matrix), below, self.separator)


def check_simulation(cvd: str, severity: float, model: str = "machado") -> None:
    """Raise `InputError` unless (cvd, severity, model) can be simulated."""
    if cvd not in CVD_TYPES:
        raise InputError(f"{cvd!r} is not a type of colour vision deficiency", remedy=f"use {_choice(CVD_TYPES)}")
    if model not in SIMULATIONS:
        raise InputError(f"{model!r} is not a simulation model", remedy=f"use {_choice(SIMULATIONS)}")
    if not 0.0 <= severity <= 1.0:  # also refuses NaN
        raise InputError(f"severity {severity:g} is out of range", remedy="give a number from 0 to 1")
    if model == "vienot" and cvd == "tritan":
        raise InputError("the Viénot model does not describe tritan vision", remedy="use brettel or machado")


def _choice(names: tuple[str, ...]) -> str:
    return ", ".join(names[:-1]) + " or " + names[-1]


@lru_cache(maxsize=256)
def linear_simulation(cvd: str, severity: float, model: str = "machado") -> LinearSimulation:
    """The simulation of `cvd` at `severity` in [0, 1] under `model`.

    Raises:
        InputError: unknown type or model, severity out of range, or a type that the model does not describe.
    """
    check_simulation(cvd, severity, model)
    if cvd == "achromat":
        return LinearSimulation(np.tile(LUMINANCE, (3, 1))).blended(severity)
    if model == "machado":
        return LinearSimulation(_machado(cvd, severity))
    dichromat = _vienot(cvd) if model == "vienot" else _brettel(cvd)
    return dichromat.blended(severity)


def _machado(cvd: str, severity: float) -> Matrix:
    table = machado2009.MATRICES[cvd]
    position = severity / machado2009.SEVERITY_STEP
    lower = min(int(position), len(table) - 2)
    fraction = position - lower
    return (1.0 - fraction) * table[lower] + fraction * table[lower + 1]


def _vienot(cvd: str) -> LinearSimulation:
    """Projection along the axis of the missing cone onto the plane through black, the blue primary and yellow."""
    blue, yellow = _RGB_TO_LMS @ [0.0, 0.0, 1.0], _RGB_TO_LMS @ [1.0, 1.0, 0.0]
    return LinearSimulation(_in_rgb(_projection(np.cross(yellow, blue), cvd)))


def _brettel(cvd: str) -> LinearSimulation:
    """Projection onto one of two half-planes through black, white and an anchor: the one on the colour's side of white.

    White replaces the equal-energy stimulus as the neutral axis, so that displayed greys stay grey.
    """
    white = _RGB_TO_LMS @ np.ones(3)
    separator = np.cross(white, np.eye(3)[_CONE_AXIS[cvd]])
    anchors_xyz = _TRITAN_ANCHORS if cvd == "tritan" else _RED_GREEN_ANCHORS
    anchors = sorted(anchors_xyz @ _XYZ_TO_LMS.T, key=lambda anchor: -float(separator @ anchor))
    above, below = (_in_rgb(_projection(np.cross(white, anchor), cvd)) for anchor in anchors)
    return LinearSimulation(above, below, separator @ _RGB_TO_LMS)


def _projection(normal: NDArray[np.float64], cvd: str) -> Matrix:
    """(3, 3) in cone space: replace the missing cone's response so that normal · lms = 0."""
    axis = _CONE_AXIS[cvd]
    matrix = np.eye(3)
    matrix[axis] = -normal / normal[axis]
    matrix[axis, axis] = 0.0
    return matrix


def _in_rgb(matrix: Matrix) -> Matrix:
    return np.linalg.solve(_RGB_TO_LMS, matrix @ _RGB_TO_LMS)
