"""Colour spaces agree with colorspacious and colour-science and are safe to differentiate."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from colorspacious import cspace_convert
from hypothesis import given, settings
from hypothesis import strategies as st

from cvdgs.core.color import srgb
from cvdgs.core.color.spaces import (
    delta_e_76,
    delta_e_2000,
    image_to_tensor,
    lab_to_linear,
    linear_to_srgb,
    linear_to_xyz,
    srgb_to_lab,
    srgb_to_linear,
    tensor_to_image,
)

COLORS = np.random.default_rng(0).random((2000, 3))
AS_TENSOR = torch.from_numpy(COLORS.T.copy())[..., None]


def test_srgb_decoding_agrees_with_colorspacious() -> None:
    expected = cspace_convert(COLORS, "sRGB1", "sRGB1-linear")
    np.testing.assert_allclose(srgb_to_linear(AS_TENSOR)[..., 0].T.numpy(), expected, atol=1e-12)


def test_xyz_and_lab_agree_with_colorspacious_to_the_rounding_of_its_matrix() -> None:
    expected = cspace_convert(COLORS, "sRGB1", "XYZ1")
    np.testing.assert_allclose(linear_to_xyz(srgb_to_linear(AS_TENSOR))[..., 0].T.numpy(), expected, atol=3e-4)
    lab = cspace_convert(COLORS, "sRGB1", "CIELab")
    np.testing.assert_allclose(srgb_to_lab(AS_TENSOR)[..., 0].T.numpy(), lab, atol=0.05)


def test_lab_leads_back_to_linear_light() -> None:
    linear = srgb_to_linear(AS_TENSOR)
    torch.testing.assert_close(lab_to_linear(srgb_to_lab(AS_TENSOR)), linear, atol=1e-6, rtol=0)


def test_the_transfer_function_is_the_same_without_torch() -> None:
    light = cspace_convert(COLORS, "sRGB1", "sRGB1-linear")
    np.testing.assert_allclose(srgb.decode(COLORS), light, atol=1e-12)
    np.testing.assert_allclose(srgb.encode(light), linear_to_srgb(torch.from_numpy(light)).numpy(), atol=1e-12)


@given(st.floats(-0.5, 1.5))
@settings(deadline=None)
def test_srgb_encoding_undoes_decoding(value: float) -> None:
    encoded = torch.full((3, 1, 1), value, dtype=torch.float64)
    torch.testing.assert_close(linear_to_srgb(srgb_to_linear(encoded)), encoded, atol=1e-6, rtol=0)


@given(st.floats(0.0, 1.0))
@settings(deadline=None)
def test_greys_have_no_chroma(level: float) -> None:
    lab = srgb_to_lab(torch.full((3, 1, 1), level, dtype=torch.float64))
    assert lab[1:].abs().max() < 1e-9


def test_white_has_lightness_100_and_black_0() -> None:
    lab = srgb_to_lab(torch.tensor([[0.0, 1.0]] * 3, dtype=torch.float64)[..., None])
    assert lab[0, :, 0].tolist() == pytest.approx([0.0, 100.0], abs=1e-9)


def test_lab_is_differentiable_from_black_to_white() -> None:
    levels = torch.linspace(0.0, 1.0, 12, dtype=torch.float64)
    image = torch.cartesian_prod(levels[::4], levels[1::5], levels[::3]).T[..., None].clone().requires_grad_(True)
    assert torch.autograd.gradcheck(srgb_to_lab, image, atol=1e-4)
    black = torch.zeros(3, 1, 1, requires_grad=True)
    srgb_to_lab(black).sum().backward()
    assert torch.isfinite(black.grad).all()


def test_delta_e_76_is_the_euclidean_distance_with_a_finite_gradient_where_colours_agree() -> None:
    first = torch.tensor([50.0, 10.0, 0.0])[:, None, None].requires_grad_(True)
    second = torch.tensor([50.0, 13.0, -4.0])[:, None, None]
    assert delta_e_76(first, second).item() == pytest.approx(5.0)
    difference = delta_e_76(first, first.detach())
    assert difference.item() < 1e-12
    difference.sum().backward()
    assert not first.grad.any()


@pytest.mark.filterwarnings("ignore:.*Matplotlib")
def test_delta_e_2000_agrees_with_the_pairs_published_by_sharma() -> None:
    # Sharma, Wu and Dalal 2005, table 1: two pairs that are inside the sRGB gamut, as sRGB.
    from colour import Lab_to_XYZ, XYZ_to_sRGB

    table = [((50.0, 2.5, 0.0), (73.0, 25.0, -18.0), 27.1492), ((50.0, 2.5, 0.0), (58.0, 24.0, 15.0), 19.4535)]
    white = np.array([0.95047, 1.0, 1.08883])
    xy = white[:2] / white.sum()
    for first, second, expected in table:
        pair = [
            torch.from_numpy(XYZ_to_sRGB(Lab_to_XYZ(lab, xy), chromatic_adaptation_transform=None))[:, None, None]
            for lab in (np.array(first), np.array(second))
        ]
        assert delta_e_2000(*pair).item() == pytest.approx(expected, abs=0.02)


def test_arrays_become_tensors_and_come_back() -> None:
    image = np.random.default_rng(1).integers(0, 256, (4, 6, 3), dtype=np.uint8)
    tensor = image_to_tensor(image)
    assert tensor.shape == (3, 4, 6)
    np.testing.assert_array_equal((tensor_to_image(tensor) * 255).round().astype(np.uint8), image)
    np.testing.assert_array_equal(tensor_to_image(image_to_tensor(tensor_to_image(tensor))), tensor_to_image(tensor))
