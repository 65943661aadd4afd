"""What a file is, by its first bytes and its name. Standard library only."""

from __future__ import annotations

from pathlib import Path

from ..errors import InputError
from ..files.untrusted import opened

HEIF_EXTENSIONS = (".heic", ".heif", ".hif", ".avif")
RAW_EXTENSIONS = (".dng", ".cr2", ".cr3", ".nef", ".arw")
VIDEO_EXTENSIONS = (".mp4", ".mov", ".m4v", ".mkv", ".webm", ".avi", ".3gp", ".mts", ".m2ts")
FOREIGN_VIDEO_EXTENSIONS = (".wmv", ".mpg", ".mpeg", ".ts", ".flv", ".vob", ".ogv")
"""Of videos that are not read; those of camcorders and DVDs among them are interlaced, as a rule."""
ARCHIVE_EXTENSION = ".zip"
FOREIGN_ARCHIVE_EXTENSIONS = (".7z", ".rar", ".tar", ".gz")
MAX_VIDEO_BYTES = 64 << 30  # an hour of 4K at 100 Mbit/s has 45 GB

_START_BYTES = 32
# ISO/IEC 23008-12, annex B, and the AV1 image format: brands of files that hold pictures.
_HEIF_BRANDS = (b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1", b"mif2", b"hej2")
_AVIF_BRANDS = (b"avif", b"avis")
_CANON_RAW = b"crx "
_MATROSKA = b"\x1aE\xdf\xa3"
_PLAIN_IMAGES = (b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff", b"GIF8", b"BM")


def kind_of(start: bytes, name: str) -> str:
    """ "heif", "avif", "raw", "video" or "" (anything else) for a file's first 32 bytes and its name.

    The bytes come first: what a telephone hands on as .jpg is often a .heic. TIFF files are raw by their names alone.
    """
    if start[4:8] == b"ftyp":
        brand = start[8:12].lower()
        if brand in _AVIF_BRANDS or (brand in _HEIF_BRANDS and b"avif" in start[16:]):
            return "avif"
        if brand in _HEIF_BRANDS:
            return "heif"
        return "raw" if brand == _CANON_RAW else "video"
    if start[4:8] in (b"moov", b"mdat", b"wide") or start.startswith(_MATROSKA):
        return "video"
    if start.startswith(b"RIFF") and start[8:12] == b"AVI ":
        return "video"
    is_tiff = start[:2] in (b"II", b"MM")
    return "raw" if is_tiff and Path(name).suffix.lower() in RAW_EXTENSIONS else ""


def kind_of_file(path: Path) -> str:
    """`kind_of` for the file `path`.

    Raises:
        InputError: it cannot be read.
    """
    with opened(path, most_bytes=MAX_VIDEO_BYTES) as file:
        return kind_of(file.read(_START_BYTES), path.name)


def video_as_photograph(path: Path) -> InputError:
    """The refusal of a video where a photograph is needed, which is often called like one."""
    if is_video(path):
        return InputError("is a video, not a photograph", where=path, remedy="give photographs, or its frames as JPEG")
    return InputError("is a video with a photograph's name", where=path, remedy="name it .mp4, or remove it")


def is_plain_image(start: bytes) -> bool:
    """Whether a file begins as a PNG, JPEG, GIF or bitmap does, whatever its name says."""
    return start.startswith(_PLAIN_IMAGES)


def is_video(path: Path) -> bool:
    """Whether the name is a video's."""
    return path.suffix.lower() in VIDEO_EXTENSIONS


def is_archive(path: Path) -> bool:
    """Whether the name is a zip's."""
    return path.suffix.lower() == ARCHIVE_EXTENSION
