"""HEIC, HEIF and AVIF photographs: upright, in sRGB, HDR tone-mapped. Depth and gain maps in them are left alone."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image, ImageOps

from ..color.hdr import TRANSFERS, tone_map
from ..color.profiles import ADOBE_RGB, DISPLAY_P3, convert_to_srgb
from ..errors import InputError
from .exif import DAMAGE, is_adobe_rgb

_COPY_AGAIN = "copy or export the image again"
_GAIN_MAP = ("gainmap", "iso:ts:21496")
_BT2020_PRIMARIES, _P3_PRIMARIES = 9, 12  # ITU-T H.273
_NO_PRIMARIES = (0, 2)  # nothing is said, or "unspecified"
_SEARCHED_BYTES = 1 << 16  # of an AVIF, in which its colour description stands
_BAND_PIXELS = 1 << 20  # that are tone-mapped at a time


@dataclass(frozen=True)
class HeifHeader:
    """What such a file says of itself.

    Attributes:
        width, height: upright.
        bits: of a channel.
        exif: the raw EXIF data, or nothing.
        gain_map: whether there is one.
        depth: whether there is a depth map.
        transfer: "hlg", "pq" or "" (not HDR).
        primaries: by their number in ITU-T H.273, or 0 where nothing says.
    """

    width: int
    height: int
    bits: int
    exif: bytes
    gain_map: bool
    depth: bool = False
    transfer: str = ""
    primaries: int = 0


def read_heif_header(path: Path, kind: str) -> HeifHeader:
    """Size and EXIF data without the pixels; `kind` is "heif" or "avif".

    Raises:
        InputError: it is damaged, HDR of a kind that is not read, or a package is missing.
    """
    try:
        header = _header(_open(path, kind), kind, path)
    except DAMAGE as error:
        raise _damaged(path, error) from None
    if header.transfer and kind == "avif":
        raise _unread_hdr(path, "AVIF")
    return header


def read_heif(path: Path, kind: str) -> tuple[NDArray[np.uint8], NDArray[np.uint8] | None]:
    """(H, W, 3) sRGB and (H, W) coverage or None; the caller has looked at the size.

    Raises:
        InputError: as for `read_heif_header`.
    """
    header = read_heif_header(path, kind)
    color, coverage = _read_hdr(path, header.transfer) if header.transfer else _read_plain(path, kind, header)
    if color.shape[:2] != (header.height, header.width):
        raise _damaged(path, ValueError())
    return color, coverage


def _read_plain(path: Path, kind: str, header: HeifHeader) -> tuple[NDArray[np.uint8], NDArray[np.uint8] | None]:
    try:
        opened = _open(path, kind)
        picture = opened.to_pillow() if kind == "heif" else ImageOps.exif_transpose(opened)
        profile = opened.info.get("icc_profile")
        coverage = np.array(picture.getchannel("A")) if picture.mode in ("RGBA", "LA") else None
        color = _grey(picture) if picture.mode.startswith("I") else np.array(picture.convert("RGB"))
    except DAMAGE as error:
        raise _damaged(path, error) from None
    if profile:
        convert_to_srgb(color, bytes(profile))
    elif header.primaries == _P3_PRIMARIES:
        convert_to_srgb(color, DISPLAY_P3)
    elif header.primaries in _NO_PRIMARIES and is_adobe_rgb(header.exif):
        convert_to_srgb(color, ADOBE_RGB)
    return color, coverage


def _grey(picture: Image.Image) -> NDArray[np.uint8]:
    """(H, W, 3) of grey with 16 bits, which Pillow clips at 255 where it converts it."""
    grey = (np.asarray(picture) >> 8).astype(np.uint8)
    return np.repeat(grey[..., None], 3, axis=2)


def _read_hdr(path: Path, transfer: str) -> tuple[NDArray[np.uint8], NDArray[np.uint8] | None]:
    """A HEIF of HLG or PQ, as cameras write it: `color.hdr` with its reference white, the same for all photographs."""
    try:
        opened = _open(path, "heif", convert_hdr_to_8bit=False)
        primaries, codes = opened.info["nclx_profile"]["color_primaries"], np.asarray(opened)
    except DAMAGE as error:
        raise _damaged(path, error) from None
    if primaries != _BT2020_PRIMARIES or codes.ndim != 3 or codes.shape[2] not in (3, 4):
        raise _unread_hdr(path, "HEIF without the primaries of BT.2020")
    most = float(np.iinfo(codes.dtype).max)
    height, width = codes.shape[:2]
    color, rows = np.empty((height, width, 3), np.uint8), max(1, _BAND_PIXELS // width)
    for top in range(0, height, rows):
        encoded = torch.from_numpy(codes[top : top + rows, :, :3].astype(np.float32) / most).permute(2, 0, 1)
        mapped = tone_map(encoded, transfer)
        color[top : top + rows] = (mapped * 255.0).round().to(torch.uint8).permute(1, 2, 0).numpy()
    coverage = np.rint(codes[..., 3] / most * 255.0).astype(np.uint8) if codes.shape[2] == 4 else None
    return color, coverage


def _unread_hdr(path: Path, kind: str) -> InputError:
    what = f"HDR photographs (PQ or HLG) as {kind} are not read"
    return InputError(what, where=path, remedy="export it as JPEG, or as HEIF of BT.2020")


def _open(path: Path, kind: str, **options: Any) -> Any:
    if kind == "avif":
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # the caller looks at the size
            return Image.open(path, formats=["AVIF"])
    try:
        import pillow_heif
    except ImportError:
        remedy = "install pillow-heif (run.py --doctor says how), or export JPEG"
        raise InputError("HEIC photographs need the package pillow-heif", where=path, remedy=remedy) from None
    return pillow_heif.open_heif(path, **options)


def _header(opened: Any, kind: str, path: Path) -> HeifHeader:
    width, height = opened.size
    exif = bytes(opened.info.get("exif") or b"")
    if kind == "avif" and opened.getexif().get(0x0112, 1) >= 5:  # Pillow makes an orientation of irot and imir
        width, height = height, width
    auxiliary = [str(name).lower() for name in opened.info.get("aux", {})]
    gain_map = any(word in name for name in auxiliary for word in _GAIN_MAP)
    primaries, transfer = _described_by_avif(path) if kind == "avif" else _described_by(opened)
    depth, bits = bool(opened.info.get("depth_images")), int(opened.info.get("bit_depth", 8))
    return HeifHeader(width, height, bits, exif, gain_map, depth, TRANSFERS.get(transfer, ""), primaries)


def _described_by(opened: Any) -> tuple[int, int]:
    """The numbers of primaries and transfer in ITU-T H.273, 0 where nothing says."""
    nclx = opened.info.get("nclx_profile")
    described = nclx if isinstance(nclx, dict) else {}
    return int(described.get("color_primaries", 0)), int(described.get("transfer_characteristics", 0))


def _described_by_avif(path: Path) -> tuple[int, int]:
    """The same, of its colour description (ISO/IEC 14496-12, 12.1.5), which Pillow does not hand on."""
    with open(path, "rb") as file:
        _, _, described = file.read(_SEARCHED_BYTES).partition(b"colrnclx")
    return int.from_bytes(described[:2], "big"), int.from_bytes(described[2:4], "big")


def _damaged(path: Path, error: BaseException) -> InputError:
    if isinstance(error, InputError):
        return error
    return InputError("the image is damaged or cut short", where=path, remedy=_COPY_AGAIN)
