"""HEIC, AVIF and raw photographs have the colours that a reference conversion gives."""

from __future__ import annotations

import io
import shutil
from pathlib import Path

import colour
import numpy as np
import pillow_heif
import pytest
import torch
from PIL import Image, ImageOps
from PIL.TiffImagePlugin import IFDRational
from scipy.ndimage import gaussian_filter

from cvdgs.core.capture.images import read_header, read_pixels
from cvdgs.core.capture.material import find_material, make_photographs
from cvdgs.core.capture.reader import inspect_capture
from cvdgs.core.color.hdr import tone_map
from cvdgs.core.color.profiles import DISPLAY_P3
from cvdgs.core.errors import InputError
from cvdgs.core.intake.exif import taken_with
from cvdgs.core.intake.heif import read_heif_header
from cvdgs.core.intake.raw import Development
from cvdgs.core.photographs.find import find_photographs
from cvdgs.core.runtime.protocol import Reporter

from .dng import RATIONAL, write_dng

DATA = Path(__file__).parents[4] / "shared" / "data" / "heic"
RNG = np.random.default_rng(1)
P3_TO_SRGB = colour.matrix_RGB_to_RGB(
    colour.RGB_COLOURSPACES["Display P3"], colour.RGB_COLOURSPACES["sRGB"], chromatic_adaptation_transform=None
)


def soft_picture(height: int = 96, width: int = 128) -> np.ndarray:
    """(H, W, 3) uint8 of saturated, smooth colours, which compression keeps."""
    noise = gaussian_filter(RNG.random((height, width, 3)), (8, 8, 0))
    noise = (noise - noise.min((0, 1))) / np.ptp(noise, (0, 1))
    return (noise * 255).astype(np.uint8)


def p3_to_srgb(pixels: np.ndarray) -> np.ndarray:
    """Display P3 in 8 bits to sRGB in [0, 1], clipped."""
    light = colour.models.eotf_sRGB(pixels / 255.0) @ P3_TO_SRGB.T
    return colour.models.eotf_inverse_sRGB(np.clip(light, 0.0, 1.0))


def delta_e(first: np.ndarray, second: np.ndarray) -> float:
    labs = [colour.XYZ_to_Lab(colour.sRGB_to_XYZ(values)) for values in (first, second)]
    return float(colour.delta_E(*labs, method="CIE 2000").mean())


def save(path: Path, pixels: np.ndarray, profile: bytes | None = DISPLAY_P3, **options: object) -> Path:
    picture = Image.fromarray(pixels)
    if path.suffix.lower() == ".heic":
        file = pillow_heif.from_pillow(picture)
        file.info["icc_profile"] = profile or b""
        file.save(path, quality=-1, chroma=444, **options)
    else:
        picture.save(path, icc_profile=profile, **({"quality": 100, "subsampling": "4:4:4"} | options))
    return path


@pytest.mark.parametrize("name", ["x.heic", "x.avif", "x.jpg", "x.png", "x.webp", "x.tif"])
def test_display_p3_becomes_srgb_whatever_the_format(tmp_path: Path, name: str) -> None:
    pixels = soft_picture()
    options = {} if name[-4:] in ("heic", "avif", ".jpg") else {"subsampling": None}
    if name.endswith((".png", ".webp", ".tif")):
        Image.fromarray(pixels).save(tmp_path / name, icc_profile=DISPLAY_P3, lossless=True)
    else:
        save(tmp_path / name, pixels, **options)
    color, alpha = read_pixels(tmp_path / name)
    assert alpha is None
    assert delta_e(color / 255.0, p3_to_srgb(pixels)) < 1.0
    assert delta_e(pixels / 255.0, p3_to_srgb(pixels)) > 1.5  # what is lost where the profile is not looked at


@pytest.mark.skipif(not DATA.is_dir(), reason="needs the photographs of telephones")
@pytest.mark.parametrize("name", ["arrow_iphone8plus.heic", "pug_iphone13pro.heic", "tulips_iphone13promax.HEIC"])
def test_photographs_of_telephones_have_the_colours_of_the_reference(tmp_path: Path, name: str) -> None:
    """All the way to what the pipeline reads: decoded, converted, written as JPEG, read again."""
    (tmp_path / "in").mkdir()
    shutil.copyfile(DATA / name, tmp_path / "in" / name)
    (tmp_path / "out").mkdir()
    made = make_photographs(find_material(tmp_path / "in"), tmp_path / "out", Reporter())
    color, _ = read_pixels(made.folder / made.names[0], upright=True)
    source = pillow_heif.open_heif(DATA / name)
    decoded = np.asarray(source.to_pillow().convert("RGB"))
    assert color.shape == decoded.shape
    step = 7
    assert delta_e(color[::step, ::step] / 255.0, p3_to_srgb(decoded[::step, ::step])) < 1.0
    header = read_header(made.folder / made.names[0])
    assert header.orientation == 1
    assert "Apple" in header.taken_with
    assert header.taken_with == read_header(DATA / name).taken_with
    gain_maps = [warning for warning in made.warnings if warning.name == "gain-map"]
    assert bool(gain_maps) == name.startswith("pug")


@pytest.mark.parametrize("orientation", [1, 3, 6, 8])
@pytest.mark.parametrize("ending", ["heic", "avif"])
def test_orientation_is_applied_once(tmp_path: Path, ending: str, orientation: int) -> None:
    pixels = soft_picture()
    exif = Image.Exif()
    exif[0x0112] = orientation
    upright = ImageOps.exif_transpose(_with(Image.fromarray(pixels), exif))
    path = tmp_path / f"x.{ending}"
    if ending == "heic":
        file = pillow_heif.from_pillow(Image.fromarray(pixels))
        file.info["exif"] = exif.tobytes()  # for which it writes irot; what reads the file has to ignore one of them
        file.save(path, quality=-1, chroma=444)
    else:
        Image.fromarray(pixels).save(path, quality=100, subsampling="4:4:4", exif=exif.tobytes())
    for is_upright in (True, False):
        color, _ = read_pixels(path, upright=is_upright)
        assert color.shape == np.asarray(upright).shape
        assert np.abs(color.astype(int) - np.asarray(upright)).mean() < 3.0
    header = read_header(path)
    assert header.orientation == 1
    assert (header.width, header.height) == upright.size


def _with(picture: Image.Image, exif: Image.Exif) -> Image.Image:
    file = io.BytesIO()
    picture.save(file, "PNG", exif=exif)
    return Image.open(file)


def test_a_grey_heic_of_10_bits_keeps_its_greys(tmp_path: Path) -> None:
    grey = soft_picture()[..., 0]
    wide = (grey.astype(np.uint16) * 257).tobytes()
    pillow_heif.from_bytes(mode="I;16", size=(128, 96), data=wide).save(tmp_path / "x.heic", quality=-1)
    assert read_header(tmp_path / "x.heic").bits == 10
    color, alpha = read_pixels(tmp_path / "x.heic")
    assert alpha is None
    assert np.abs(color.astype(int) - grey[..., None]).max() <= 1


def test_a_heic_that_was_renamed_is_read(tmp_path: Path) -> None:
    save(tmp_path / "x.heic", soft_picture()).rename(tmp_path / "x.jpg")
    assert read_pixels(tmp_path / "x.jpg")[0].shape == (96, 128, 3)


def srgb_of(xyz: np.ndarray) -> np.ndarray:
    return np.clip(colour.XYZ_to_sRGB(xyz), 0, 1)


def xyz_picture() -> np.ndarray:
    return colour.sRGB_to_XYZ(0.1 + 0.6 * soft_picture() / 255.0)


def test_a_raw_file_has_the_colours_of_the_light_up_to_its_exposure(tmp_path: Path) -> None:
    xyz = xyz_picture()
    color = read_pixels(write_dng(tmp_path / "x.dng", xyz, exposure=0.5))[0] / 255.0
    wanted = srgb_of(xyz)
    light, wanted_light = colour.models.eotf_sRGB(color), colour.models.eotf_sRGB(wanted)
    gain = np.median(wanted_light / np.maximum(light, 1e-3))
    inner = np.s_[8:-8, 8:-8]
    assert delta_e(colour.models.eotf_inverse_sRGB(np.clip(light * gain, 0, 1))[inner], wanted[inner]) < 1.0


def test_raw_files_of_a_capture_are_developed_alike(tmp_path: Path) -> None:
    """A camera that changes its mind on white from photograph to photograph does not change a thread's colour."""
    xyz = xyz_picture()
    paths = [write_dng(tmp_path / f"{n}.dng", xyz, balance=balance) for n, balance in enumerate((0.8, 1.0, 1.2))]
    common = Development.common(paths)
    alike = [read_pixels(path, development=common)[0] / 255.0 for path in paths]
    each = [read_pixels(path)[0] / 255.0 for path in paths]
    assert delta_e(alike[0], alike[2]) < 0.1
    assert delta_e(each[0], each[2]) > 3.0


def test_photographs_without_a_scene_are_developed_alike_too(tmp_path: Path) -> None:
    xyz = xyz_picture()
    (tmp_path / "in").mkdir()
    for n, balance in enumerate((0.8, 1.2)):
        write_dng(tmp_path / "in" / f"{n}.dng", xyz, balance=balance)
    (tmp_path / "in" / "broken.dng").write_bytes(b"II*\0 nothing")
    found = find_photographs([str(tmp_path / "in")], tmp_path / "out", Reporter())
    first, second = (photograph.read()[0] / 255.0 for photograph in found[:2])
    assert delta_e(first, second) < 0.1
    with pytest.raises(InputError):
        found[2].read()


@pytest.mark.parametrize("orientation", [3, 6, 8])
def test_a_raw_file_is_upright_once(tmp_path: Path, orientation: int) -> None:
    xyz = xyz_picture()
    plain = read_pixels(write_dng(tmp_path / "plain.dng", xyz))[0]
    turned = read_pixels(write_dng(tmp_path / "turned.dng", xyz, orientation=orientation), upright=True)[0]
    expected = np.rot90(plain, {3: 2, 6: 3, 8: 1}[orientation])
    assert turned.shape == expected.shape
    assert np.abs(turned.astype(int) - expected).mean() < 2.0
    header = read_header(tmp_path / "turned.dng")
    assert header.upright_size == (turned.shape[1], turned.shape[0])


def heic_with_size(path: Path, width: int, height: int) -> Path:
    """A HEIC that states another size than it has, in all its ispe boxes."""
    import struct

    data = save(path, soft_picture()).read_bytes()
    at = data.index(b"ispe")
    path.write_bytes(data[: at + 8] + struct.pack(">II", width, height) + data[at + 16 :])
    return path


@pytest.mark.parametrize("size", [(60_000, 60_000), (30_000, 30_000), (20_000, 100)])
def test_a_bomb_of_tiles_is_refused(tmp_path: Path, size: tuple[int, int]) -> None:
    with pytest.raises(InputError):
        read_pixels(heic_with_size(tmp_path / "x.heic", *size))


@pytest.mark.parametrize("name", ["x.heic", "x.avif", "x.dng"])
@pytest.mark.parametrize("keep", [0.05, 0.3, 0.8])
def test_photographs_that_are_cut_are_refused(tmp_path: Path, name: str, keep: float) -> None:
    path = tmp_path / name
    write_dng(path, xyz_picture()) if name.endswith("dng") else save(path, soft_picture())
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * keep)])
    with pytest.raises(InputError):
        read_pixels(path)


def test_a_raw_file_of_an_unknown_camera_is_refused(tmp_path: Path) -> None:
    Image.fromarray(soft_picture()).save(tmp_path / "x.tif")
    (tmp_path / "x.tif").rename(tmp_path / "x.nef")
    with pytest.raises(InputError, match="convert it to DNG"):
        read_header(tmp_path / "x.nef")


def test_the_header_of_a_telephones_photograph_tells_of_its_gain_map() -> None:
    if not DATA.is_dir():
        pytest.skip("needs the photographs of telephones")
    assert read_heif_header(DATA / "pug_iphone13pro.heic", "heif").gain_map
    assert not read_heif_header(DATA / "arrow_iphone8plus.heic", "heif").gain_map


@pytest.mark.parametrize(("transfer", "number"), [("pq", 16), ("hlg", 18)])
def test_an_hdr_photograph_is_tone_mapped_like_a_video(tmp_path: Path, transfer: str, number: int) -> None:
    codes = (soft_picture() / 255.0 * 40_000).astype(np.uint16)
    path = tmp_path / "x.hif"
    save_hdr(path, codes, number)
    color, coverage = read_pixels(path)
    expected = tone_map(torch.from_numpy(codes.astype(np.float32) / 65_535).permute(2, 0, 1), transfer)
    assert coverage is None
    assert delta_e(color / 255.0, expected.permute(1, 2, 0).numpy().astype(np.float64)) < 1.0
    made = make_photographs(find_material(tmp_path), (tmp_path / "out"), Reporter())
    assert [warning.name for warning in made.warnings] == ["photograph-hdr"]


def save_hdr(path: Path, codes: np.ndarray, transfer: int) -> None:
    """A HEIF of 10 bits, BT.2020, of (H, W, 3) 16-bit codes."""
    described = {"color_primaries": 9, "transfer_characteristics": transfer, "matrix_coefficients": 9}
    size, options = (codes.shape[1], codes.shape[0]), {"quality": -1, "chroma": 444, "save_nclx_profile": True}
    with open(path, "wb") as file:
        pillow_heif.encode("RGB;16", size, codes.tobytes(), file, **described, **options)


def test_hdr_that_is_not_read_is_refused(tmp_path: Path) -> None:
    plain = save(tmp_path / "plain.avif", soft_picture(), profile=None).read_bytes()
    place = plain.index(b"colrnclx") + 8
    (tmp_path / "hdr.avif").write_bytes(plain[:place] + bytes((0, 9, 0, 16)) + plain[place + 4 :])
    assert read_pixels(tmp_path / "plain.avif")[0].shape == (96, 128, 3)
    with pytest.raises(InputError, match="as AVIF are not read"):
        read_header(tmp_path / "hdr.avif")


def test_depth_maps_are_left_alone_and_said(tmp_path: Path) -> None:
    for folder in ("", "Depth", "scan/confidence"):
        (tmp_path / folder).mkdir(parents=True, exist_ok=True)
        Image.fromarray(soft_picture()).save(tmp_path / folder / "1.png")
    found = find_material(tmp_path)
    assert found.photographs == ("1.png",)
    (warning,) = make_photographs(found, tmp_path, Reporter()).warnings
    assert (warning.name, "2 depth maps are not used" in warning.message) == ("depth-maps", True)
    assert find_material(tmp_path / "Depth").photographs == (
        "1.png",
    )  # whose photographs are where they were asked for


def test_360_degree_photographs_are_named_with_the_way_round(tmp_path: Path) -> None:
    sphere = b"http://ns.adobe.com/xap/1.0/\0<x GPano:ProjectionType='equirectangular'/>"
    for name, shape in (("flat.jpg", (64, 96)), ("wide.jpg", (64, 128))):
        Image.fromarray(soft_picture(*shape)).save(tmp_path / name)
    inspect_capture(tmp_path)
    jpeg = (tmp_path / "wide.jpg").read_bytes()
    segment = b"\xff\xe1" + (len(sphere) + 2).to_bytes(2, "big") + sphere
    (tmp_path / "wide.jpg").write_bytes(jpeg[:2] + segment + jpeg[2:])
    with pytest.raises(InputError, match=r"wide.jpg: is a 360° photograph.*export flat pictures"):
        inspect_capture(tmp_path)


@pytest.mark.parametrize(
    ("name", "way_round"),
    [
        ("a.insp", "reframed, 90° wide"),
        ("scan.r3d", r"export EXR \+ RGB from the app"),
        ("walk.wmv", "convert it to MP4"),
        ("walk.TS", "convert it to MP4"),
    ],
)
def test_files_of_formats_that_are_not_read_are_named_with_the_way_round(
    tmp_path: Path, name: str, way_round: str
) -> None:
    (tmp_path / name).write_bytes(b"x" * 100)
    for path in (tmp_path, tmp_path / name):
        with pytest.raises(InputError, match=f"{name}.*{way_round}"):
            inspect_capture(path)


def test_a_cr3_tells_its_focal_length_so_that_a_zoom_is_not_one_lens(tmp_path: Path) -> None:
    for name, focal in (("1.cr3", 24), ("2.cr3", 70)):
        write_dng(tmp_path / name, np.full((64, 96, 3), 0.3), exif=[(0x920A, RATIONAL, [focal, 1])])
    assert [read_header(tmp_path / name).taken_with for name in ("1.cr3", "2.cr3")] == ["24 mm", "70 mm"]


def test_a_photograph_whose_exif_block_is_cut_is_used_without_it(tmp_path: Path) -> None:
    exif = b"Exif\0\0II+\0\x08\0\0\0"  # the start of a BigTIFF
    assert taken_with(exif) == ""
    heif = pillow_heif.from_pillow(Image.fromarray(soft_picture(64, 96)))
    heif.save(tmp_path / "1.heic", exif=exif)
    assert read_heif_header(tmp_path / "1.heic", "heif").exif
    (tmp_path / "out").mkdir()
    made = make_photographs(find_material(tmp_path), tmp_path / "out", Reporter())
    assert (read_header(tmp_path / "out" / made.names[0]).width, made.names) == (96, ["1.jpg"])


@pytest.mark.parametrize("number", [0x927C, 0x9286, 0x010E])
@pytest.mark.parametrize("ending", ["heic", "avif"])
def test_a_photograph_with_more_exif_data_than_a_jpeg_holds_keeps_its_lens(
    tmp_path: Path, ending: str, number: int
) -> None:
    """As the notes of a telephone's maker or of a user, or as anything else, here the description."""
    tags = Image.Exif()
    tags[0x010F], tags[0x0110] = "Acme", "Acme One"
    further = tags.get_ifd(0x8769)
    further[0x920A], further[0xA405] = IFDRational(57, 10), 24
    (tags if number == 0x010E else further)[number] = "x" * 80_000 if number == 0x010E else b"x" * 80_000
    picture, path = Image.fromarray(soft_picture(64, 96)), tmp_path / f"1.{ending}"
    if ending == "heic":
        pillow_heif.from_pillow(picture).save(path, exif=tags.tobytes())
    else:
        picture.save(path, exif=tags.tobytes())
    (tmp_path / "out").mkdir()
    make_photographs(find_material(tmp_path), tmp_path / "out", Reporter())
    assert read_header(tmp_path / "out" / "1.jpg").taken_with == "Acme Acme One 5.7 mm 24 mm on film"
