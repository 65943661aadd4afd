"""Files of a capture folder: safe paths, natural order and keys. Standard library only."""

from __future__ import annotations

import os
import re
import stat
import unicodedata
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path, PurePath, PurePosixPath

from ..errors import InputError
from ..files.untrusted import is_encodable, is_file, is_folder, is_there, read_json
from ..intake.kinds import (
    ARCHIVE_EXTENSION,
    FOREIGN_ARCHIVE_EXTENSIONS,
    FOREIGN_VIDEO_EXTENSIONS,
    HEIF_EXTENSIONS,
    RAW_EXTENSIONS,
    VIDEO_EXTENSIONS,
)
from ..intake.panoramas import PANORAMA_EXTENSIONS
from ..runs.enhanced import METRICS_NAME, enhanced_files
from ..runs.folder import files_of_a_run
from ..runs.layout import MASKS_FOLDER, REPORT_FILE
from ..runs.report import is_run

# What is read and what telephones, cameras, scanners and renderers write.
IMAGE_EXTENSIONS = (
    *(".jpg", ".jpeg", ".jfif", ".png", ".tif", ".tiff", ".exr", ".webp", ".bmp", ".tga", ".hdr", ".ppm"),
    *HEIF_EXTENSIONS,
    *RAW_EXTENSIONS,
)

IMAGE_FOLDERS = ("images", "colmap/images", "input", "rgb")
"""Where photographs usually lie in a capture."""

MODEL_FOLDERS = ("sparse", "colmap/sparse", "colmap", "colmap_sparse")
"""Where COLMAP's models, or their numbered folders, usually lie in a capture; the last is instant-ngp's."""

# One file is read; the splits of the NeRF synthetic layout overlap in purpose with our own held-out views.
TRANSFORMS_FILES = ("transforms.json", "transforms_train.json", "transforms_test.json", "transforms_val.json")

FRAMES_FILE = "frames.json"
"""In the folder of extracted frames or, in the capture, beside it:

``{"frames": [{"name", "time", "video"}, ...]}`` in order, names as `sfm.estimate_cameras` gets them, times in seconds
from the beginning of the video of that name. Photographs are not in it.
"""

# What cameras and editors leave beside them and is not read; a zip is where it is given itself.
SPLAT_EXTENSION = ".ply"
FOREIGN_EXTENSIONS = (
    *(".jxl", ".gif", ".psd", ".raf", ".rw2", ".orf", ".pef", ".srw", ".nrw", ".rwl", ".3fr", ".gpr", ".r3d"),
    *PANORAMA_EXTENSIONS,
    *FOREIGN_VIDEO_EXTENSIONS,
    *(ARCHIVE_EXTENSION, *FOREIGN_ARCHIVE_EXTENSIONS),
)

# What Windows leaves where somebody has looked at a folder, in lower case; what other systems leave is hidden.
_LEFT_BEHIND = frozenset(("thumbs.db", "ehthumbs.db", "desktop.ini"))

# Folders, in lower case, with what was deleted (Windows, Synology) and with small copies (Synology's network drives).
_NOT_LOOKED_INTO = frozenset(("$recycle.bin", "#recycle", "@eadir"))

# Names that Windows keeps for devices, with or without an extension.
_WINDOWS_DEVICE = re.compile(r"^(con|prn|aux|nul|com[1-9¹²³]|lpt[1-9¹²³])(\.|$)", re.IGNORECASE)
# In UTF-8. Output files add a suffix; file systems stop at 255 bytes.
_KEY_BYTES = 120
_QUOTED = 3  # names in a message


def natural_key(name: str) -> tuple[tuple[int, int, str], ...]:
    """Sort key under which ``2.jpg`` comes before ``10.jpg``; total, because text and numbers never meet."""
    parts = re.split(r"([0-9]+)", name)
    return tuple((1, int(part), part) if index % 2 else (0, 0, part) for index, part in enumerate(parts))


class Spelling:
    """How the disk spells names of a camera file that was written where upper and lower case are the same.

    Neither does it matter there whether an umlaut is one character or two, in which systems differ, too.

    Args:
        names: all that the camera file gives. Those that differ in that alone are different images.
    """

    def __init__(self, names: Iterable[str] = ()) -> None:
        self._counts = Counter(_folded(_portable(name)) for name in names)
        # A folder is listed once: thousands of names may be missing from it.
        self._listings: dict[Path, dict[str, list[str]]] = {}

    def find(self, folder: Path, name: str, ending: str = "") -> str:
        """`name` with `ending` as it is below `folder`.

        It is unchanged where it is there, climbs up, or not exactly one file or folder has it in another spelling.
        """
        wanted, found = _portable(name) + ending, folder
        parts = PurePosixPath(wanted).parts
        climbs = _is_absolute(wanted) or ".." in parts
        if climbs or is_there(folder / wanted) or self._counts[_folded(_portable(name))] > 1:
            return name + ending
        for part in parts:
            if not is_there(found / part):
                candidates = self._listing(found).get(_folded(part), [])
                if len(candidates) != 1:
                    return name + ending
                part = candidates[0]
            found /= part
        return found.relative_to(folder).as_posix()

    def _listing(self, folder: Path) -> dict[str, list[str]]:
        if folder not in self._listings:
            listing = self._listings[folder] = {}
            with suppress(OSError, ValueError):  # no folder, or none that can be read
                for name in os.listdir(folder):
                    listing.setdefault(_folded(name), []).append(name)
        return self._listings[folder]


def _folded(name: str) -> str:
    return unicodedata.normalize("NFC", name).lower()


def _portable(name: str) -> str:
    return name.replace("\\", "/")


def _is_absolute(portable: str) -> bool:
    return PurePosixPath(portable).is_absolute() or re.match(r"^[A-Za-z]:", portable) is not None


def relative_name(folder: Path, name: str) -> str:
    """`name` relative to `folder` where it is an absolute path that leads into it; any other name as it is.

    It is for `resolve_inside` to judge: what lies there may be a link, and a name that is still absolute is refused.
    """
    path = Path(_portable(name))
    # A name of Windows' servers is not looked at: that would call the server.
    if not path.is_absolute() or _portable(name).startswith("//"):
        return name
    try:
        return (path.parent.resolve() / path.name).relative_to(folder.resolve()).as_posix()
    except (OSError, RuntimeError, ValueError):  # a cycle of links, an unusable name, or elsewhere
        return name


def resolve_inside(folder: Path, name: str, *, where: str | Path, root: Path | None = None) -> Path:
    """The path of `name` below `folder`, for a name that a camera file gives.

    Args:
        folder: what the name is relative to.
        name: a relative path with ``/`` or ``\\``.
        where: the camera file, for the message.
        root: the capture folder, which the path must not leave, not even through a symbolic link; `folder` if None.

    Raises:
        InputError: the name is absolute, leaves the capture folder, or names something other than a regular file.
    """
    portable = _portable(name)
    remedy = "use names relative to the capture folder and keep the images inside it"
    if not portable.strip() or "\0" in portable or not is_encodable(portable):
        raise InputError(f"the image name {name!r} is unusable", where=where, remedy=remedy)
    if _is_absolute(portable):
        raise InputError(f"the image name {name!r} is an absolute path", where=where, remedy=remedy)
    path = folder / portable
    try:
        resolved, inside = path.resolve(), (root or folder).resolve()
    except (OSError, RuntimeError):
        raise InputError(
            f"the image name {name!r} leads into a loop of symbolic links", where=where, remedy=remedy
        ) from None
    if not resolved.is_relative_to(inside):
        raise InputError(f"the image name {name!r} leads out of the capture folder", where=where, remedy=remedy)
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        return path
    except OSError as error:
        raise InputError(f"the image {name!r} cannot be read ({error.strerror})", where=where, remedy=remedy) from None
    if not stat.S_ISREG(mode):
        raise InputError(f"the image name {name!r} is not a regular file", where=where, remedy=remedy)
    return path


def shared_root(capture: Path, files: Iterable[Path]) -> Path:
    """The nearest folder that holds the capture, or what of it was given, and `files`; absolute, links unresolved."""
    return Path(os.path.commonpath([os.path.abspath(path) for path in (capture, *(file.parent for file in files))]))


def visible_files(folder: Path, on_error: Callable[[OSError], object] | None = None) -> Iterator[Path]:
    """What lies in `folder` and below it, without hidden files and folders, and without what our scripts have made.

    Neither is there what somebody has deleted, nor the small copies that a network drive makes of its own accord.

    A run may have been made into the folder of its photographs, and its photographs enhanced into a folder beside them:
    that gives no further photographs. A `folder` that holds enhanced ones and no others is taken for what it is.

    Args:
        on_error: is given what the system says of a folder that cannot be read.
    """
    for directory, subfolders, files in os.walk(folder, onerror=on_error, followlinks=False):
        here = Path(directory)
        files = [name for name in files if not name.startswith(".")]
        made: set[str] = set()
        if REPORT_FILE in files and is_run(here):
            made = {path.name for path in files_of_a_run(here)}
        if METRICS_NAME in files:
            enhanced = {path.name for path in enhanced_files(here)}
            images = {name for name in files if Path(name).suffix.lower() in IMAGE_EXTENSIONS}
            if here != folder or not images <= enhanced:
                made |= enhanced
        subfolders[:] = [
            name
            for name in subfolders
            if not (name.startswith(".") or name.lower() in _NOT_LOOKED_INTO or name in made)
        ]
        yield from (here / name for name in files if name not in made)


def list_images(folder: Path, extensions: Collection[str] = IMAGE_EXTENSIONS) -> list[str]:
    """Names, relative to `folder` with ``/`` and in natural order, of the image files among its `visible_files`.

    Args:
        extensions: in lower case; those of other files, to list these instead.

    Raises:
        InputError: `folder` cannot be read. Folders in it that cannot (a disk's ``lost+found``) are left out.
    """

    def refuse(error: OSError) -> None:
        if error.filename == str(folder):
            remedy = "check the path and its permissions"
            raise InputError(f"cannot be read ({error.strerror})", where=folder, remedy=remedy)

    paths = [path for path in visible_files(folder, refuse) if path.suffix.lower() in extensions and is_file(path)]
    return sorted((path.relative_to(folder).as_posix() for path in paths), key=natural_key)


def files_of_a_capture(folder: Path) -> list[Path]:
    """What a run may read of the capture in `folder`, in order: nothing that programs leave there unasked.

    These are its `visible_files`, and those of the folders in it that are listed by themselves, which may be hidden or
    hold enhanced photographs alone: the usual ones of photographs and masks, those of models, which may be links, and
    those that a transforms.json names. A capture that has no photographs but enhanced ones has these, wherever they
    lie.
    """
    files = set(visible_files(folder))
    for part in {*_usual_folders(folder, files), *_model_folders(folder), *_named_folders(folder)}:
        files.update(visible_files(part))
    if not any(_is_material(path.relative_to(folder)) for path in files):
        for directory, subfolders, names in os.walk(folder):
            subfolders[:] = [name for name in subfolders if not name.startswith(".")]
            files.update(Path(directory, name) for name in names if not name.startswith("."))
    return sorted(path for path in files if path.name.lower() not in _LEFT_BEHIND)


def _is_material(path: Path) -> bool:
    """Whether `path`, in a capture, is called like a photograph or a video."""
    return path.suffix.lower() in (*IMAGE_EXTENSIONS, *VIDEO_EXTENSIONS) and not is_in_masks(path)


def is_in_masks(path: PurePath) -> bool:
    """Whether `path`, in a capture, lies in a folder of masks, however that is spelled."""
    return MASKS_FOLDER in (part.lower() for part in path.parent.parts)


def _usual_folders(folder: Path, files: Iterable[Path]) -> Iterator[Path]:
    """Folders of photographs and of masks beside `files`, which lie in `folder`, or beside folders with some."""
    above = {parent for place in {path.parent for path in files} for parent in (place, *place.parents)}
    for place in [folder, *(parent for parent in above if folder in parent.parents)]:
        yield from (place / name for name in (*IMAGE_FOLDERS, MASKS_FOLDER) if is_folder(place / name))


def _model_folders(folder: Path) -> Iterator[Path]:
    """The usual folders of models in `folder`, and the numbered ones in these."""
    for place in filter(is_folder, (folder / name for name in MODEL_FOLDERS)):
        yield place
        with suppress(OSError):  # a run says what is wrong with it
            yield from [path for path in place.iterdir() if path.name.isdecimal() and is_folder(path)]


def capture_root(model: Path) -> Path:
    """The capture that a model's folder belongs to: the nearest of it and its parents that has an image folder."""
    absolute = model.resolve()
    for folder in (absolute, *list(absolute.parents)[:3]):
        if any((folder / name).is_dir() for name in IMAGE_FOLDERS):
            return folder
    return model


def _named_folders(folder: Path) -> Iterator[Path]:
    """Folders below `folder` in which the photographs and masks lie that its camera files name."""
    for file in filter(is_file, (folder / name for name in TRANSFORMS_FILES)):
        try:
            document = read_json(file, strict=False)
        except InputError:
            continue  # a run says what is wrong with it
        frames = document.get("frames") if isinstance(document, dict) else None
        frames = [frame for frame in frames if isinstance(frame, dict)] if isinstance(frames, list) else []
        names = [frame.get(key) for frame in frames for key in ("file_path", "mask_path")]
        for parent in {PurePosixPath(_portable(name)).parent.as_posix() for name in names if isinstance(name, str)}:
            inside = relative_name(folder, parent)
            if not _is_absolute(inside) and ".." not in PurePosixPath(inside).parts and is_folder(folder / inside):
                yield folder / inside


def make_keys(names: Sequence[str]) -> list[str]:
    """File-system-safe keys for distinct image names, in order: ``images/cam1/0001.jpg`` becomes ``cam1_0001``.

    The folders that all names share are left out, so the key of a key is itself. Keys differ in more than their case.
    """
    paths = [PurePosixPath(name.replace("\\", "/")) for name in names]
    folders = [[part for part in path.parts[:-1] if part != "."] for path in paths]
    shared = _shared_length(folders)
    plain = [_safe("_".join([*folder[shared:], path.stem])) for folder, path in zip(folders, paths, strict=True)]
    occurrences = Counter(key.lower() for key in plain)
    taken: set[str] = set()
    keys = []
    for key, path in zip(plain, paths, strict=True):
        # Two images that differ in the extension alone stay readable: 0001_jpg, 0001_png.
        base = _safe(f"{key}_{path.suffix[1:]}") if occurrences[key.lower()] > 1 and path.suffix else key
        key, serial = base, 1
        while key.lower() in taken:
            serial += 1
            key = f"{base}-{serial}"
        taken.add(key.lower())
        keys.append(key)
    return keys


def _shared_length(folders: list[list[str]]) -> int:
    """How many leading parts all `folders` have in common."""
    return next(
        (depth for depth, parts in enumerate(zip(*folders, strict=False)) if len(set(parts)) > 1),
        min(map(len, folders), default=0),
    )


def _safe(text: str) -> str:
    text = "".join(c if _is_safe(c) else " " for c in unicodedata.normalize("NFC", text))
    text = re.sub(" +", "_", text).strip(".").encode()[:_KEY_BYTES].decode(errors="ignore") or "view"
    return f"_{text}" if is_windows_device(text) else text


def is_windows_device(name: str) -> bool:
    """Whether Windows takes a file or folder of this name for a device."""
    return _WINDOWS_DEVICE.match(name) is not None


def _is_safe(character: str) -> bool:
    """Whether it is a letter or digit of any script, a mark that belongs to one, or one of ``._-``."""
    return character.isalnum() or character in "._-" or unicodedata.category(character).startswith("M")


def quote_first(names: Iterable[str]) -> str:
    """The first few names and how many more there are, for a message."""
    names = list(names)
    more = f" and {len(names) - _QUOTED} more" if len(names) > _QUOTED else ""
    return ", ".join(names[:_QUOTED]) + more
