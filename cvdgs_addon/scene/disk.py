"""Whether a failure to write has the disk for its reason: bpy's operators say only that they failed."""

from __future__ import annotations

import shutil
from pathlib import Path

_LEAST_FREE = 4 << 20  # bytes; with less, there is no room for a picture or a scene


def is_full(folder: Path) -> bool:
    """Whether the disk that holds `folder` has no room left."""
    return shutil.disk_usage(folder).free <= _LEAST_FREE
