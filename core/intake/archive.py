"""A zip of a capture, unpacked into a folder. Standard library only."""

from __future__ import annotations

import lzma
import os
import shutil
import stat
import unicodedata
import zipfile
import zlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path, PurePosixPath

from ..errors import InputError

MAX_ENTRIES = 50_000
MAX_BYTES = 64 << 30
# Photographs and videos do not become smaller; camera files become a tenth.
MAX_RATIO = 50
_LEAST_FREE_BYTES = 1 << 30  # that stay free on the disk
_BLOCK = 1 << 20
_ENCRYPTED, _UTF8 = 0x1, 0x800  # flags of an entry
_HIDDEN = (".", "__MACOSX", "Icon\r")  # the last is the picture that a folder has in macOS
_UNUSABLE = ("Cc", "Cs")  # Unicode's categories of control characters and of halves of characters
_RESERVED = ':*?"<>|' if os.name == "nt" else ""
_PACK_AGAIN = "pack the folder of photographs again, as a plain zip"
_RENAME = "rename the file, and pack the folder again"


def unpack(archive: Path, folder: Path, progress: Callable[[float], None] = lambda _: None) -> Path:
    """Unpack `archive` into the existing, empty `folder`; returns the capture in it: `folder` or the only one there.

    Hidden files and what macOS adds are left out.

    Args:
        progress: told the share that is done.

    Raises:
        InputError: not a zip, damaged, encrypted, with paths or links that lead out of it, or too much when unpacked.
    """
    try:
        with zipfile.ZipFile(archive) as opened:
            entries = _usable(opened, archive)
            total = sum(entry.file_size for entry in entries)
            _require_room(total, archive, folder)
            done = 0
            for entry in entries:
                done += _extract(opened, entry, folder, archive)
                progress(done / max(total, 1))
    except (zipfile.BadZipFile, zlib.error, lzma.LZMAError, EOFError, RuntimeError, UnicodeError, ValueError):
        raise _refusal(archive, "the zip is damaged or not one that can be read") from None
    except OSError as error:
        remedy = "check its permissions and the free space, or unpack it and give the folder"
        raise _refusal(archive, f"cannot be unpacked ({error.strerror or error})", remedy) from None
    inside = list(folder.iterdir())
    return inside[0] if len(inside) == 1 and inside[0].is_dir() else folder


def _usable(opened: zipfile.ZipFile, archive: Path) -> list[zipfile.ZipInfo]:
    """The entries that are files to unpack; all are checked before any is written."""
    infos = opened.infolist()
    if len(infos) > MAX_ENTRIES:
        raise _refusal(archive, f"the zip has {len(infos):,} files, the limit is {MAX_ENTRIES:,}")
    usable, places = [], set()
    for info in infos:
        info.filename = _name_of(info)
        name = info.filename.replace("\\", "/")
        path = PurePosixPath(name)
        if not name or path.is_absolute() or ".." in path.parts or name[1:3] == ":/":
            raise _refusal(archive, f"the zip has a file with the path {name[:80]!r}")
        mode = info.external_attr >> 16
        if stat.S_IFMT(mode) not in (0, stat.S_IFREG, stat.S_IFDIR):
            raise _refusal(archive, f"the zip has a link or a device, {name[:80]!r}")
        if info.is_dir() or any(part.startswith(_HIDDEN) for part in path.parts):
            continue
        if any(unicodedata.category(character) in _UNUSABLE or character in _RESERVED for character in name):
            raise _refusal(archive, f"the zip has a file with the unusable name {name[:80]!r}", _RENAME)
        if info.flag_bits & _ENCRYPTED:
            raise _refusal(archive, "the zip is encrypted", "unpack it, and give the folder")
        if path.as_posix().lower() in places:
            raise _refusal(archive, f"the zip has two files called {name[:80]!r}")
        places.add(path.as_posix().lower())
        usable.append(info)
    if not usable:
        raise _refusal(archive, "the zip is empty")
    return usable


def _name_of(info: zipfile.ZipInfo) -> str:
    """An entry's name, which is also UTF-8 where that decodes: macOS' Finder does not set the flag that says so."""
    if not info.flag_bits & _UTF8:
        with suppress(UnicodeError):
            return info.filename.encode("cp437").decode("utf-8")
    return info.filename


def _require_room(total: int, archive: Path, folder: Path) -> None:
    size = f"the zip would have {total / 1e9:,.1f} GB when unpacked"
    if total > MAX_BYTES:
        raise _refusal(archive, f"{size}, the limit is {MAX_BYTES / 1e9:,.0f}")
    if total > MAX_RATIO * archive.stat().st_size + _BLOCK:
        raise _refusal(archive, f"{size} from {archive.stat().st_size / 1e6:,.1f} MB, which photographs never do")
    free = shutil.disk_usage(folder).free
    if total + _LEAST_FREE_BYTES > free:
        raise _refusal(archive, f"{size}, and the disk has {free / 1e9:,.1f}", "free space, or unpack it elsewhere")


def _extract(opened: zipfile.ZipFile, entry: zipfile.ZipInfo, folder: Path, archive: Path) -> int:
    """Write one file; returns its size, which is not more than the entry states."""
    target = folder / entry.filename.replace("\\", "/")
    target.parent.mkdir(parents=True, exist_ok=True)
    written = 0
    with opened.open(entry) as source, open(target, "xb") as file:
        while block := source.read(_BLOCK):
            written += len(block)
            if written > entry.file_size:
                raise _refusal(archive, "the zip holds more than it states")
            file.write(block)
    return written


def _refusal(archive: Path, what: str, remedy: str = _PACK_AGAIN) -> InputError:
    return InputError(what, where=archive, remedy=remedy)
