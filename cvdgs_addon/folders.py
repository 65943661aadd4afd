"""The add-on's name and its own folders, the cache in them, and folders as Blender's fields have them."""

from __future__ import annotations

import contextlib
import hashlib
import os
import shutil
from pathlib import Path

import bpy

from ..core.runtime.process import ROOT

PACKAGE = __package__.rpartition(".")[0]
"""``bl_ext.<repository>.cvdgs`` as an extension, ``cvdgs`` under the bpy wheel."""
_KERNELS, _THUMBNAILS = "kernels", "thumbnails"


def user_folder() -> Path:
    """Where the extension may write, made by whoever does: Blender removes it with the extension, not on an upgrade."""
    try:
        return Path(bpy.utils.extension_path_user(PACKAGE))
    except ValueError:  # not installed as an extension
        return Path(bpy.utils.user_resource("DATAFILES", path=PACKAGE))


class Cache:
    """A folder.

    Args:
        folder: made when something is put there.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    @property
    def kernels(self) -> Path:
        """Where Warp keeps compiled kernels (``WARP_CACHE_PATH``)."""
        return self.folder / _KERNELS

    def thumbnails(self, capture: str) -> Path:
        """The folder for the pictures of a capture."""
        return self.folder / _THUMBNAILS / hashlib.sha256(capture.encode("utf-8")).hexdigest()[:16]

    def size(self) -> int:
        """Bytes of all files."""
        return sum(size for _, size, _ in self._files())

    def shrink(self, limit: int) -> None:
        """Delete the files that were used longest ago until at most `limit` bytes are left."""
        files = sorted(self._files())
        left = sum(size for _, size, _ in files)
        for _, size, path in files:
            if left <= limit:
                return
            with contextlib.suppress(OSError):
                path.unlink()
                left -= size

    def clear(self) -> None:
        """Delete everything that the cache made; other files in the folder stay."""
        for name in (_KERNELS, _THUMBNAILS):
            shutil.rmtree(self.folder / name, ignore_errors=True)

    def _files(self) -> list[tuple[float, int, Path]]:
        """Time of the last use, bytes and path of every file."""
        found = []
        for name in (_KERNELS, _THUMBNAILS):
            for folder, _, names in os.walk(self.folder / name):
                for file in names:
                    path = Path(folder, file)
                    with contextlib.suppress(OSError):
                        status = path.stat()
                        found.append((max(status.st_atime, status.st_mtime), status.st_size, path))
        return found


def normalised_folder(folder: str) -> str:
    """A folder as Blender's fields have it (relative to the .blend, with a slash at the end), in full; "" stays so."""
    return os.path.abspath(bpy.path.abspath(folder)) if folder else ""


def folder_beside(capture_folder: str, addition: str) -> str:
    """A folder for what is made of a capture, named after it."""
    capture = Path(normalised_folder(capture_folder))
    # The demo lies inside the extension, where nothing of the user's may be lost with an upgrade.
    parent = Path.home() if ROOT in capture.resolve().parents else capture.parent
    name = capture.stem if capture.is_file() else capture.name
    return str(parent / f"{name} {addition}")
