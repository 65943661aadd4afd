"""Files of a capture that show a photograph once more: it would count twice, and be held out and trained on at once."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from pathlib import PurePosixPath

from ..intake.kinds import HEIF_EXTENSIONS, RAW_EXTENSIONS
from .files import IMAGE_EXTENSIONS


def without_copies(names: Iterable[str]) -> list[str]:
    """`names` of photographs without those that differ from another one in the extension alone: IMG_1.DNG, IMG_1.JPG.

    Kept is the kind that most photographs have, so that all are of one kind where that can be; else what the camera
    wrote first, which a JPEG is made of.
    """
    paths = {name: PurePosixPath(name) for name in names}
    counts = Counter(_kind(path) for path in paths.values())
    kept: dict[PurePosixPath, str] = {}
    for path in paths.values():
        place, kind = path.with_suffix(""), _kind(path)
        kept[place] = max(kind, kept.get(place, kind), key=lambda kind: (counts[kind], *_rank(kind)))
    return [name for name, path in paths.items() if _kind(path) == kept[path.with_suffix("")]]


def _kind(path: PurePosixPath) -> str:
    return path.suffix.lower()


def _rank(kind: str) -> tuple[bool, bool, int]:
    return kind in RAW_EXTENSIONS, kind in HEIF_EXTENSIONS, -IMAGE_EXTENSIONS.index(kind)
