"""A small DNG, written from Adobe's specification (DNG 1.4): a mosaic of a linear sensor with a known matrix."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np

WHITE, BLACK = 16000, 256
# From CIE XYZ (D65) to the sensor; anything invertible.
XYZ_TO_SENSOR = np.array([[0.95, -0.30, -0.08], [-0.42, 1.22, 0.22], [-0.05, 0.16, 0.60]])
SHORT, _LONG, _ASCII, _BYTE, RATIONAL, _SIGNED = 3, 4, 2, 1, 5, 10
Entry = tuple[int, int, Sequence[int]]
"""Number, type and values of a tag."""
_FORMATS = {SHORT: "H", _LONG: "I", _ASCII: "s", _BYTE: "B", RATIONAL: "II", _SIGNED: "ii"}


def sensor_values(xyz: np.ndarray, exposure: float = 1.0) -> np.ndarray:
    """(..., 3) what the sensor counts, 0 to 1, of light under D65 with Y of white 1."""
    return xyz @ XYZ_TO_SENSOR.T * exposure


def write_dng(
    path: Path,
    xyz: np.ndarray,
    *,
    exposure: float = 0.5,
    orientation: int = 1,
    balance: float = 1.0,
    exif: Sequence[Entry] = (),
) -> Path:
    """`xyz` is (H, W, 3); `balance` is what the camera errs by in its white balance's red; `exif` is in order."""
    height, width = xyz.shape[:2]
    values = sensor_values(xyz, exposure)
    codes = np.clip(values * (WHITE - BLACK) + BLACK, 0, WHITE).astype("<u2")
    mosaic = codes[..., 1].copy()
    mosaic[::2, ::2] = codes[::2, ::2, 0]
    mosaic[1::2, 1::2] = codes[1::2, 1::2, 2]
    white = XYZ_TO_SENSOR @ [0.95047, 1.0, 1.08883]
    neutral = white / white[1] * [balance, 1.0, 1.0]
    pixels = mosaic.tobytes()

    def signed(rows: np.ndarray) -> list[int]:
        return [part for value in rows.ravel() for part in (round(value * 10000), 10000)]

    entries = [
        (254, _LONG, [0]), (256, _LONG, [width]), (257, _LONG, [height]), (258, SHORT, [16]), (259, SHORT, [1]),
        (262, SHORT, [32803]), (271, _ASCII, b"Acme\0"), (272, _ASCII, b"Acme One\0"), (273, _LONG, [0]),
        (274, SHORT, [orientation]), (277, SHORT, [1]), (278, _LONG, [height]), (279, _LONG, [len(pixels)]),
        (284, SHORT, [1]), (33421, SHORT, [2, 2]), (33422, _BYTE, [0, 1, 1, 2]), (50706, _BYTE, [1, 4, 0, 0]),
        (50708, _ASCII, b"Acme One\0"), (50714, _LONG, [BLACK]), (50717, _LONG, [WHITE]),
        (50721, _SIGNED, signed(XYZ_TO_SENSOR)), (50728, RATIONAL, signed(neutral)), (50778, SHORT, [21]),
    ]  # fmt: skip
    if exif:
        entries = sorted([*entries, (34665, _LONG, [0])])
    main = _table(entries, 8)
    further = _table(exif, 8 + len(main)) if exif else b""
    ends = {273: 8 + len(main) + len(further), 34665: 8 + len(main)}
    entries = [(tag, kind, [ends[tag]] if tag in ends else content) for tag, kind, content in entries]
    path.write_bytes(b"II*\0" + struct.pack("<I", 8) + _table(entries, 8) + further + pixels)
    return path


def _table(entries: Sequence[Entry], start: int) -> bytes:
    """A TIFF directory that begins at the byte `start`, and behind it the values that do not fit into it."""
    behind = start + 2 + 12 * len(entries) + 4
    extra, fields = b"", b""
    for tag, kind, content in entries:
        if kind == _ASCII:
            data, count = bytes(content), len(content)
        else:
            form = _FORMATS[kind]
            count = len(content) // len(form)
            data = struct.pack("<" + form * count, *content)
        if len(data) > 4:
            fields += struct.pack("<HHII", tag, kind, count, behind + len(extra))
            extra += data + bytes(len(data) % 2)
        else:
            fields += struct.pack("<HHI", tag, kind, count) + data.ljust(4, b"\0")
    return struct.pack("<H", len(entries)) + fields + bytes(4) + extra
