"""Files of a capture that show a photograph once more: it would count twice, and be held out and trained on at once."""

from __future__ import annotations

import hashlib
import re
from collections import Counter
from collections.abc import Callable, Collection, Hashable, Iterable, Sequence
from pathlib import Path, PurePosixPath

from ..errors import InputError
from ..files.untrusted import is_file, is_folder, opened
from ..intake.kinds import HEIF_EXTENSIONS, MAX_VIDEO_BYTES, RAW_EXTENSIONS
from ..intake.video import read_video_header
from .files import IMAGE_EXTENSIONS, natural_key, resolve_inside
from .images import read_header

_REDUCED = re.compile(r"images_[0-9]+")
# Google's Pixels: PXL_1.RAW-01.COVER.jpg, or PXL_1.RAW-01.jpg, and PXL_1.RAW-02.ORIGINAL.dng are one photograph, and so
# are PXL_1.MP.jpg and PXL_1.dng.
_PIXEL = re.compile(r"(\.RAW-[0-9]+(\.MP)?(\.COVER|\.ORIGINAL)?|\.MP)$")
# What telephones make of a photograph, and how that is called: an iPhone's IMG_E1234.JPG is IMG_1234.HEIC as somebody
# has edited it (cropped, or in other colours), Google Photos calls that IMG_1-edited.jpg where it is downloaded and
# PXL_1~2.jpg on a Pixel, whose portraits have a blurred background.
_EDITED = (
    (re.compile(r"IMG_E([0-9]{4})"), r"IMG_\1"),
    (re.compile(r"(.+)-edited"), r"\1"),
    (re.compile(r"(PXL_.+)~[0-9]+"), r"\1"),
    (re.compile(r"(.+\.PORTRAIT)-01\.COVER"), r"\1-02.ORIGINAL"),
    (re.compile(r"(.+\.PORTRAIT)"), r"\1.ORIGINAL"),
)
_LIVE_SECONDS = 5.0  # an iPhone films 1.5 s before a photograph and 1.5 s behind it
_START_BYTES = 1 << 16  # in which photographs of one size differ, as a rule


def without_copies(folder: Path, names: Sequence[str]) -> list[str]:
    """The photographs `names` in `folder`, each once.

    Left out are smaller copies (``images_2`` beside ``images``, in datasets), what ``corrected_images`` beside
    ``images`` has undistorted (Polycam), what a telephone has edited, and further formats of one photograph.
    """
    folders = {parent for name in names for parent in PurePosixPath(name).parents}
    shots = set(map(_shot, names))
    whole = [name for name in names if not (_is_reduced(PurePosixPath(name), folders) or _is_edited(name, shots))]
    return _in_one_format(dict.fromkeys(_corrected(folder, name) for name in whole))


def _is_reduced(path: PurePosixPath, folders: Collection[PurePosixPath]) -> bool:
    above = [folder for folder in path.parents if _REDUCED.fullmatch(folder.name)]
    return any(folder.with_name("images") in folders for folder in above)


def reduced_folders(images: Path) -> list[Path]:
    """The folders of smaller copies (``images_2``) beside the folder `images`, the largest first."""
    beside = [path for path in images.parent.glob("images_*") if _REDUCED.fullmatch(path.name) and is_folder(path)]
    return sorted(beside, key=lambda path: int(path.name.removeprefix("images_")))


def _is_edited(name: str, shots: Collection[PurePosixPath]) -> bool:
    path = PurePosixPath(name)
    found = ((edited.fullmatch(path.stem), original) for edited, original in _EDITED)
    return any(match is not None and path.with_name(match.expand(original)) in shots for match, original in found)


def _shot(name: str) -> PurePosixPath:
    """What the files of one photograph in several formats are all called: its name without what tells these apart."""
    path = PurePosixPath(name)
    return path.with_name(_PIXEL.sub("", path.stem))


def _corrected(folder: Path, name: str) -> str:
    path = PurePosixPath(name)
    if path.parent.name == "images":
        corrected = path.parent.with_name("corrected_images") / path.name
        if is_file(folder / corrected):
            return corrected.as_posix()
    return name


def _in_one_format(names: Iterable[str]) -> list[str]:
    """`names` without those that are another one in another format: IMG_1.DNG, IMG_1.JPG.

    Kept is the kind that most photographs have, so that all are of one kind where that can be; else what the camera
    wrote first, which a JPEG is made of.
    """
    paths = {name: PurePosixPath(name) for name in names}
    counts = Counter(_kind(path) for path in paths.values())
    kept: dict[PurePosixPath, str] = {}
    for name, path in paths.items():
        shot, kind = _shot(name), _kind(path)
        kept[shot] = max(kind, kept.get(shot, kind), key=lambda kind: (counts[kind], *_rank(kind)))
    return [name for name, path in paths.items() if _kind(path) == kept[_shot(name)]]


def without_repeats(folder: Path, names: Sequence[str]) -> list[str]:
    """`names` without what is another file byte for byte, as a browser's IMG_1 (1).jpg is; the shortest name stays.

    Raises:
        InputError: a file cannot be read.
    """
    paths = sorted((folder / name for name in names), key=lambda path: (len(str(path)), natural_key(str(path))))
    alike = [paths]
    for trait in (_size, _start, _digest):  # the next one of those alone that agree so far
        alike = [group for together in alike for group in _grouped(together, trait)]
    repeats = {path for group in alike for path in group[1:]}
    return [name for name in names if folder / name not in repeats]


def _grouped(paths: Iterable[Path], trait: Callable[[Path], Hashable]) -> list[list[Path]]:
    """Those of `paths` that share a trait, in order; not those of a false one, as empty files have."""
    groups: dict[Hashable, list[Path]] = {}
    for path in paths:
        groups.setdefault(trait(path), []).append(path)
    return [group for shared, group in groups.items() if shared and len(group) > 1]


def _size(path: Path) -> int:
    return path.stat().st_size


def _start(path: Path) -> bytes:
    with opened(path, most_bytes=MAX_VIDEO_BYTES) as file:
        return file.read(_START_BYTES)


def _digest(path: Path) -> bytes:
    with opened(path, most_bytes=MAX_VIDEO_BYTES) as file:
        return hashlib.file_digest(file, "sha256").digest()


def in_other_formats(photographs: Iterable[str], copies: Iterable[str]) -> dict[str, str]:
    """Those of `copies` that are one of `photographs` in another format, and which one."""
    kept = {_shot(name): name for name in photographs}
    return {
        copy: kept[_shot(copy)]
        for copy in copies
        if _shot(copy) in kept and _kind(PurePosixPath(copy)) in IMAGE_EXTENSIONS
    }


def _kind(path: PurePosixPath) -> str:
    return path.suffix.lower()


def _rank(kind: str) -> tuple[bool, bool, int]:
    return kind in RAW_EXTENSIONS, kind in HEIF_EXTENSIONS, -IMAGE_EXTENSIONS.index(kind)


def without_live_photos(folder: Path, videos: Sequence[str], photographs: Iterable[str]) -> list[str]:
    """`videos` without the moving parts of Live Photos, which are short and called like one of the photographs.

    A longer video is none: its download may have left a picture of the same name beside it.

    Raises:
        InputError: a video is a link out of `folder`.
    """
    places = {PurePosixPath(name).with_suffix("") for name in photographs}
    return [name for name in videos if PurePosixPath(name).with_suffix("") not in places or not _is_short(folder, name)]


def frames_among(folder: Path, photographs: Iterable[str], videos: Iterable[str]) -> list[str]:
    """Which of the `photographs` are frames of the `videos`, as it seems: of the size of one, and of no camera's data.

    Raises:
        InputError: a photograph or a video cannot be used.
    """
    films = [read_video_header(folder / name) for name in videos]
    sizes = {(film.width, film.height) for film in films}
    headers = ((name, read_header(folder / name)) for name in photographs)
    return [name for name, header in headers if header.upright_size in sizes and not header.taken_with]


def _is_short(folder: Path, name: str) -> bool:
    path = resolve_inside(folder, name, where=folder)
    try:
        return 0.0 < read_video_header(path).seconds <= _LIVE_SECONDS
    except InputError:  # whoever needs the video says what is wrong with it
        return False
