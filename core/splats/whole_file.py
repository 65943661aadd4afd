"""Files that are written whole or not at all. Standard library only: Blender's Python imports this."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from ..errors import InputError


@contextmanager
def writing_whole(path: Path) -> Iterator[BinaryIO]:
    """A file to write to, which takes the name `path` when all went well and leaves nothing behind when it did not.

    Raises:
        InputError: the system refuses (no such folder, no permission, no room).
    """
    temporary = path.with_name(path.name + ".partial")
    try:
        with open(temporary, "wb") as file:
            yield file
        os.replace(temporary, path)
    except OSError as error:
        raise InputError(
            f"cannot be written ({error.strerror or error})", where=path, remedy="check the folder and its free space"
        ) from None
    finally:
        temporary.unlink(missing_ok=True)
