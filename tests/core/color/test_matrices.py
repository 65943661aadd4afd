"""The models' matrices agree with their published tables and with independent implementations."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from daltonlens import simulate as daltonlens
from hypothesis import given, settings
from hypothesis import strategies as st

from cvdgs.core.color.matrices import LUMINANCE, LinearSimulation, linear_simulation
from cvdgs.core.errors import InputError
from cvdgs.core.settings import CVD_TYPES

COLOUR_SCIENCE_NAMES = {"protan": "Protanomaly", "deutan": "Deuteranomaly", "tritan": "Tritanomaly"}
DALTONLENS_TYPES = {
    "protan": daltonlens.Deficiency.PROTAN,
    "deutan": daltonlens.Deficiency.DEUTAN,
    "tritan": daltonlens.Deficiency.TRITAN,
}
COMBINATIONS = [
    (cvd, model)
    for cvd in CVD_TYPES
    for model in ("machado", "vienot", "brettel")
    if (cvd, model) != ("tritan", "vienot")
]


def apply(simulation: LinearSimulation, colors: np.ndarray) -> np.ndarray:
    result = colors @ simulation.matrix.T
    if simulation.separator is not None:
        result = np.where((colors @ simulation.separator >= 0)[:, None], result, colors @ simulation.matrix_below.T)
    return result


@pytest.mark.parametrize("cvd", COLOUR_SCIENCE_NAMES)
@pytest.mark.parametrize("tenths", range(11))
@pytest.mark.filterwarnings("ignore:.*Matplotlib")
def test_machado_on_its_grid_is_the_data_set_of_colour_science(cvd: str, tenths: int) -> None:
    from colour.blindness import CVD_MATRICES_MACHADO2010

    published = CVD_MATRICES_MACHADO2010[COLOUR_SCIENCE_NAMES[cvd]][tenths / 10]
    np.testing.assert_allclose(linear_simulation(cvd, tenths / 10).matrix, published, atol=1e-12)


@given(st.sampled_from(sorted(COLOUR_SCIENCE_NAMES)), st.integers(0, 9), st.floats(0.0, 1.0))
@settings(deadline=None)
def test_machado_is_linear_between_the_published_severities(cvd: str, lower: int, fraction: float) -> None:
    below, above = linear_simulation(cvd, lower / 10).matrix, linear_simulation(cvd, (lower + 1) / 10).matrix
    between = linear_simulation(cvd, min((lower + fraction) / 10, 1.0)).matrix
    np.testing.assert_allclose(between, below + fraction * (above - below), atol=1e-9)


@pytest.mark.parametrize(
    ("model", "simulator"),
    [("vienot", daltonlens.Simulator_Vienot1999), ("brettel", daltonlens.Simulator_Brettel1997)],
)
@pytest.mark.parametrize("cvd", DALTONLENS_TYPES)
@pytest.mark.parametrize("severity", [0.35, 1.0])
def test_dichromat_models_agree_with_daltonlens(model: str, simulator: type, cvd: str, severity: float) -> None:
    if (cvd, model) == ("tritan", "vienot"):
        pytest.skip("Viénot does not describe tritan vision")
    colors = np.random.default_rng(0).random((5000, 3))
    expected = simulator()._simulate_cvd_linear_rgb(colors[None].copy(), DALTONLENS_TYPES[cvd], severity)[0]
    np.testing.assert_allclose(apply(linear_simulation(cvd, severity, model), colors), expected, atol=1e-4)


@given(st.sampled_from(COMBINATIONS), st.floats(0.0, 1.0), st.floats(0.0, 1.0))
@settings(deadline=None)
def test_greys_stay_grey(combination: tuple[str, str], severity: float, level: float) -> None:
    cvd, model = combination
    grey = np.full((1, 3), level)
    np.testing.assert_allclose(apply(linear_simulation(cvd, severity, model), grey), grey, atol=1e-6)


@given(st.sampled_from(COMBINATIONS))
@settings(deadline=None)
def test_severity_zero_is_the_identity(combination: tuple[str, str]) -> None:
    cvd, model = combination
    colors = np.random.default_rng(1).random((100, 3))
    np.testing.assert_allclose(apply(linear_simulation(cvd, 0.0, model), colors), colors, atol=1e-15)


def test_an_achromat_sees_the_luminance() -> None:
    colors = np.random.default_rng(2).random((100, 3))
    seen = apply(linear_simulation("achromat", 1.0), colors)
    np.testing.assert_allclose(seen, np.repeat(colors @ LUMINANCE[:, None], 3, axis=1), atol=1e-15)
    half = apply(linear_simulation("achromat", 0.5), colors)
    np.testing.assert_allclose(half, (seen + colors) / 2, atol=1e-15)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("deuteranope", 1.0, "machado"), "type"),
        (("deutan", 1.0, "coblis"), "model"),
        (("deutan", 2.0, "machado"), "severity 2"),
        (("deutan", -0.1, "machado"), "severity"),
        (("deutan", float("nan"), "machado"), "severity nan"),
        (("tritan", 1.0, "vienot"), "tritan"),
    ],
)
def test_what_cannot_be_simulated_is_refused_in_one_line(arguments: tuple, said: str) -> None:
    with pytest.raises(InputError, match=said) as refusal:
        linear_simulation(*arguments)
    assert refusal.value.remedy
    assert "\n" not in str(refusal.value)


def test_the_matrices_need_numpy_alone() -> None:
    blocked = ["torch", "kornia", "colour", "bpy", "scipy"]
    program = (
        f"import sys; sys.modules.update(dict.fromkeys({blocked}));"
        "from cvdgs.core.color.matrices import linear_simulation; print(linear_simulation('deutan', 1.0).matrix[0, 0])"
    )
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert result.stdout.strip() == "0.367322", result.stderr
