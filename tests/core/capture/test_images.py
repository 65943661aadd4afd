"""Photographs: formats, bit depths, transparency, orientation, sizes and damage."""

from __future__ import annotations

import errno
import io
import os
import subprocess
import sys
import zlib
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageCms, ImageOps

from cvdgs.core.capture import channels
from cvdgs.core.capture.images import MAX_SIDE, read_header, read_pixels
from cvdgs.core.capture.reader import inspect_capture, read_capture
from cvdgs.core.capture.scaling import downscale_with_alpha, fit_size
from cvdgs.core.capture.views import find_again
from cvdgs.core.color.profiles import DISPLAY_P3
from cvdgs.core.errors import InputError
from cvdgs.core.files.images import write_jpeg, write_png

from .make_captures import (
    frames,
    intrinsics,
    pinhole,
    save,
    shots,
    write_colmap,
    write_transforms,
)

PICTURE = shots(1)[0].render()


def srgb_to_linear(encoded: np.ndarray) -> np.ndarray:
    """IEC 61966-2-1."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


@pytest.mark.parametrize("extension", ["png", "tif", "bmp", "tga"])
def test_lossless_formats_come_back_exactly(tmp_path: Path, extension: str) -> None:
    image, alpha = read_pixels(save(tmp_path / f"x.{extension}", PICTURE))
    np.testing.assert_array_equal(image, PICTURE)
    assert alpha is None


@pytest.mark.parametrize("extension", ["jpg", "webp"])
def test_lossy_formats_agree_with_an_independent_decoder(tmp_path: Path, extension: str) -> None:
    path = save(tmp_path / f"x.{extension}", PICTURE)
    reference = np.asarray(Image.open(path).convert("RGB")).astype(int)
    assert np.abs(read_pixels(path)[0] - reference).max() <= 2


@pytest.mark.parametrize("extension", ["png", "tif"])
def test_sixteen_bits_are_rounded_to_eight(tmp_path: Path, extension: str) -> None:
    noise = np.random.default_rng(0).integers(-128, 128, PICTURE.shape)
    wide = np.clip(PICTURE.astype(int) * 257 + noise, 0, 65535).astype(np.uint16)
    image, _ = read_pixels(save(tmp_path / f"x.{extension}", wide))
    assert np.abs(image.astype(int) - np.rint(wide / 257.0)).max() <= 1


def test_exr_is_encoded_from_linear_and_clipped(tmp_path: Path) -> None:
    linear = srgb_to_linear(PICTURE / 255.0).astype(np.float32)
    linear[0, 0] = (7.0, -1.0, np.nan)
    image, alpha = read_pixels(save(tmp_path / "x.exr", linear))
    np.testing.assert_array_equal(image[0, 0], [255, 0, 0])
    assert np.abs(image.astype(int) - PICTURE)[1:].max() <= 1
    assert alpha is None


def test_premultiplied_alpha_of_exr_becomes_straight(tmp_path: Path) -> None:
    coverage = np.full((72, 96, 1), 0.5, np.float32)
    coverage[:, :10] = 0.0
    linear = srgb_to_linear(PICTURE / 255.0).astype(np.float32) * coverage
    image, alpha = read_pixels(save(tmp_path / "x.exr", np.dstack([linear, coverage])))
    assert alpha is not None
    assert set(np.unique(alpha[:, 10:])) == {128}
    assert (alpha[:, :10] == 0).all()
    assert np.abs(image.astype(int) - PICTURE)[:, 10:].max() <= 1


def test_floating_point_pixels_do_not_depend_on_the_bands_in_which_they_are_encoded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(0)
    path = save(tmp_path / "x.exr", rng.uniform(-0.1, 1.1, (72, 96, 4)).astype(np.float32))
    whole = read_pixels(path)
    monkeypatch.setattr(channels, "_BAND_PIXELS", 5 * 96 + 1)
    for pixels, in_bands in zip(whole, read_pixels(path), strict=True):
        np.testing.assert_array_equal(in_bands, pixels)


@pytest.mark.parametrize("extension", ["png", "tif"])
def test_straight_alpha_is_kept(tmp_path: Path, extension: str) -> None:
    alpha = np.random.default_rng(0).integers(0, 256, (72, 96, 1)).astype(np.uint8)
    image, read = read_pixels(save(tmp_path / f"x.{extension}", np.dstack([PICTURE, alpha])))
    np.testing.assert_array_equal(image, PICTURE)
    np.testing.assert_array_equal(read, alpha[..., 0])


def test_opaque_alpha_is_none(tmp_path: Path) -> None:
    opaque = np.dstack([PICTURE, np.full((72, 96, 1), 255, np.uint8)])
    assert read_pixels(save(tmp_path / "x.png", opaque))[1] is None


@pytest.mark.parametrize("channels", [1, 2])
def test_grey_becomes_rgb(tmp_path: Path, channels: int) -> None:
    grey = np.ascontiguousarray(PICTURE[..., :channels])
    path = tmp_path / "x.png"
    Image.fromarray(grey if channels == 2 else grey[..., 0], "LA" if channels == 2 else "L").save(path)
    image, alpha = read_pixels(path)
    np.testing.assert_array_equal(image, np.repeat(grey[..., :1], 3, axis=2))
    assert (alpha is None) == (channels == 1)


def test_palette_becomes_rgb(tmp_path: Path) -> None:
    picture = Image.fromarray(PICTURE).quantize(64)
    picture.save(tmp_path / "x.png")
    np.testing.assert_array_equal(read_pixels(tmp_path / "x.png")[0], np.asarray(picture.convert("RGB")))


@pytest.mark.parametrize("extension", ["jpg", "tif"])
def test_cmyk_is_refused(tmp_path: Path, extension: str) -> None:
    Image.fromarray(PICTURE).convert("CMYK").save(tmp_path / f"x.{extension}")
    with pytest.raises(InputError, match=r"CMYK.*convert it to RGB"):
        read_header(tmp_path / f"x.{extension}")


def test_cmyk_as_photoshop_writes_it_is_refused(tmp_path: Path) -> None:
    """As YCCK, which the byte for the transform in Adobe's marker says (Adobe Technical Note 5116, section 18)."""
    stream = io.BytesIO()
    Image.fromarray(PICTURE).convert("CMYK").save(stream, "JPEG")
    data = bytearray(stream.getvalue())
    data[data.index(b"Adobe") + 11] = 2
    (tmp_path / "x.jpg").write_bytes(data)
    with pytest.raises(InputError, match=r"CMYK.*convert it to RGB"):
        read_header(tmp_path / "x.jpg")


def test_lab_is_refused(tmp_path: Path) -> None:
    picture = Image.fromarray(PICTURE).convert("LAB")
    picture.info.pop("icc_profile", None)
    picture.save(tmp_path / "x.tif")
    with pytest.raises(InputError, match=r"Lab.*convert it to RGB"):
        read_pixels(tmp_path / "x.tif")


@pytest.mark.parametrize("extension", ["tif", "webp"])
def test_the_first_of_several_pages_is_used_and_that_is_said(tmp_path: Path, extension: str) -> None:
    pages = [Image.fromarray(PICTURE), Image.fromarray(PICTURE[::-1])]
    for number, others in enumerate([[], [pages[1]], [pages[1].resize((8, 6))]]):
        if extension == "tif" or number < 2:
            pages[0].save(tmp_path / f"{number}.{extension}", save_all=True, append_images=others, lossless=True)
    headers = [read_header(path) for path in sorted(tmp_path.iterdir())]
    assert [header.has_pages for header in headers] == [False, True, False][: len(headers)]
    np.testing.assert_array_equal(read_pixels(tmp_path / f"1.{extension}")[0], PICTURE)


def test_photographs_with_several_pages_are_named_in_a_warning(tmp_path: Path) -> None:
    photographs = shots(2)
    for shot in photographs:
        shot.name = f"{Path(shot.name).stem}.tif"
    root = write_transforms(tmp_path, photographs)
    first, second = (Image.fromarray(shot.render()) for shot in photographs)
    first.save(root / "images" / photographs[0].name, save_all=True, append_images=[second])
    (message,) = [w.message for w in inspect_capture(root).warnings if w.name == "several-pages"]
    assert "1 photographs have several pages" in message


def test_other_colour_spaces_are_named_in_a_warning(tmp_path: Path) -> None:
    photographs = shots(2)
    root = write_transforms(tmp_path, photographs)
    standard = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    unusable = standard.replace("sRGB".encode("utf-16-be"), "P3xx".encode("utf-16-be")).replace(b"rXYZ", b"qXYZ")
    for shot, profile in zip(photographs, [unusable, standard], strict=True):
        Image.fromarray(shot.render()).save(root / "images" / shot.name, icc_profile=profile)
    (message,) = [w.message for w in inspect_capture(root).warnings if w.name == "color-profile"]
    assert "1 photographs" in message
    assert "P3xx" in message


def test_display_p3_of_telephones_becomes_srgb(tmp_path: Path) -> None:
    Image.fromarray(PICTURE).save(tmp_path / "x.png", icc_profile=DISPLAY_P3)
    # From the primaries of SMPTE EG 432-1 and BT.709, both with the white point D65.
    to_srgb = [[1.224940, -0.224940, 0.0], [-0.042057, 1.042057, 0.0], [-0.019638, -0.078636, 1.098274]]
    light = srgb_to_linear(PICTURE / 255.0) @ np.array(to_srgb).T
    color, _ = read_pixels(tmp_path / "x.png")
    inside = ((light >= 0.0) & (light <= 1.0)).all(axis=2)
    assert inside.mean() > 0.5
    assert np.abs(srgb_to_linear((color / 255.0)[inside]) - light[inside]).max() < 1.5 / 255 * 2.4  # a step, at most
    assert np.abs(color - PICTURE.astype(float)).max() > 5.0
    assert not read_header(tmp_path / "x.png").is_foreign


def test_a_studios_colour_configuration_changes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = save(tmp_path / "x.exr", np.full((20, 20, 3), 0.18, np.float32))
    script = "import sys; from pathlib import Path; from cvdgs.core.capture.images import read_pixels; "
    script += "print(read_pixels(Path(sys.argv[1]))[0][0, 0, 0])"
    monkeypatch.setenv("OCIO", str(tmp_path / "gone" / "config.ocio"))  # is read once, when OpenImageIO is loaded
    result = subprocess.run([sys.executable, "-c", script, path], capture_output=True, text=True, timeout=60)
    assert result.stdout.strip() == "118"


@pytest.mark.parametrize("write", [write_png, partial(write_jpeg, quality=90)])
def test_full_disk_is_an_os_error(write: Callable[[Path, np.ndarray], None]) -> None:
    full = Path("/dev/full")
    if not full.exists():
        pytest.skip("needs a device that is always full")
    with pytest.raises(OSError, match=os.strerror(errno.ENOSPC)):
        write(full, PICTURE)


# --- orientation


@pytest.mark.parametrize("orientation", range(1, 9))
def test_orientation_agrees_with_an_independent_reader(tmp_path: Path, orientation: int) -> None:
    path = save(tmp_path / "x.jpg", PICTURE, Orientation=orientation)
    picture = Image.open(path)
    assert picture.getexif().get(0x0112) == orientation
    reference = np.asarray(ImageOps.exif_transpose(picture)).astype(int)
    image, _ = read_pixels(path, upright=True)
    assert image.shape == reference.shape
    assert read_header(path).upright_size == (image.shape[1], image.shape[0])
    assert np.abs(image - reference).max() <= 2


@pytest.mark.parametrize("orientation", [1, 3, 5, 6, 8])
def test_orientation_of_a_webp_agrees_with_an_independent_reader(tmp_path: Path, orientation: int) -> None:
    tags = Image.Exif()
    tags[0x0112] = orientation
    Image.fromarray(PICTURE).save(tmp_path / "x.webp", lossless=True, exif=tags)
    reference = np.asarray(ImageOps.exif_transpose(Image.open(tmp_path / "x.webp")))
    np.testing.assert_array_equal(read_pixels(tmp_path / "x.webp", upright=True)[0], reference)
    np.testing.assert_array_equal(read_pixels(tmp_path / "x.webp")[0], PICTURE)
    assert read_header(tmp_path / "x.webp").upright_size == (reference.shape[1], reference.shape[0])


@pytest.mark.parametrize("exif", [b"Exif\0\0II+\0\x08\0\0\0", b"nothing", b""])
def test_a_webp_whose_exif_data_are_damaged_is_used_without_them(tmp_path: Path, exif: bytes) -> None:
    Image.fromarray(PICTURE).save(tmp_path / "x.webp", lossless=True, exif=exif)
    assert (read_header(tmp_path / "x.webp").orientation, read_header(tmp_path / "x.webp").taken_with) == (1, "")
    np.testing.assert_array_equal(read_pixels(tmp_path / "x.webp", upright=True)[0], PICTURE)


def test_camera_of_the_turned_size_turns_the_photograph(tmp_path: Path) -> None:
    photographs = shots(2, pinhole(72, 96))
    root = write_colmap(tmp_path, photographs, images=False)
    for shot in photographs:
        shot.name = shot.name.replace(".png", ".jpg")
    root = write_colmap(tmp_path, photographs, images=False)
    # Stored lying on its side, as a phone does: orientation 6 means "turn clockwise to see it upright".
    for shot in photographs:
        save(root / "images" / shot.name, np.ascontiguousarray(np.rot90(shot.render())), Orientation=6)
    capture = read_capture(root, max_size=None)
    assert np.abs(capture.views[0].image.astype(int) - photographs[0].render()).mean() < 2.0
    assert "exif-rotated" in [warning.name for warning in capture.warnings]


def test_camera_of_the_stored_size_leaves_the_photograph(tmp_path: Path) -> None:
    photographs = shots(2, pattern="{}.jpg")
    root = write_colmap(tmp_path, photographs, images=False)
    for shot in photographs:
        save(root / "images" / shot.name, shot.render(), Orientation=6)
    capture = read_capture(root, max_size=None)
    assert np.abs(capture.views[0].image.astype(int) - photographs[0].render()).mean() < 2.0
    assert "exif-rotated" not in [warning.name for warning in capture.warnings]


def test_without_a_stated_size_the_orientation_is_applied(tmp_path: Path) -> None:
    photographs = shots(2, pinhole(72, 96), pattern="{}.jpg")
    write_transforms(tmp_path, photographs, {"fl_x": 80.0, "frames": frames(photographs)}, images=False)
    for shot in photographs:
        save(tmp_path / "images" / shot.name, np.ascontiguousarray(np.rot90(shot.render())), Orientation=6)
    view = read_capture(tmp_path, max_size=None).views[0]
    assert (view.camera.width, view.camera.height, view.camera.cx) == (72, 96, 36.0)
    assert np.abs(view.image.astype(int) - photographs[0].render()).mean() < 2.0


# --- sizes


@pytest.mark.parametrize(
    ("size", "limit", "expected"),
    [
        ((720, 1280), 480, (270, 480)),
        ((96, 72), 96, (96, 72)),
        ((96, 72), 400, (96, 72)),
        ((96, 72), None, (96, 72)),
        ((1001, 333), 500, (500, 166)),
    ],
)
def test_longer_side_is_limited_and_never_enlarged(
    size: tuple[int, int], limit: int | None, expected: tuple[int, int]
) -> None:
    assert fit_size(*size, limit) == expected


def test_scaled_camera_sees_the_scaled_photograph(tmp_path: Path) -> None:
    capture = read_capture(write_colmap(tmp_path, shots(2, pinhole(192, 144, 160.0))), max_size=50)
    camera = capture.views[0].camera
    assert (camera.width, camera.height) == (50, 38)
    assert camera.fx == pytest.approx(160.0 * 50 / 192)
    assert camera.fy == pytest.approx(160.0 * 38 / 144)
    assert (camera.cx, camera.cy) == (25.0, 19.0)


def test_a_line_of_motion_blur_shrinks_with_its_photograph(tmp_path: Path) -> None:
    listed = [frame | {"motion_blur": [6.0, -3.0]} for frame in frames(shots(2))]
    root = write_transforms(tmp_path, shots(2), {"fl_x": 80.0, "frames": listed})
    full, half = (read_capture(root, max_size=size).views[0] for size in (None, 48))
    np.testing.assert_array_equal(full.smear, [6.0, -3.0])
    np.testing.assert_array_equal(half.smear, [3.0, -1.5])


def test_downscaling_keeps_the_mean(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (480, 640, 3)).astype(np.uint8)
    small, _ = downscale_with_alpha(noise, None, 64, 48)
    assert small.mean() == pytest.approx(noise.mean(), abs=0.3)
    assert small.std() < 20.0  # 73 before: a filter that skips pixels would keep it


def test_uncovered_colours_do_not_bleed_into_covered_ones() -> None:
    image = np.zeros((64, 64, 3), np.uint8)
    image[:, 32:] = 200
    alpha = np.zeros((64, 64), np.uint8)
    alpha[:, 33:] = 255
    small, coverage = downscale_with_alpha(image, alpha, 16, 16)
    assert coverage is not None
    assert (small[coverage > 0] == 200).all()
    assert (coverage[:, :7] == 0).all()
    assert (coverage[:, 10:] == 255).all()


@pytest.mark.parametrize("size", [(1, 1), (500, 8)])
def test_tiny_image_is_refused(tmp_path: Path, size: tuple[int, int]) -> None:
    root = write_transforms(tmp_path, shots(2), {"fl_x": 80.0, "frames": frames(shots(2))})
    save(root / "images" / "0002.png", np.zeros((size[1], size[0], 3), np.uint8))
    with pytest.raises(InputError, match=r"0002.png: the image is .* too small"):
        inspect_capture(root)


def test_image_that_would_be_tiny_is_refused(tmp_path: Path) -> None:
    root = write_colmap(tmp_path, shots(2, pinhole(400, 40)))
    with pytest.raises(InputError, match="larger --max-size"):
        read_capture(root, max_size=100)


@pytest.mark.parametrize("size", [(20_000, 20_000), (20_000, 32), (2**31 - 1, 2**31 - 1)])
def test_giant_header_is_refused_before_any_pixel_is_read(tmp_path: Path, size: tuple[int, int]) -> None:
    root = write_transforms(tmp_path, shots(2), {"fl_x": 80.0, "frames": frames(shots(2))})
    header = b"IHDR" + size[0].to_bytes(4, "big") + size[1].to_bytes(4, "big") + b"\x08\x02\x00\x00\x00"
    data = zlib.compress(b"\0")
    chunks = [(13, header), (len(data), b"IDAT" + data), (0, b"IEND")]
    png = b"\x89PNG\r\n\x1a\n"
    for length, chunk in chunks:
        png += length.to_bytes(4, "big") + chunk + zlib.crc32(chunk).to_bytes(4, "big")
    (root / "images" / "0002.png").write_bytes(png)
    with pytest.raises(InputError, match=rf"0002.png.*({MAX_SIDE}|cannot be opened)"):
        inspect_capture(root)


def test_image_that_does_not_fit_its_camera_is_refused(tmp_path: Path) -> None:
    root = write_colmap(tmp_path, shots(2))
    save(root / "images" / "0002.png", np.zeros((72, 72, 3), np.uint8))
    with pytest.raises(InputError, match=r"0002.png: the image is 72 x 72 pixels but its camera is for 96 x 72"):
        inspect_capture(root)


# --- damage


@pytest.mark.parametrize("extension", ["jpg", "png", "tif", "webp", "exr", "bmp"])
@pytest.mark.parametrize("part", [0.0, 0.02, 0.5, 0.95])
def test_cut_image_is_refused(tmp_path: Path, extension: str, part: float) -> None:
    picture = PICTURE if extension != "exr" else (PICTURE / 255.0).astype(np.float32)
    path = save(tmp_path / f"x.{extension}", picture)
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * part)])
    with pytest.raises(InputError, match=r"damaged or cut short|cannot be opened"):
        read_pixels(path)


@pytest.mark.parametrize("part", [0.3, 0.6, 0.9, 0.99])
def test_cut_progressive_jpeg_is_refused(tmp_path: Path, part: float) -> None:
    stream = io.BytesIO()
    Image.fromarray(PICTURE).save(stream, "JPEG", progressive=True, quality=95)
    path = tmp_path / "x.jpg"
    path.write_bytes(stream.getvalue()[: int(len(stream.getvalue()) * part)])
    with pytest.raises(InputError, match=r"damaged or cut short|cannot be opened"):
        read_pixels(path)


def jpeg(**options: object) -> bytes:
    stream = io.BytesIO()
    Image.fromarray(PICTURE).save(stream, "JPEG", quality=95, **options)
    return stream.getvalue()


def with_wrong_scan(data: bytes) -> bytes:
    """A JPEG with a scan's parameters as Samsung's phones write them: 0, 0, 0 instead of 0, 63, 0."""
    start = data.index(b"\xff\xda")
    end = start + 2 + int.from_bytes(data[start + 2 : start + 4], "big")
    return data[: end - 3] + bytes(3) + data[end:]


def with_wrong_revision(data: bytes) -> bytes:
    version = data.index(b"JFIF\0") + 5
    return data[:version] + b"\2" + data[version + 1 :]


def with_stray_bytes(data: bytes) -> bytes:
    table = data.index(b"\xff\xdb")
    return data[:table] + bytes(3) + data[table:]


HEADERS = pytest.mark.parametrize("change", [with_wrong_scan, with_wrong_revision, with_stray_bytes])


@HEADERS
def test_a_jpeg_with_a_wrong_header_is_read_where_all_its_pixels_are_there(
    tmp_path: Path, change: Callable[[bytes], bytes]
) -> None:
    (tmp_path / "right.jpg").write_bytes(jpeg())
    (tmp_path / "wrong.jpg").write_bytes(change(jpeg()))
    np.testing.assert_array_equal(read_pixels(tmp_path / "wrong.jpg")[0], read_pixels(tmp_path / "right.jpg")[0])


@HEADERS
@pytest.mark.parametrize("part", [0.5, 0.9, 0.99])
def test_a_jpeg_with_a_wrong_header_that_is_cut_is_refused(
    tmp_path: Path, change: Callable[[bytes], bytes], part: float
) -> None:
    data = change(jpeg())
    (tmp_path / "x.jpg").write_bytes(data[: int(len(data) * part)])
    with pytest.raises(InputError, match="damaged or cut short"):
        read_pixels(tmp_path / "x.jpg")


@pytest.mark.parametrize("options", [{"progressive": True}, {"restart_marker_rows": 1}])
def test_a_jpeg_with_stray_bytes_among_its_pixels_is_refused(tmp_path: Path, options: dict[str, object]) -> None:
    data = jpeg(**options)
    marker = data.rindex(b"\xff\xda" if "progressive" in options else b"\xff\xd1")
    (tmp_path / "x.jpg").write_bytes(data[:marker] + bytes(3) + data[marker:])
    with pytest.raises(InputError, match="damaged or cut short"):
        read_pixels(tmp_path / "x.jpg")


def test_text_named_as_an_image_is_refused(tmp_path: Path) -> None:
    (tmp_path / "x.jpg").write_text("not an image " * 50)
    with pytest.raises(InputError, match="cannot be opened"):
        read_header(tmp_path / "x.jpg")


def test_damaged_photograph_stops_the_capture_with_its_name(tmp_path: Path) -> None:
    photographs = shots(4, pattern="{}.jpg")
    document = {**intrinsics(pinhole()), "frames": frames(photographs)}
    root = write_transforms(tmp_path, photographs, document)
    path = root / "images" / "3.jpg"
    path.write_bytes(path.read_bytes()[:-200])
    assert inspect_capture(root).views == 4
    with pytest.raises(InputError, match=r"3.jpg: the image is damaged"):
        read_capture(root, max_size=None)


def test_a_second_photograph_comes_with_its_view_at_the_same_size(tmp_path: Path) -> None:
    photographs = shots(3)
    capture = write_transforms(tmp_path / "capture", photographs)
    noisy = np.clip(photographs[1].render().astype(int) + 3, 0, 255).astype(np.uint8)
    save(capture / "images_again" / photographs[1].name, noisy)
    save(capture / "images_again" / photographs[2].name, noisy[:40, :40])  # not from the same place
    first, second, third = read_capture(capture, max_size=64).views
    assert first.again is None
    assert third.again is None
    assert second.again.shape == second.image.shape
    assert np.abs(second.again.astype(int) - second.image - 3).mean() < 1.0


def test_second_photographs_lie_beside_the_folder_images_and_inside_the_capture(tmp_path: Path) -> None:
    names = ("images/1.png", "images/cam1/1.png", "images/cam2/1.png")
    for name in (*names, "images_again/1.png", "images/images_again/1.png"):
        save(tmp_path / name, PICTURE)
    photographs = {name: tmp_path / name for name in names}
    assert find_again(tmp_path, photographs) == {"images/1.png": tmp_path / "images_again" / "1.png"}
    assert find_again(tmp_path / "images", photographs) == {}


def test_a_link_to_a_second_photograph_outside_of_the_capture_is_refused(tmp_path: Path) -> None:
    photographs = shots(2)
    capture = write_transforms(tmp_path / "capture", photographs)
    save(tmp_path / "elsewhere" / photographs[0].name, photographs[0].render())
    (capture / "images_again").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(InputError, match="leads out of the capture folder"):
        read_capture(capture, max_size=64)
