"""Files that get their names only when they are whole. Standard library only: any Python and Blender's imports this."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from .errors import InputError


def partial_file(path: Path, *, contested: bool = False) -> Path:
    """Where the file `path` is made before it gets its name: hidden beside it, with its ending.

    Args:
        contested: another process may make the same file at the same time; otherwise what was left by a process that
            was killed is overwritten by the next one.
    """
    owner = f".{os.getpid()}" if contested else ""
    return path.with_name(f".{path.stem}{owner}.partial{path.suffix}")


@contextmanager
def replacing(path: Path, *, contested: bool = False) -> Iterator[Path]:
    """A file to make, which takes the name `path` when all went well and is removed when it did not.

    Args:
        contested: as for `partial_file`.

    Raises:
        OSError: the system refuses.
    """
    temporary = partial_file(path, contested=contested)
    try:
        yield temporary
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def writing_whole(path: Path) -> Iterator[BinaryIO]:
    """`replacing` for a file that the user has named, open for writing.

    Raises:
        InputError: the system refuses (no such folder, no permission, no room).
    """
    try:
        with replacing(path) as temporary, open(temporary, "wb") as file:
            yield file
    except OSError as error:
        raise InputError(
            f"cannot be written ({error.strerror or error})", where=path, remedy="check the folder and its free space"
        ) from None
