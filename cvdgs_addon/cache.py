"""What can be made again at any time: thumbnails and compiled kernels, kept to a size. No bpy."""

from __future__ import annotations

import contextlib
import hashlib
import os
import shutil
from pathlib import Path

_KERNELS, _THUMBNAILS = "kernels", "thumbnails"


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
