"""Where the evaluation data is, beside the checkout; none of it is needed."""

from __future__ import annotations

from pathlib import Path

from ...core.bootstrap import ROOT

SHARED = ROOT.parent / "shared"
PROTOTYPE = SHARED / "prototypes" / "kernels"
PHOTOS = SHARED / "data" / "photos"
FOX = SHARED / "data" / "fox"
KERMIT = SHARED / "data" / "kermit"


def photo_folders() -> list[tuple[str, Path]]:
    """The sets of photographs, where the data is there."""
    folders = sorted(PHOTOS.iterdir()) if PHOTOS.is_dir() else []
    return [(folder.name, folder) for folder in folders if folder.is_dir()]
