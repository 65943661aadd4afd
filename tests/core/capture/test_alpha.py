"""Alpha channels: colours are straight whether or not the file has them multiplied by alpha."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from PIL import Image

from cvdgs.core.capture.images import read_pixels

from .make_captures import shots

PICTURE = shots(1)[0].render()
HEIGHT, WIDTH = PICTURE.shape[:2]
COVERAGE = np.linspace(0.2, 1.0, HEIGHT * WIDTH, dtype=np.float32).reshape(HEIGHT, WIDTH, 1)
COVERAGE[:8] = 0.0
SEEN = np.s_[8:]
ALPHA = np.rint(COVERAGE[..., 0] * 255).astype(int)


def srgb_to_linear(encoded: np.ndarray) -> np.ndarray:
    """IEC 61966-2-1."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def write(path: Path, color: np.ndarray, kind: object, *, straight: bool, options: dict | None = None) -> Path:
    """(H, W, 3) straight colours in [0, 1] with `COVERAGE`; premultiplied is what OpenImageIO writes unasked."""
    spec = oiio.ImageSpec(WIDTH, HEIGHT, 4, kind)
    for name, value in {"oiio:UnassociatedAlpha": int(straight), **(options or {})}.items():
        spec.attribute(name, value)
    pixels = np.dstack([color if straight else color * COVERAGE, COVERAGE]).astype(np.float32)
    file = oiio.ImageOutput.create(str(path))
    assert file.open(str(path), spec), file.geterror()
    assert file.write_image(pixels), file.geterror()
    assert file.close()
    return path


def check(path: Path, tolerance: float) -> None:
    """Colours to within rounding, which dividing by alpha makes larger."""
    color, alpha = read_pixels(path)
    assert alpha is not None
    assert np.abs(alpha.astype(int) - ALPHA).max() <= 1
    assert np.abs(color.astype(int) - PICTURE)[SEEN].max() <= tolerance


@pytest.mark.parametrize("straight", [True, False])
@pytest.mark.parametrize("kind", [oiio.UINT8, oiio.UINT16])
def test_colours_of_an_integer_tiff_are_straight(tmp_path: Path, kind: object, straight: bool) -> None:
    check(write(tmp_path / "x.tif", PICTURE / 255.0, kind, straight=straight), 1 if straight else 4)


@pytest.mark.parametrize("straight", [True, False])
def test_colours_of_a_floating_point_tiff_are_straight(tmp_path: Path, straight: bool) -> None:
    check(write(tmp_path / "x.tif", srgb_to_linear(PICTURE / 255.0), oiio.FLOAT, straight=straight), 1)


def test_colours_of_another_writers_premultiplied_tiff_are_straight(tmp_path: Path) -> None:
    """Pillow's, of which ExtraSamples is made to say that alpha is associated."""
    held = np.rint(PICTURE * COVERAGE).astype(np.uint8)
    Image.fromarray(np.dstack([held, ALPHA.astype(np.uint8)])).save(tmp_path / "x.tif")
    tiff = bytearray((tmp_path / "x.tif").read_bytes())
    entry = tiff.index(struct.pack("<HHI", 338, 3, 1))
    tiff[entry + 8] = 1
    (tmp_path / "x.tif").write_bytes(tiff)
    check(tmp_path / "x.tif", 4)


@pytest.mark.parametrize("ending", ["png", "tga", "webp"])
def test_formats_of_straight_colours_are_left_as_they_are(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"x.{ending}"
    options = {"lossless": True, "exact": True} if ending == "webp" else {}
    Image.fromarray(np.dstack([PICTURE, ALPHA.astype(np.uint8)])).save(path, **options)
    color, alpha = read_pixels(path)
    np.testing.assert_array_equal(color, PICTURE)
    np.testing.assert_array_equal(alpha, ALPHA)


def test_bitmaps_with_alpha_hold_straight_colours(tmp_path: Path) -> None:
    check(write(tmp_path / "x.bmp", PICTURE / 255.0, oiio.UINT8, straight=True), 0)


def test_colours_of_a_premultiplied_targa_are_straight(tmp_path: Path) -> None:
    write(tmp_path / "x.tga", PICTURE / 255.0 * COVERAGE, oiio.UINT8, straight=True)
    targa = bytearray((tmp_path / "x.tga").read_bytes())
    (extension,) = struct.unpack("<I", targa[-26:-22])
    targa[extension + 494] = 4  # the attributes type: premultiplied
    (tmp_path / "x.tga").write_bytes(targa)
    check(tmp_path / "x.tga", 4)


@pytest.mark.parametrize("kind", [oiio.UINT8, oiio.UINT16, oiio.FLOAT])
def test_colours_that_premultiplication_left_nothing_of_are_black(tmp_path: Path, kind: object) -> None:
    color, alpha = read_pixels(write(tmp_path / "x.tif", PICTURE / 255.0, kind, straight=False))
    assert alpha is not None
    assert not alpha[:8].any()
    assert not color[:8].any()


@pytest.mark.parametrize("ending", ["bmp", "tga"])
def test_a_fourth_byte_that_is_never_set_is_no_alpha(tmp_path: Path, ending: str) -> None:
    blue_to_red = np.dstack([PICTURE[..., ::-1], np.zeros((HEIGHT, WIDTH), np.uint8)])[::-1]  # upwards, as both are
    if ending == "bmp":
        size = blue_to_red.nbytes
        head = b"BM" + struct.pack("<IHHI", 54 + size, 0, 0, 54)
        head += struct.pack("<IiiHHIIiiII", 40, WIDTH, HEIGHT, 1, 32, 0, size, 2835, 2835, 0, 0)
    else:
        head = struct.pack("<BBBHHBHHHHBB", 0, 0, 2, 0, 0, 0, 0, 0, WIDTH, HEIGHT, 32, 0)
    (tmp_path / f"x.{ending}").write_bytes(head + blue_to_red.tobytes())
    color, alpha = read_pixels(tmp_path / f"x.{ending}")
    np.testing.assert_array_equal(color, PICTURE)
    assert alpha is None


def test_a_transparent_png_stays_transparent(tmp_path: Path) -> None:
    Image.fromarray(np.dstack([PICTURE, np.zeros((HEIGHT, WIDTH), np.uint8)])).save(tmp_path / "x.png")
    alpha = read_pixels(tmp_path / "x.png")[1]
    assert alpha is not None
    assert not alpha.any()
