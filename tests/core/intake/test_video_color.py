"""HDR and wide gamut become the sRGB that colour-science computes."""

from __future__ import annotations

import av
import colour
import numpy as np
import pytest
import torch

from cvdgs.core.color.hdr import (
    REFERENCE_WHITE,
    brightness_of,
    hlg_to_light,
    light_to_pq,
    pq_to_light,
    roll_off,
    tone_map,
    white_of,
)
from cvdgs.core.intake.video_color import frame_colors

from .films import planes_frame
from .test_photographs import p3_to_srgb

SIGNALS = np.random.default_rng(3).uniform(0.02, 0.98, (200, 3))


def picture(values: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(np.ascontiguousarray(values.T[:, None]))


def test_hlg_is_that_of_bt2100() -> None:
    light = hlg_to_light(picture(SIGNALS))[:, 0].T.numpy()
    assert np.allclose(light, colour.models.eotf_BT2100_HLG(SIGNALS, L_W=1000), rtol=1e-4, atol=1e-3)


def test_pq_is_that_of_st2084() -> None:
    light = pq_to_light(torch.from_numpy(SIGNALS)).numpy()
    assert np.allclose(light, colour.models.eotf_ST2084(SIGNALS), rtol=1e-6)
    assert np.allclose(light_to_pq(torch.from_numpy(light)).numpy(), SIGNALS)


def reference(light: np.ndarray) -> np.ndarray:
    """sRGB of BT.2020 light, with BT.2390's curve written from the report, by colour-science's matrices."""
    peak, target = (float(colour.models.eotf_inverse_ST2084(value)) for value in (1000.0, REFERENCE_WHITE))
    largest = light.max(1)
    e1 = colour.models.eotf_inverse_ST2084(np.minimum(largest, 1000.0)) / peak
    top = target / peak
    start = 1.5 * top - 0.5
    t = (e1 - start) / (1 - start)
    curve = (2 * t**3 - 3 * t**2 + 1) * start + (t**3 - 2 * t**2 + t) * (1 - start) + (-2 * t**3 + 3 * t**2) * top
    rolled = colour.models.eotf_ST2084(np.where(e1 < start, e1, curve) * peak)
    linear = light * (rolled / largest)[:, None] / REFERENCE_WHITE
    matrix = colour.matrix_RGB_to_RGB(
        colour.RGB_COLOURSPACES["ITU-R BT.2020"], colour.RGB_COLOURSPACES["sRGB"], chromatic_adaptation_transform=None
    )
    return colour.models.eotf_inverse_sRGB(np.clip(linear @ matrix.T, 0.0, 1.0))


def difference(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """ΔE00 of sRGB colours."""
    labs = [colour.XYZ_to_Lab(colour.sRGB_to_XYZ(values)) for values in (first, second)]
    return colour.delta_E(*labs, method="CIE 2000")


@pytest.mark.parametrize("transfer", ["hlg", "pq"])
def test_tone_mapping_is_that_of_the_reports(transfer: str) -> None:
    eotf = colour.models.eotf_BT2100_HLG if transfer == "hlg" else colour.models.eotf_ST2084
    found = tone_map(picture(SIGNALS), transfer)[:, 0].T.numpy()
    assert difference(found, reference(np.asarray(eotf(SIGNALS)))).mean() < 0.2


def test_what_is_not_bright_keeps_its_light_and_nothing_is_brighter_than_white() -> None:
    light = torch.tensor([1.0, 30.0, 80.0], dtype=torch.float64)
    assert torch.allclose(roll_off(light), light)
    bright = roll_off(torch.linspace(100.0, 1000.0, 50, dtype=torch.float64))
    assert bright.max() <= REFERENCE_WHITE * 1.001
    assert (bright.diff() > 0.0).all()


def test_a_bright_wall_sets_the_white_and_highlights_do_not() -> None:
    dim = torch.full((3, 10, 100), 90.0)
    dim[:, 0, :20] = 900.0
    assert white_of([brightness_of(dim)]) == REFERENCE_WHITE
    assert white_of([brightness_of(torch.full((3, 10, 10), 350.0))]) == pytest.approx(350.0)
    assert white_of([]) == REFERENCE_WHITE


def test_a_bright_wall_in_a_saturated_colour_sets_the_white_too() -> None:
    """Or its colour is clipped, which is as bright in one channel as a white wall's."""
    red = torch.tensor([350.0, 40.0, 40.0])[:, None, None].expand(3, 10, 10)
    assert white_of([brightness_of(red)]) == pytest.approx(350.0)


@pytest.mark.parametrize(
    ("matrix", "space"), [(1, "ITU-R BT.709"), (6, "ITU-R BT.601"), (9, "ITU-R BT.2020")], ids=["709", "601", "2020"]
)
@pytest.mark.parametrize("bits", [8, 10])
def test_a_frame_has_the_colours_of_its_matrix(matrix: int, space: str, bits: int) -> None:
    scale = 2 ** (bits - 8)
    codes = np.array([120, 100, 160]) * scale
    frame = planes_frame(*codes, pixel_format="yuv420p" if bits == 8 else "yuv420p10le")
    frame.colorspace = matrix
    weights = colour.WEIGHTS_YCBCR[space]
    expected = colour.YCbCr_to_RGB(codes, K=weights, in_bits=bits, in_legal=True, in_int=True, out_legal=False)
    assert np.abs(frame_colors(frame)[20, 20] / 255.0 - np.clip(expected, 0, 1)).max() < 1.0 / 255


@pytest.mark.parametrize(("height", "space"), [(576, "ITU-R BT.601"), (720, "ITU-R BT.709")])
def test_a_frame_that_names_no_matrix_has_that_of_televisions_of_its_size(height: int, space: str) -> None:
    codes = np.array([120, 100, 160])
    frame = planes_frame(*codes, pixel_format="yuv420p", width=height * 4 // 3, height=height)
    weights = colour.WEIGHTS_YCBCR[space]
    expected = colour.YCbCr_to_RGB(codes, K=weights, in_bits=8, in_legal=True, in_int=True, out_legal=False)
    assert np.abs(frame_colors(frame)[20, 20] / 255.0 - expected).max() < 1.0 / 255


def test_a_frame_of_display_p3_becomes_srgb() -> None:
    frame = planes_frame(120, 100, 160, "yuv420p")
    frame.colorspace = 1
    stored = frame_colors(frame)
    frame.color_primaries = 12
    expected = p3_to_srgb(stored[20, 20])
    assert np.abs(frame_colors(frame)[20, 20] / 255.0 - expected).max() < 1.0 / 255
    assert np.abs(stored[20, 20] / 255.0 - expected).max() > 5.0 / 255


@pytest.mark.parametrize("transfer", [1, 14, 15], ids=["BT.709", "BT.2020, 10 bits", "BT.2020, 12 bits"])
def test_a_frame_of_bt2020_that_is_not_hdr_becomes_srgb(transfer: int) -> None:
    frame = planes_frame(120, 110, 150, "yuv420p")
    frame.colorspace, frame.color_trc = 9, transfer
    stored = frame_colors(frame)[20, 20] / 255.0
    frame.color_primaries = 9
    matrix = colour.matrix_RGB_to_RGB(
        colour.RGB_COLOURSPACES["ITU-R BT.2020"], colour.RGB_COLOURSPACES["sRGB"], chromatic_adaptation_transform=None
    )
    expected = colour.models.eotf_inverse_sRGB(matrix @ colour.models.eotf_sRGB(stored))
    assert np.abs(frame_colors(frame)[20, 20] / 255.0 - expected).max() < 1.5 / 255
    assert np.abs(stored - expected).max() > 5.0 / 255


def blue_differences(across: int, down: int) -> av.VideoFrame:
    """A frame whose blue differences rise from 80 by so much from column to column and row to row of their plane."""
    frame = planes_frame(120, 128, 128, "yuv420p")
    plane = frame.planes[1]
    codes = 80 + np.add.outer(down * np.arange(plane.height), across * np.arange(plane.line_size))
    plane.update(codes.astype(np.uint8).tobytes())
    return frame


def test_colours_lie_on_every_second_column_and_between_rows() -> None:
    """As H.264 and HEVC have it; half a column aside, every edge between colours gets a fringe."""
    across, down = (frame_colors(blue_differences(*steps)).astype(int) for steps in ((2, 0), (0, 4)))
    for place in (10, 21, 40):
        at_column, at_row = (
            frame_colors(planes_frame(120, code, 128, "yuv420p")) for code in (80 + place, 79 + 2 * place)
        )
        assert np.abs(across[20, place] - at_column[20, 20]).max() <= 1
        assert np.abs(down[place, 20] - at_row[20, 20]).max() <= 1


def test_full_range_is_not_stretched() -> None:
    frame = planes_frame(64, 128, 128, "yuv420p")
    frame.color_range = 2
    assert (frame_colors(frame) == 64).all()


def test_an_hlg_frame_is_tone_mapped() -> None:
    frame = planes_frame(721, 512, 512, "yuv420p10le")  # 75 %, the reference white
    frame.colorspace, frame.color_trc, frame.color_primaries = 9, 18, 9
    grey = frame_colors(frame)[0, 0].astype(float)
    assert np.ptp(grey) <= 1
    assert 205 < grey.mean() < 245
    assert grey.mean() > frame_colors(frame, white=400.0)[0, 0].mean()
