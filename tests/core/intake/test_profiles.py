"""Photographs of other colour spaces than sRGB have the colours that colour-science gives them."""

from __future__ import annotations

import struct
from pathlib import Path

import colour
import numpy as np
import pytest
from PIL import Image, ImageCms

from cvdgs.core.capture.images import read_header, read_pixels
from cvdgs.core.color.profiles import convert_to_srgb

from .test_photographs import delta_e, soft_picture

SRGB, ADOBE = colour.RGB_COLOURSPACES["sRGB"], colour.RGB_COLOURSPACES["Adobe RGB (1998)"]
ADOBE_GAMMA = 2.19921875
LINEAR_NAMES = ("GIMP built-in Linear sRGB", "sRGB-elle-V2-g10.icc")


def to_srgb(light: np.ndarray, space: colour.RGB_Colourspace) -> np.ndarray:
    """(..., 3) linear colours of `space` as sRGB in [0, 1], clipped."""
    matrix = colour.matrix_RGB_to_RGB(space, SRGB, chromatic_adaptation_transform=None)
    return colour.models.eotf_inverse_sRGB(np.clip(light @ matrix.T, 0.0, 1.0))


def adobe_to_srgb(pixels: np.ndarray) -> np.ndarray:
    return to_srgb((pixels / 255.0) ** ADOBE_GAMMA, ADOBE)


def matrix_profile(space: colour.RGB_Colourspace, curve: bytes, name: str) -> bytes:
    """An ICC profile of version 2 with the primaries of `space`, made independently of the package's own."""
    adaptation = colour.adaptation.matrix_chromatic_adaptation_VonKries(
        colour.xy_to_XYZ(space.whitepoint), np.array([0.9642, 1.0, 0.8249]), "Bradford"
    )
    columns = (adaptation @ space.matrix_RGB_to_XYZ).T
    xyz = [b"XYZ \0\0\0\0" + struct.pack(">iii", *(round(v * 65536) for v in column)) for column in columns]
    white = b"XYZ \0\0\0\0" + struct.pack(">iii", 63190, 65536, 54061)
    text = b"text\0\0\0\0test\0\0\0\0"
    called = name.encode() + b"\0"
    description = b"desc\0\0\0\0" + struct.pack(">I", len(called)) + called + bytes(78)
    names = (b"wtpt", b"rXYZ", b"gXYZ", b"bXYZ", b"rTRC", b"gTRC", b"bTRC", b"cprt", b"desc")
    tags = dict(zip(names, (white, *xyz, curve, curve, curve, text, description), strict=True))
    table, data, at = b"", b"", 132 + 12 * len(tags)
    for tag, content in tags.items():
        table += tag + struct.pack(">II", at + len(data), len(content))
        data += content + bytes(-len(content) % 4)
    head = struct.pack(">I", at + len(data)) + bytes(4) + b"\x02\x20\0\0mntrRGB XYZ " + bytes(12) + b"acsp"
    head = (head + bytes(28) + struct.pack(">iii", 63190, 65536, 54061)).ljust(128, b"\0")
    return head + struct.pack(">I", len(tags)) + table + data


def exponent(gamma: float) -> bytes:
    return b"curv\0\0\0\0" + struct.pack(">IH", 1, round(gamma * 256)) + b"\0\0"


def table_of_srgb(steps: int) -> bytes:
    """The curve of sRGB as the profile "sRGB IEC61966-2.1" of Hewlett-Packard has it, with 1,024 steps."""
    values = np.rint(colour.models.eotf_sRGB(np.linspace(0.0, 1.0, steps)) * 65535).astype(int)
    return b"curv\0\0\0\0" + struct.pack(f">I{steps}H", steps, *values.tolist())


def test_a_matrix_profile_of_any_space_is_converted(tmp_path: Path) -> None:
    """Adobe RGB (1998), by an ICC profile that Little CMS never saw before."""
    pixels = soft_picture()
    profile = matrix_profile(ADOBE, exponent(ADOBE_GAMMA), "Adobe")
    Image.fromarray(pixels).save(tmp_path / "x.png", icc_profile=profile)
    assert delta_e(read_pixels(tmp_path / "x.png")[0] / 255.0, adobe_to_srgb(pixels)) < 1.0
    assert not read_header(tmp_path / "x.png").is_foreign


@pytest.mark.parametrize("name", LINEAR_NAMES)
@pytest.mark.parametrize("ending", ["png", "tif", "jpg"])
def test_linear_light_is_encoded_though_its_profile_is_called_srgb(tmp_path: Path, ending: str, name: str) -> None:
    pixels, path = soft_picture(), tmp_path / f"x.{ending}"
    options = {"quality": 100, "subsampling": 0} if ending == "jpg" else {}
    Image.fromarray(pixels).save(path, icc_profile=matrix_profile(SRGB, exponent(1.0), name), **options)
    stored = np.asarray(Image.open(path).convert("RGB"))
    assert delta_e(read_pixels(path)[0] / 255.0, to_srgb(stored / 255.0, SRGB)) < 0.5
    assert not read_header(path).is_foreign


def test_a_linear_profile_that_cannot_be_converted_is_foreign_though_it_is_called_srgb(tmp_path: Path) -> None:
    profile = matrix_profile(SRGB, exponent(1.0), LINEAR_NAMES[0]).replace(b"rXYZ", b"qXYZ")
    Image.fromarray(soft_picture()).save(tmp_path / "x.png", icc_profile=profile)
    assert read_header(tmp_path / "x.png").is_foreign


@pytest.mark.parametrize("name", ["sRGB IEC61966-2.1", "c2"])
def test_colours_of_an_ordinary_srgb_profile_stay_exactly_what_they_are(tmp_path: Path, name: str) -> None:
    levels = np.arange(0, 256, 3, dtype=np.uint8)
    pixels = np.stack(np.meshgrid(levels, levels, levels), axis=-1).reshape(-1, len(levels), 3)
    little_cms = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    for profile in (matrix_profile(SRGB, table_of_srgb(1024), name), little_cms):
        Image.fromarray(pixels).save(tmp_path / "x.png", icc_profile=profile)
        np.testing.assert_array_equal(read_pixels(tmp_path / "x.png")[0], pixels)
        assert convert_to_srgb(pixels.copy(), profile)
