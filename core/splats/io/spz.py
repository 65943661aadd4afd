"""SPZ files (Niantic's compressed splats), in and out. numpy only: Blender's Python imports this.

After the public description of the format (https://github.com/nianticlabs/spz). Versions 2 and 3 are one gzip stream: a
header of 16 bytes and then one section each for all Gaussians: positions (three 24-bit fixed-point numbers), opacities,
base colours, log scales (a byte per component), rotations (version 2: x, y, z in a byte each; version 3: the three
smallest components in 10 bits each and the index of the largest in 2) and the colour terms above degree 0 (a byte each,
colour channels innermost). Version 4 has an uncompressed header of 32 bytes, a table of contents and a Zstandard stream
per section; it needs the package `zstandard`, which Blender's Python has.

The axes of the format are right, up, back; those of splat PLY files, and ours, right, down, front: y and z change sign.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ...files.untrusted import read_bytes, writing_whole
from ..gaussians import HIGHEST_SH_DEGREE, MOST_FILE_BYTES, SH_TERMS, Gaussians, require_room
from .splat_file import bytes_to_opacity_logits, normalised, opacities_to_bytes, to_bytes

MAGIC = b"NGSP"
GZIP_MAGIC = b"\x1f\x8b"
VERSIONS_WRITTEN = (2, 3)

# Magic, version, Gaussians, SH degree, fractional bits, flags, reserved or streams.
_HEADER = struct.Struct("<4sIIBBBB")
_CONTENTS_AT = struct.Struct("<I12x")  # version 4 only: offset of the table of contents
_CONTENTS_ENTRY = struct.Struct("<QQ")  # compressed and uncompressed length of a stream
_COLOR_STEPS = 0.15 * 255.0  # bytes per unit of a degree-0 coefficient: room beyond [0, 1] on both sides
_SCALE_STEPS, _SCALE_LOWEST = 16.0, -10.0  # bytes per unit of a log scale, and the log scale of byte 0
_MOST_CLIPPED = 0.01  # of the Gaussians, whose size changes; in usual scenes none
_SH_STEPS = 128.0  # bytes per unit of a higher coefficient
_SH_BUCKETS = (8, 16)  # of degree 1 and above: coefficients are rounded to this many steps, to compress better
_POSITION_LIMIT = 1 << 23  # 24 bits with a sign
_USUAL_FRACTIONAL_BITS = 12  # of the reference encoder: a quarter of a millimetre if the unit is a metre
_RELATIVE_BITS = 16  # positions are stored to at least 2^-16 of the scene's size, whatever its unit
_LEAST_RELATIVE_BITS = 10  # of the scene's size: coarser steps show in pictures of a thousand pixels
_FRACTIONAL_BITS_LIMIT = 30
_COMPONENT_STEPS = 511.0  # 9 bits and a sign for at most sqrt(1/2)
# Neither compression can do better: a header that claims more than this times the file's length is wrong.
_HIGHEST_COMPRESSION = 1032
# Signs of the spherical harmonics above degree 0 when y and z change theirs (products of y, z, yz, ... in their order).
_SH_SIGNS = np.array([-1, -1, 1, -1, 1, 1, -1, 1, -1, 1, -1, -1, 1, -1, 1], np.float32)
_USE_ANOTHER = "choose a .spz file of version 2, 3 or 4, or export a .ply"


@dataclass(frozen=True)
class _Layout:
    """The header, and the lengths in bytes that follow from it."""

    version: int
    count: int
    sh_degree: int
    fractional_bits: int
    streams: int

    @property
    def sections(self) -> tuple[int, ...]:
        """Bytes per Gaussian: position, opacity, colour, scale, rotation, higher colour terms."""
        return 9, 1, 3, 3, 3 if self.version == 2 else 4, 3 * SH_TERMS[self.sh_degree]

    @property
    def size(self) -> int:
        """Bytes of all sections."""
        return self.count * sum(self.sections)


def read_spz(path: str | Path) -> Gaussians:
    """Read an SPZ file of version 2 to 4; colour terms above degree 3 are dropped.

    Raises:
        InputError: not an SPZ file, cut short, damaged, or of an unknown version.
    """
    path = Path(path)
    data = read_bytes(path, most_bytes=MOST_FILE_BYTES)
    if data[:4] == MAGIC:
        layout, sections = _open_streams(data, path)
    elif data[:2] == GZIP_MAGIC:
        layout, sections = _open_gzip(data, path)
    else:
        raise InputError("not an SPZ file", where=path, remedy=_USE_ANOTHER)
    return _unpack(layout, sections)


def write_spz(path: str | Path, gaussians: Gaussians, version: int = 3) -> None:
    """Write an SPZ file of `version` 2 or 3.

    Positions are precise to 2^-12 scene units or 2^-16 of the scene's size, whichever is finer, and less where a
    Gaussian lies far out; log scales, from -10 to 5.9, to 1/32, and beyond that clipped; opacities and colours to half
    a byte.

    Raises:
        InputError: a position, or the size of more than a few Gaussians, is beyond the range of the format, or one lies
            so far out that the positions of all would be less precise than 2^-10 of the scene's size.
        ValueError: an unknown version.
    """
    if version not in VERSIONS_WRITTEN:
        raise ValueError(f"version {version} is not written, only {VERSIONS_WRITTEN}")
    bits = _fractional_bits(gaussians.means, Path(path))
    _require_sizes(gaussians.log_scales, Path(path))
    header = _HEADER.pack(MAGIC, version, len(gaussians), gaussians.sh_degree, bits, 0, 0)
    compressor = zlib.compressobj(wbits=31)  # a gzip stream
    with writing_whole(Path(path)) as file:
        file.write(compressor.compress(header))
        for section in _packed(gaussians, bits, version):
            file.write(compressor.compress(np.ascontiguousarray(section).data))
        file.write(compressor.flush())


def _open_gzip(data: bytes, path: Path) -> tuple[_Layout, list[NDArray[np.uint8]]]:
    """The sections of versions 2 and 3; allocates no more than the file holds or its header claims."""
    stream = zlib.decompressobj(wbits=31)
    try:
        layout = _parse_header(stream.decompress(data, _HEADER.size), (2, 3), path)
        _require_plausible(layout, len(data), path)
        body = stream.decompress(stream.unconsumed_tail, layout.size) if layout.size else b""
        more = stream.decompress(stream.unconsumed_tail, 1)  # up to the checksum, unless extensions follow
    except zlib.error as error:
        raise InputError(f"damaged ({error})", where=path, remedy="copy or export it again") from None
    if len(body) < layout.size or not (more or stream.eof):
        raise _cut_short(layout, path)
    ends = np.cumsum([layout.count * length for length in layout.sections])
    return layout, np.split(np.frombuffer(body, np.uint8), ends[:-1])


def _open_streams(data: bytes, path: Path) -> tuple[_Layout, list[NDArray[np.uint8]]]:
    """The sections of version 4."""
    layout = _parse_header(data[: _HEADER.size], (4,), path)
    _require_plausible(layout, len(data), path)
    try:
        import zstandard  # here, because only this version needs it
    except ImportError:
        raise InputError(
            "SPZ version 4 needs the Python package 'zstandard'", where=path, remedy="install it, or export version 3"
        ) from None
    lengths = [layout.count * length for length in layout.sections]
    present = [length for length in lengths if length]  # an empty section has no stream
    try:
        (offset,) = _CONTENTS_AT.unpack_from(data, _HEADER.size)
        entries = [_CONTENTS_ENTRY.unpack_from(data, offset + i * _CONTENTS_ENTRY.size) for i in range(layout.streams)]
    except struct.error:
        raise _cut_short(layout, path) from None
    if [uncompressed for _, uncompressed in entries] != present:
        raise InputError("its table of contents does not match its header", where=path, remedy=_USE_ANOTHER)
    start = offset + layout.streams * _CONTENTS_ENTRY.size
    sections = []
    for compressed, length in entries:
        chunk = data[start : start + compressed]
        start += compressed
        try:
            if zstandard.get_frame_parameters(chunk).content_size not in (length, zstandard.CONTENTSIZE_UNKNOWN):
                raise _cut_short(layout, path)
            section = zstandard.ZstdDecompressor().decompress(chunk, max_output_size=length)
        except zstandard.ZstdError as error:
            raise InputError(f"damaged ({error})", where=path, remedy="copy or export it again") from None
        if len(section) != length:
            raise _cut_short(layout, path)
        sections.append(np.frombuffer(section, np.uint8))
    filled = iter(sections)
    return layout, [next(filled) if length else np.zeros(0, np.uint8) for length in lengths]


def _parse_header(header: bytes, versions: Sequence[int], path: Path) -> _Layout:
    if len(header) < _HEADER.size or header[:4] != MAGIC:
        raise InputError("not an SPZ file", where=path, remedy=_USE_ANOTHER)
    _, version, count, degree, bits, _, streams = _HEADER.unpack(header)
    if version not in versions:
        what = "not compressed" if version in VERSIONS_WRITTEN else "unknown"
        raise InputError(f"SPZ version {version} is {what}", where=path, remedy=_USE_ANOTHER)
    if degree >= len(SH_TERMS) or bits > _FRACTIONAL_BITS_LIMIT:
        raise InputError(
            f"damaged: SH degree {degree}, {bits} fractional bits", where=path, remedy="copy or export it again"
        )
    return _Layout(version, count, degree, bits, streams)


def _require_plausible(layout: _Layout, available: int, path: Path) -> None:
    if layout.size > available * _HIGHEST_COMPRESSION:
        raise _cut_short(layout, path)
    require_room(layout.count, SH_TERMS[layout.sh_degree], path)


def _cut_short(layout: _Layout, path: Path) -> InputError:
    return InputError(
        f"the file is cut short: it claims {layout.count} Gaussians and holds fewer",
        where=path,
        remedy="copy or export it again",
    )


def _unpack(layout: _Layout, sections: Sequence[NDArray[np.uint8]]) -> Gaussians:
    positions, opacities, colors, scales, rotations, terms = sections
    count = layout.count
    xyz = positions.reshape(count, 3, 3).astype(np.int32)
    fixed = xyz[..., 0] | xyz[..., 1] << 8 | xyz[..., 2] << 16
    fixed -= (fixed & _POSITION_LIMIT) << 1  # the sign
    means = fixed.astype(np.float32) * np.float32(2.0**-layout.fractional_bits)
    means[:, 1:] *= -1.0
    kept = min(SH_TERMS[layout.sh_degree], SH_TERMS[HIGHEST_SH_DEGREE])
    sh = np.empty((count, 1 + kept, 3), np.float32)
    sh[:, 0] = (colors.reshape(count, 3).astype(np.float32) - 127.5) / _COLOR_STEPS
    if kept:
        higher = terms.reshape(count, SH_TERMS[layout.sh_degree], 3)[:, :kept].astype(np.float32)
        sh[:, 1:] = (higher - 128.0) / _SH_STEPS * _SH_SIGNS[:kept, None]
    unpack_rotations = _unpack_first_three if layout.version == 2 else _unpack_smallest_three
    quaternions = unpack_rotations(rotations.reshape(count, layout.sections[4]))
    quaternions[:, 2:] *= -1.0
    return Gaussians(
        means=means,
        log_scales=scales.reshape(count, 3).astype(np.float32) / _SCALE_STEPS + _SCALE_LOWEST,
        quaternions=quaternions,
        opacity_logits=bytes_to_opacity_logits(opacities),
        sh=sh,
    )


def _unpack_first_three(packed: NDArray[np.uint8]) -> NDArray[np.float32]:
    """(N, 4) wxyz of unit length from x, y, z, with w not negative."""
    xyz = packed.astype(np.float32) / 127.5 - 1.0
    w = np.sqrt(np.maximum(1.0 - (xyz**2).sum(axis=1, keepdims=True), 0.0))
    return np.concatenate([w, xyz], axis=1)


def _unpack_smallest_three(packed: NDArray[np.uint8]) -> NDArray[np.float32]:
    """(N, 4) wxyz from a little-endian word: index of the largest of xyzw, then sign and magnitude of the others."""
    word = np.ascontiguousarray(packed).view("<u4")[:, 0]
    largest = (word >> 30).astype(np.int64)
    xyzw = np.zeros((len(word), 4), np.float32)
    rows = np.arange(len(word))
    for place, shift in enumerate((20, 10, 0)):
        magnitude = (word >> shift & 511).astype(np.float32) * np.float32(np.sqrt(0.5) / _COMPONENT_STEPS)
        # The three are in the order xyzw, without the largest.
        xyzw[rows, place + (place >= largest)] = np.where(word >> shift & 512, -magnitude, magnitude)
    xyzw[rows, largest] = np.sqrt(np.maximum(1.0 - (xyzw**2).sum(axis=1), 0.0))
    return xyzw[:, [3, 0, 1, 2]]


def _fractional_bits(means: NDArray[np.float32], path: Path) -> int:
    """Fractional bits of the positions: as many as the scene's size requires and its farthest Gaussian allows."""
    if not len(means):
        return _USUAL_FRACTIONAL_BITS
    farthest, remedy = float(np.abs(means).max()), "remove what lies that far out, or write a .ply"
    lies = f"a Gaussian lies {farthest:g} units from the origin"
    if not farthest < _POSITION_LIMIT - 1:
        raise InputError(f"{lies}, and SPZ reaches to {_POSITION_LIMIT}", where=path, remedy=remedy)
    size = float(np.median(np.abs(means - np.median(means, axis=0)).max(axis=1)))
    wanted = _RELATIVE_BITS - int(np.floor(np.log2(size))) if size > 0.0 else _USUAL_FRACTIONAL_BITS
    possible = int(np.floor(np.log2((_POSITION_LIMIT - 1) / farthest))) if farthest > 0.0 else _FRACTIONAL_BITS_LIMIT
    bits = max(min(max(wanted, _USUAL_FRACTIONAL_BITS), possible, _FRACTIONAL_BITS_LIMIT), 0)
    if size > 0.0 and bits == possible < wanted - _RELATIVE_BITS + _LEAST_RELATIVE_BITS:
        what = f"{lies}, so that SPZ would round all positions to {2.0**-bits:.2g} units"
        raise InputError(what, where=path, remedy=remedy)
    return bits


def _require_sizes(log_scales: NDArray[np.float32], path: Path) -> None:
    """Raise `InputError` where clipping changes the longest axis of more than a few Gaussians."""
    lowest, highest = _SCALE_LOWEST, _SCALE_LOWEST + 255.0 / _SCALE_STEPS
    longest = log_scales.max(axis=1)
    clipped = int(np.count_nonzero(np.abs(longest - np.clip(longest, lowest, highest)) > 0.5 / _SCALE_STEPS))
    if clipped > _MOST_CLIPPED * len(longest):
        raise InputError(
            f"{clipped:,} of {len(longest):,} Gaussians are smaller than {np.exp(lowest):.2g} or larger than "
            f"{np.exp(highest):.0f} units, which SPZ cannot hold",
            where=path,
            remedy="write a .ply or a .splat",
        )


def _packed(gaussians: Gaussians, bits: int, version: int) -> Iterator[NDArray[np.uint8]]:
    """The sections of `gaussians`, in their order."""
    means = gaussians.means * np.array([1.0, -1.0, -1.0], np.float32)
    fixed = np.floor(means.astype(np.float64) * 2.0**bits + 0.5).astype("<i4")
    yield fixed.view(np.uint8).reshape(-1, 3, 4)[..., :3]
    yield opacities_to_bytes(gaussians.opacity_logits)
    yield to_bytes(gaussians.sh[:, 0] * _COLOR_STEPS + 127.5)
    yield to_bytes((gaussians.log_scales - _SCALE_LOWEST) * _SCALE_STEPS)
    quaternions = normalised(gaussians.quaternions) * np.array([1.0, 1.0, -1.0, -1.0], np.float32)
    yield _pack_first_three(quaternions) if version == 2 else _pack_smallest_three(quaternions)
    terms = gaussians.sh.shape[1] - 1
    buckets = np.where(np.arange(terms) < SH_TERMS[1], *_SH_BUCKETS)[:, None]
    steps = np.floor(gaussians.sh[:, 1:] * _SH_SIGNS[:terms, None] * _SH_STEPS + 128.5)
    yield to_bytes((steps + buckets // 2) // buckets * buckets)


def _pack_first_three(quaternions: NDArray[np.float32]) -> NDArray[np.uint8]:
    """The inverse of `_unpack_first_three`."""
    sign = np.where(quaternions[:, :1] < 0.0, -1.0, 1.0)
    return to_bytes(quaternions[:, 1:] * sign * 127.5 + 127.5)


def _pack_smallest_three(quaternions: NDArray[np.float32]) -> NDArray[np.uint8]:
    """The inverse of `_unpack_smallest_three`."""
    xyzw = quaternions[:, [1, 2, 3, 0]]
    rows = np.arange(len(xyzw))
    largest = np.abs(xyzw).argmax(axis=1)
    xyzw = np.where(xyzw[rows, largest] < 0.0, -1.0, 1.0)[:, None] * xyzw
    word = largest.astype(np.uint32) << 30
    for place, shift in enumerate((20, 10, 0)):
        component = xyzw[rows, place + (place >= largest)]
        magnitude = np.floor(np.abs(component) * (_COMPONENT_STEPS / np.sqrt(0.5)) + 0.5)
        sign = np.where(component < 0.0, 512, 0).astype(np.uint32)
        word |= (sign | np.minimum(magnitude, _COMPONENT_STEPS).astype(np.uint32)) << shift
    return word.astype("<u4")[:, None].view(np.uint8)
