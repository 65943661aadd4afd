"""Files that somebody else may have made, read as bytes, text or JSON. Standard library only: Blender imports this.

Regular files of a bounded size alone: a pipe or a device in a file's place is refused without waiting for it. Every
refusal is an `InputError`.
"""

from __future__ import annotations

import glob
import json
import math
import os
import secrets
import stat
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from io import BufferedReader
from pathlib import Path
from typing import Any, BinaryIO

from ..errors import InputError

# Camera files of 10,000 photographs have 10 MB. Python needs up to 24 bytes of memory for one of JSON ("[],[],[],"), so
# this is less than a gigabyte.
MAX_JSON_BYTES = 32 << 20
_CHECK_PATH = "check the path and its permissions"
_COPY_AGAIN = "copy or export the file again"
# What Git leaves in a large file's place where its extension LFS is not installed
# (https://github.com/git-lfs/git-lfs/blob/main/docs/spec.md); such a pointer has less than 1024 bytes.
_LFS_POINTER = b"version https://git-lfs"
_LFS_POINTER_BYTES = 1024
_ABANDONED_SECONDS = 86400.0  # nobody writes one file for a day without touching it


def is_file(path: str | Path) -> bool:
    """Whether a regular file is there; False, where `Path.is_file` raises, for a name that is too long or forbidden."""
    return os.path.isfile(path)


def is_folder(path: str | Path) -> bool:
    """Whether a folder is there; as `is_file`."""
    return os.path.isdir(path)


def is_there(path: str | Path) -> bool:
    """Whether anything is there, at the end of all links; as `is_file`."""
    return os.path.exists(path)


def is_encodable(name: str) -> bool:
    """Whether every program can be told `name`; Python's own spelling of names that are not UTF-8 is none."""
    try:
        name.encode("utf-8")
    except UnicodeEncodeError:
        return False
    return True


@contextmanager
def opened(path: str | Path, *, most_bytes: int, remedy: str = _CHECK_PATH) -> Iterator[BufferedReader]:
    """The file `path`, open for reading; the caller reads what is there and need not fear that it never ends.

    Args:
        most_bytes: that the file may have.
        remedy: what the user can do where it cannot be read.

    Raises:
        InputError: the system refuses (no such file, no permission, a damaged disk, also while it is read), or it is a
            folder, a pipe, a device, too large, or a pointer of Git LFS in the file's place.
    """
    path = Path(path)
    try:
        with _open(path, remedy) as file:
            status = os.fstat(file.fileno())
            if not stat.S_ISREG(status.st_mode):
                raise InputError("not a regular file", where=path, remedy=remedy)
            if status.st_size > most_bytes:
                raise InputError(
                    f"the file has {_size(status.st_size)}, the limit is {_size(most_bytes)}",
                    where=path,
                    remedy="check that it is the right file",
                )
            if status.st_size < _LFS_POINTER_BYTES:
                start = file.read(len(_LFS_POINTER))
                file.seek(0)
                if start == _LFS_POINTER:
                    what = "only a Git LFS pointer, not the file itself"
                    raise InputError(what, where=path, remedy="run 'git lfs pull', or download the file itself")
            yield file
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror or error})", where=path, remedy=remedy) from None


def _open(path: Path, remedy: str) -> BufferedReader:
    # Without O_NONBLOCK, opening a pipe waits until somebody writes to it.
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    try:
        return open(path, "rb", opener=lambda name, _: os.open(name, flags))
    except ValueError:  # a zero byte, or half of a surrogate pair
        raise InputError("not a valid file name", where=path, remedy=remedy) from None


def read_bytes(path: str | Path, *, most_bytes: int, remedy: str = _CHECK_PATH) -> bytes:
    """All of the file; errors as for `opened`."""
    with opened(path, most_bytes=most_bytes, remedy=remedy) as file:
        # Not read(most_bytes): Python makes room for all that it is asked for. What grows meanwhile is not read.
        return file.read(os.fstat(file.fileno()).st_size)


def read_text(path: str | Path, *, most_bytes: int, remedy: str = _COPY_AGAIN) -> str:
    """All of a UTF-8 text file, its line ends as they are; also raises `InputError` where it is something else.

    The mark that editors on Windows put before the text (a BOM) is left out.
    """
    try:
        return read_bytes(path, most_bytes=most_bytes, remedy=remedy).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError("is not UTF-8 text", where=path, remedy=remedy) from None


def read_json(
    path: str | Path, *, most_bytes: int = MAX_JSON_BYTES, remedy: str = _COPY_AGAIN, strict: bool = True
) -> Any:
    """What the JSON file says; errors as for `read_text`, and for what `parse_json` refuses."""
    text = read_text(path, most_bytes=most_bytes, remedy=remedy)
    try:
        return parse_json(text, strict=strict)
    except json.JSONDecodeError as error:
        what = f"not valid JSON (line {error.lineno}: {error.msg})"
    except ValueError as error:
        what = f"not valid JSON ({error})"
    raise InputError(what, where=path, remedy=remedy)


def parse_json(text: str, *, strict: bool = True) -> Any:
    """What `text` says.

    Args:
        strict: also refuse numbers that are not finite, for what is written again or shown.

    Raises:
        ValueError: not JSON, nested deeper than Python can follow, a key twice in an object, or an integer of thousands
            of digits.
    """
    numbers: dict[str, Any] = {"parse_constant": _finite, "parse_float": _finite} if strict else {}
    try:
        return json.loads(text, object_pairs_hook=_with_distinct_keys, **numbers)
    except RecursionError:
        raise ValueError("nested too deeply") from None


def explained(error: Exception) -> str:
    """What `error` has to say to a user, in brackets behind a space, for the end of a sentence; often nothing.

    Python's own words about types and attributes explain nothing to somebody who has not seen the code.
    """
    if isinstance(error, KeyError):
        return f" ({error.args[0]} is missing)"
    said = (getattr(error, "strerror", "") or str(error)) if isinstance(error, OSError | ValueError) else ""
    return f" ({said})" if said else ""


def _with_distinct_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    result = dict(pairs)
    if len(result) < len(pairs):
        ((repeated, _),) = Counter(key for key, _ in pairs).most_common(1)
        raise ValueError(f"the key {repeated[:40]!r} appears twice")
    return result


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"the number {text[:20]} is not finite")
    return value


def _size(count: int) -> str:
    return f"{count / 2**20:,.0f} MiB" if count >= 2**20 else f"{count:,} bytes"


def partial_file(path: Path, maker: str = "") -> Path:
    """Where the file `path` is made before it gets its name: hidden beside it, with its ending.

    Args:
        maker: distinguishes those who may make the same file at the same time. Where nobody else does, what was left by
            a process that was killed is overwritten by the next one.
    """
    return path.with_name(f".{path.stem}{maker and f'.{maker}'}.partial{path.suffix}")


@contextmanager
def replacing(path: Path, *, contested: bool = False) -> Iterator[Path]:
    """A file to make, which takes the name `path` when all went well and is removed when it did not.

    Args:
        contested: another process may make the same file at the same time, on this machine or on another one.

    Raises:
        OSError: the system refuses.
    """
    temporary = partial_file(path, secrets.token_hex(4) if contested else "")
    temporary.unlink(missing_ok=True)  # somebody may have put a link there, through which another file would be written
    try:
        yield temporary
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def remove_abandoned(path: Path) -> None:
    """Delete what processes that were killed while they made the contested file `path`, which is there, have left."""
    with suppress(OSError):
        # By the disk's own clock, which is one for all machines that share it.
        latest = path.stat().st_mtime - _ABANDONED_SECONDS
        for left in path.parent.glob(partial_file(Path(glob.escape(path.name)), "*").name):
            if left.lstat().st_mtime < latest:
                left.unlink(missing_ok=True)


@contextmanager
def writing_whole(path: Path) -> Iterator[BinaryIO]:
    """`replacing` for a file that the user has named, open for writing.

    Raises:
        InputError: the system refuses (no such folder, no permission, no room).
    """
    try:
        # Nothing keeps two programs from exporting into one file.
        with replacing(path, contested=True) as temporary, open(temporary, "wb") as file:
            yield file
        remove_abandoned(path)
    except OSError as error:
        raise InputError(
            f"cannot be written ({error.strerror or error})", where=path, remedy="check the folder and its free space"
        ) from None
