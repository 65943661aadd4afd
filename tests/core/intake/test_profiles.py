"""Photographs of other colour spaces than sRGB have the colours that colour-science gives them."""

from __future__ import annotations

import struct
from pathlib import Path

import colour
import numpy as np
import pillow_heif
import pytest
from PIL import Image, ImageCms

from cvdgs.core.capture.images import read_header, read_pixels
from cvdgs.core.capture.material import find_material, make_photographs
from cvdgs.core.capture.reader import inspect_capture
from cvdgs.core.color.profiles import ADOBE_RGB, DISPLAY_P3, convert_to_srgb
from cvdgs.core.runtime.protocol import Reporter

from ..capture.make_captures import save as save_any
from ..capture.make_captures import shots, write_transforms
from .test_photographs import delta_e, p3_to_srgb, soft_picture

SRGB, ADOBE = colour.RGB_COLOURSPACES["sRGB"], colour.RGB_COLOURSPACES["Adobe RGB (1998)"]
ADOBE_GAMMA = 2.19921875
# Of "sRGB IEC61966-2.1" by Hewlett-Packard, which most programs embed; converted, a few colours move by a step.
COMMON_COLUMNS = np.array([[0.43607, 0.22249, 0.01392], [0.38515, 0.71687, 0.09708], [0.14307, 0.06061, 0.71410]])
LINEAR_NAMES = ("GIMP built-in Linear sRGB", "sRGB-elle-V2-g10.icc")


def to_srgb(light: np.ndarray, space: colour.RGB_Colourspace) -> np.ndarray:
    """(..., 3) linear colours of `space` as sRGB in [0, 1], clipped."""
    matrix = colour.matrix_RGB_to_RGB(space, SRGB, chromatic_adaptation_transform=None)
    return colour.models.eotf_inverse_sRGB(np.clip(light @ matrix.T, 0.0, 1.0))


def adobe_to_srgb(pixels: np.ndarray) -> np.ndarray:
    return to_srgb((pixels / 255.0) ** ADOBE_GAMMA, ADOBE)


def columns_of(space: colour.RGB_Colourspace) -> np.ndarray:
    """(3, 3) XYZ of red, green and blue, adapted to D50."""
    adaptation = colour.adaptation.matrix_chromatic_adaptation_VonKries(
        colour.xy_to_XYZ(space.whitepoint), np.array([0.9642, 1.0, 0.8249]), "Bradford"
    )
    return (adaptation @ space.matrix_RGB_to_XYZ).T


def matrix_profile(columns: np.ndarray, curve: bytes, name: str) -> bytes:
    """An ICC profile of version 2, made independently of the package's own."""
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
    """The curve of sRGB as a table; that of Hewlett-Packard's profile has 1,024 steps."""
    values = np.rint(colour.models.eotf_sRGB(np.linspace(0.0, 1.0, steps)) * 65535).astype(int)
    return b"curv\0\0\0\0" + struct.pack(f">I{steps}H", steps, *values.tolist())


def test_a_matrix_profile_of_any_space_is_converted(tmp_path: Path) -> None:
    """Adobe RGB (1998), by an ICC profile that Little CMS never saw before."""
    pixels = soft_picture()
    profile = matrix_profile(columns_of(ADOBE), exponent(ADOBE_GAMMA), "Adobe")
    Image.fromarray(pixels).save(tmp_path / "x.png", icc_profile=profile)
    assert delta_e(read_pixels(tmp_path / "x.png")[0] / 255.0, adobe_to_srgb(pixels)) < 1.0
    assert not read_header(tmp_path / "x.png").is_foreign


@pytest.mark.parametrize("name", LINEAR_NAMES)
@pytest.mark.parametrize("ending", ["png", "tif", "jpg"])
def test_linear_light_is_encoded_though_its_profile_is_called_srgb(tmp_path: Path, ending: str, name: str) -> None:
    pixels, path = soft_picture(), tmp_path / f"x.{ending}"
    options = {"quality": 100, "subsampling": 0} if ending == "jpg" else {}
    Image.fromarray(pixels).save(path, icc_profile=matrix_profile(columns_of(SRGB), exponent(1.0), name), **options)
    stored = np.asarray(Image.open(path).convert("RGB"))
    assert delta_e(read_pixels(path)[0] / 255.0, to_srgb(stored / 255.0, SRGB)) < 0.5
    assert not read_header(path).is_foreign


def test_a_linear_profile_that_cannot_be_converted_is_foreign_though_it_is_called_srgb(tmp_path: Path) -> None:
    profile = matrix_profile(columns_of(SRGB), exponent(1.0), LINEAR_NAMES[0]).replace(b"rXYZ", b"qXYZ")
    Image.fromarray(soft_picture()).save(tmp_path / "x.png", icc_profile=profile)
    assert read_header(tmp_path / "x.png").is_foreign


@pytest.mark.parametrize("name", ["sRGB IEC61966-2.1", "c2"])
def test_colours_of_an_ordinary_srgb_profile_stay_exactly_what_they_are(tmp_path: Path, name: str) -> None:
    levels = np.linspace(0, 255, 33).round().astype(np.uint8)
    pixels = np.stack(np.meshgrid(levels, levels, levels), axis=-1).reshape(-1, len(levels), 3)
    little_cms = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    for profile in (matrix_profile(COMMON_COLUMNS, table_of_srgb(1024), name), little_cms):
        Image.fromarray(pixels).save(tmp_path / "x.png", icc_profile=profile)
        np.testing.assert_array_equal(read_pixels(tmp_path / "x.png")[0], pixels)
        assert convert_to_srgb(pixels.copy(), profile)


# --- colour spaces without a profile


def exif(space: int, index: str = "") -> Image.Exif:
    """EXIF data with ColorSpace, and InteroperabilityIndex where one is given."""
    tags = Image.Exif()
    tags[0x010F] = "Make"
    tags.get_ifd(0x8769)[0xA001] = space
    if index:
        tags.get_ifd(0x8769)[0xA005] = {1: index}
    return tags


def save(path: Path, tags: Image.Exif, **options: object) -> np.ndarray:
    """A photograph with these EXIF data; returns what is stored."""
    options |= {"quality": 100, "subsampling": 0} if path.suffix == ".jpg" else {}
    Image.fromarray(soft_picture()).save(path, exif=tags, **options)
    return np.asarray(Image.open(path).convert("RGB"))


@pytest.mark.parametrize("ending", ["jpg", "png"])
def test_adobe_rgb_that_exif_data_alone_tell_of_is_converted(tmp_path: Path, ending: str) -> None:
    stored = save(tmp_path / f"x.{ending}", exif(65535, "R03"))
    color, _ = read_pixels(tmp_path / f"x.{ending}")
    assert delta_e(color / 255.0, adobe_to_srgb(stored)) < 0.5
    assert delta_e(stored / 255.0, adobe_to_srgb(stored)) > 1.5
    assert not read_header(tmp_path / f"x.{ending}").is_foreign


def test_the_profile_of_adobe_rgb_agrees_with_the_specification() -> None:
    pixels = np.random.default_rng(0).integers(0, 256, (64, 64, 3)).astype(np.uint8)
    color = pixels.copy()
    assert convert_to_srgb(color, ADOBE_RGB)
    assert np.abs(color / 255.0 - adobe_to_srgb(pixels)).mean() < 0.5 / 255.0


def test_a_profile_counts_for_more_than_exif_data(tmp_path: Path) -> None:
    stored = save(tmp_path / "x.jpg", exif(65535, "R03"), icc_profile=DISPLAY_P3)
    assert delta_e(read_pixels(tmp_path / "x.jpg")[0] / 255.0, p3_to_srgb(stored)) < 0.5


@pytest.mark.parametrize("tags", [exif(1), exif(1, "R98"), Image.Exif()])
def test_photographs_whose_exif_data_say_srgb_stay_what_they_are(tmp_path: Path, tags: Image.Exif) -> None:
    stored = save(tmp_path / "x.png", tags)
    np.testing.assert_array_equal(read_pixels(tmp_path / "x.png")[0], stored)
    assert not read_header(tmp_path / "x.png").is_foreign


@pytest.mark.parametrize("tags", [exif(65535), exif(65535, "R98")])
def test_colours_that_exif_data_call_uncalibrated_are_warned_of(tmp_path: Path, tags: Image.Exif) -> None:
    photographs = shots(2)
    root = write_transforms(tmp_path, photographs)
    Image.fromarray(photographs[0].render()).save(root / "images" / photographs[0].name, exif=tags)
    np.testing.assert_array_equal(read_pixels(root / "images" / photographs[0].name)[0], photographs[0].render())
    (message,) = [w.message for w in inspect_capture(root).warnings if w.name == "color-profile"]
    assert "1 photographs are not sRGB but uncalibrated (EXIF)" in message


def test_a_tiff_that_is_called_uncalibrated_is_foreign_unless_its_light_is_linear(tmp_path: Path) -> None:
    attributes = {"Exif:ColorSpace": 65535}
    assert read_header(save_any(tmp_path / "x.tif", soft_picture(), **attributes)).is_foreign
    assert not read_header(save_any(tmp_path / "x.exr", soft_picture() / np.float32(255), **attributes)).is_foreign


def test_exif_data_that_are_damaged_tell_of_no_adobe_rgb(tmp_path: Path) -> None:
    stored = save(tmp_path / "x.jpg", exif(65535, "R03"))
    data = (tmp_path / "x.jpg").read_bytes()
    table = data.index(b"R03\0") - 10  # its own: a count of entries, and tag, type and count of the first
    (tmp_path / "x.jpg").write_bytes(data[:table] + b"\xff\xff\xff\xff" + data[table + 4 :])
    assert np.abs(read_pixels(tmp_path / "x.jpg")[0].astype(int) - stored).max() <= 2
    assert read_header(tmp_path / "x.jpg").is_foreign


def test_display_p3_that_an_avif_states_by_a_number_is_converted(tmp_path: Path) -> None:
    plain = tmp_path / "plain.avif"
    Image.fromarray(soft_picture()).save(plain, quality=100, subsampling="4:4:4")
    stored, data = read_pixels(plain)[0], plain.read_bytes()
    place = data.index(b"colrnclx") + 8
    (tmp_path / "p3.avif").write_bytes(data[:place] + (12).to_bytes(2, "big") + data[place + 2 :])
    assert delta_e(read_pixels(tmp_path / "p3.avif")[0] / 255.0, p3_to_srgb(stored)) < 0.5


def test_a_heic_of_adobe_rgb_is_converted_once(tmp_path: Path) -> None:
    """It becomes a JPEG of sRGB, whose EXIF data say so."""
    (tmp_path / "in").mkdir()
    (tmp_path / "out").mkdir()
    pixels = soft_picture()
    file = pillow_heif.from_pillow(Image.fromarray(pixels))
    file.info["exif"] = exif(65535, "R03").tobytes()
    file.save(tmp_path / "in" / "1.heic", quality=-1, chroma=444, save_nclx_profile=False)
    made = make_photographs(find_material(tmp_path / "in"), tmp_path / "out", Reporter())
    (name,) = made.names
    assert delta_e(read_pixels(made.folder / name)[0] / 255.0, adobe_to_srgb(pixels)) < 1.0
    assert not read_header(made.folder / name).is_foreign
