"""Photographs and videos without cameras: what there is, and made into files that pycolmap and OpenImageIO read."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePosixPath
from statistics import median

from PIL import Image

from ..errors import InputError
from ..files.untrusted import is_file
from ..intake.archive import unpack
from ..intake.exif import exif_for_jpeg
from ..intake.heif import HeifHeader, read_heif_header
from ..intake.kinds import (
    VIDEO_EXTENSIONS,
    is_archive,
    is_video,
    kind_of_file,
    video_as_photograph,
)
from ..intake.raw import Development, exif_of_raw
from ..intake.selection import choose
from ..intake.video import MAX_SECONDS, Look, extract, look_through
from ..runtime.protocol import Reporter
from .copies import frames_among, in_other_formats, without_copies, without_live_photos, without_repeats
from .files import (
    FOREIGN_EXTENSIONS,
    FRAMES_FILE,
    IMAGE_FOLDERS,
    SPLAT_EXTENSION,
    is_in_masks,
    list_images,
    make_keys,
    natural_key,
    quote_first,
    resolve_inside,
)
from .foreign import way_round
from .images import read_pixels
from .masks import FoundMasks, find_masks, masks_among
from .model import CaptureWarning
from .scans import depth_maps_among, previews_among, textures_among

Renaming = Callable[[str], str]

STAGE = "capture"
_QUALITY = 98
_CONVERTED = ("heif", "avif", "raw")
_LOOK_SHARE = 0.5  # of the time that a video takes
_GRADE = "Export it as Rec. 709, by the camera's LUT, for true ones"
_FEWEST_WITH_VIDEOS = 3  # photographs and frames: no camera was found of two frames of a video that hardly moved


@dataclass(frozen=True)
class Material:
    """Photographs and videos, by their names in `folder` and in order.

    Attributes:
        depths: how many depth maps lie beside them.
        copies: names of files that show photographs once more.
        masks: names of masks of photographs that lie where masks are not looked for.
    """

    folder: Path
    photographs: tuple[str, ...]
    videos: tuple[str, ...] = ()
    depths: int = 0
    copies: tuple[str, ...] = ()
    masks: tuple[str, ...] = ()


@dataclass(frozen=True)
class Photographs:
    """What cameras are estimated from.

    Attributes:
        folder: where they lie.
        names: relative to it, in the order in which they were taken.
        times: seconds into the video, of the names that are frames.
        originals: of each name, the photograph or the video that it was made of, as the material calls it.
        warnings: what should be said of them.
    """

    folder: Path
    names: list[str]
    times: dict[str, float] = field(default_factory=dict)
    originals: dict[str, str] = field(default_factory=dict)
    warnings: list[CaptureWarning] = field(default_factory=list)


@contextmanager
def unpacked(path: Path, reporter: Reporter | None = None) -> Iterator[tuple[Path, Renaming]]:
    """`path`, or while it is needed the folder that a zip was unpacked into; and how texts name `path` instead.

    Raises:
        InputError: the zip cannot be used.
    """
    if not (is_archive(path) and is_file(path)):
        yield path, str
        return
    reporter = reporter or Reporter()
    reporter.status(STAGE, f"unpacking {path.name}")
    with tempfile.TemporaryDirectory(prefix="cvdgs-zip-") as folder, named_after(path, folder) as rename:
        yield unpack(path, Path(folder), lambda share: reporter.progress(STAGE, share, "unpacking")), rename


@contextmanager
def named_after(path: Path, temporary: str) -> Iterator[Renaming]:
    """Refusals of what lies in the folder `temporary`, which is gone when the user reads them, name `path` instead.

    Gives what does the same to other texts.
    """

    def rename(text: str) -> str:
        return text.replace(temporary, str(path))

    try:
        yield rename
    except InputError as error:
        if temporary not in error.where and temporary not in error.what:
            raise
        raise InputError(rename(error.what), where=rename(error.where), remedy=error.remedy) from None


def renamed(warnings: Iterable[CaptureWarning], rename: Renaming) -> tuple[CaptureWarning, ...]:
    """The same warnings about what the user gave."""
    return tuple(replace(warning, message=rename(warning.message)) for warning in warnings)


def find_material(path: Path) -> Material:
    """What is in a folder, or a video alone.

    Photographs in the folder ``images`` of a capture, where it holds any, are taken alone, so masks, depths or smaller
    copies beside it do not take part; nor do masks among the photographs. Videos are found everywhere.

    Raises:
        InputError: there is nothing, or a name is unusable or a link out of the folder.
    """
    if is_file(path):
        if is_video(path) or kind_of_file(path) == "video":
            return Material(path.parent, (), (path.name,))
        remedy = way_round(path) or "give the folder with the photographs"
        raise InputError("is one file, and no video or zip", where=path, remedy=remedy)
    videos = list_images(path, VIDEO_EXTENSIONS)
    folders = [f"{name}/" for name in IMAGE_FOLDERS if (path / name).is_dir()]
    listings = ([f"{folder}{name}" for name in list_images(path / folder)] for folder in (*folders, ""))
    names = next(filter(None, listings), [])
    names = [name for name in names if not is_in_masks(PurePosixPath(name))]
    depth_maps = depth_maps_among(path, names)
    depths = len(depth_maps) if len(names) > len(depth_maps) or videos else 0
    found = [name for name in names if not (depths and name in depth_maps)]
    masks = masks_among([*found, *videos])
    found = [name for name in found if name not in masks]
    previews = previews_among([*found, *videos]) | textures_among(path, found)
    names = without_copies(path, [name for name in found if name not in previews])
    filmed = [name for name in videos if name not in previews]
    filmed = without_live_photos(path, filmed, found) if len(names) > 1 else filmed
    what = remedy = ""
    if not names and not videos:
        unreadable = list_images(path, FOREIGN_EXTENSIONS)
        what, remedy = "no photographs and no cameras found", "give the folder with the photographs"
        splats = list_images(path, (SPLAT_EXTENSION,))
        if len(splats) > 1 and not unreadable:
            what = f"only {quote_first(splats)}, and sequences of splats cannot be shown"
            remedy = "give the photographs or the video that they were made from"
        if unreadable:
            what = f"no photographs that can be read, only {quote_first(unreadable)}"
            remedy = way_round(Path(unreadable[0])) or "export them as JPEG, PNG or TIFF"
    if what:
        raise InputError(what, where=path, remedy=remedy)
    for name in (*names, *filmed):
        resolve_inside(path, name, where=path, root=path)
    names, filmed = without_repeats(path, names), without_repeats(path, filmed)
    copies = sorted({*found, *videos} - {*names, *filmed}, key=natural_key)
    return Material(path, tuple(names), tuple(filmed), depths, tuple(copies), tuple(sorted(masks, key=natural_key)))


def make_photographs(material: Material, workspace: Path, reporter: Reporter, size: int | None = None) -> Photographs:
    """The photographs as files that everything reads; frames and converted ones are written into `workspace`.

    Args:
        size: longer side in pixels that they are used in, by which frames are chosen; None for their own.

    Raises:
        InputError: a photograph or a video cannot be used.
        OSError: the disk is full.
    """
    kinds = {name: kind_of_file(material.folder / name) for name in material.photographs}
    if videos := [name for name, kind in kinds.items() if kind == "video"]:
        raise video_as_photograph(material.folder / videos[0])
    if not material.videos and not any(kind in _CONVERTED for kind in kinds.values()):
        folder, names = common_folder(material)
        originals = dict(zip(names, material.photographs, strict=True))
        warnings = [*_copies_warning(material), *_depth_warning(material, material.depths)]
        return Photographs(folder, names, originals=originals, warnings=warnings)
    made = Photographs(workspace, [], warnings=[*_copies_warning(material), *_frames_warning(material)])
    frames = _extract_frames(material, made, reporter, size)
    _convert_photographs(material, kinds, made, reporter)
    made.originals.update(zip(made.names, material.photographs, strict=True))
    made.originals.update((str(frame["name"]), str(frame["video"])) for frame in frames)
    made.names.extend(str(frame["name"]) for frame in frames)
    made.times.update((str(frame["name"]), float(frame["time"])) for frame in frames)
    text = json.dumps({"frames": frames}, indent=1, allow_nan=False)
    (workspace / FRAMES_FILE).write_text(text, encoding="utf-8")
    return made


def masks_of(material: Material) -> FoundMasks:
    """Masks of photographs, and of videos, all of whose frames have the video's; errors as for `find_masks`.

    A photograph also has the mask that is called after the same photograph in another format (1.JPG.png for 1.DNG).
    """
    again = in_other_formats(material.photographs, material.copies)
    names = (*material.photographs, *material.videos, *again)
    found = find_masks(material.folder, {name: material.folder / name for name in names})
    files: dict[str, Path] = {}
    for name, mask in found.files.items():  # those called after what is kept come first
        files.setdefault(again.get(name, name), mask)
    named = tuple(f"{folder}{os.sep}" for folder in found.misnamed)
    misplaced = [name for name in material.masks if not os.path.abspath(material.folder / name).startswith(named)]
    return replace(found, files=files, misplaced=misplaced)


def describe(material: Material) -> str:
    """What there is, in words."""
    photographs, videos = len(material.photographs), len(material.videos)
    parts = [f"{photographs:,} photograph{'s' if photographs > 1 else ''}"] if photographs else []
    parts += [f"{videos} video{'s' if videos > 1 else ''}"] if videos else []
    return " and ".join(parts)


def common_folder(material: Material) -> tuple[Path, list[str]]:
    """The folder ``images`` with the names in it, where all photographs are there."""
    for inside in IMAGE_FOLDERS:
        if all(name.startswith(f"{inside}/") for name in material.photographs):
            return material.folder / inside, [name.removeprefix(f"{inside}/") for name in material.photographs]
    return material.folder, list(material.photographs)


def _extract_frames(
    material: Material, made: Photographs, reporter: Reporter, size: int | None
) -> list[dict[str, str | float]]:
    looks: list[Look] = []
    count = len(material.videos)
    for number, name in enumerate(material.videos):
        reporter.status(STAGE, f"looking through {PurePosixPath(name).name}")

        def show(share: float, number: int = number) -> None:
            reporter.progress(STAGE, _LOOK_SHARE * (number + share) / count, "looking through the video")

        looks.append(look_through(material.folder / name, show))
        for warning in _warnings_about(name, looks[-1]):
            made.warnings.append(warning)
            reporter.status(STAGE, warning.message)  # the warnings come at the end, which may be a refusal
    chosen = choose([look.film for look in looks], size=size)
    _require_movement(material, [len(look.film.frames) for look in looks], [len(frames) for frames in chosen])
    bright = [look.white for look in looks if look.transfer]
    total = max(sum(map(len, chosen)), 1)
    frames: list[dict[str, str | float]] = []
    keys = make_keys(material.videos) if count > 1 else [PurePosixPath(name).stem for name in material.videos]
    folders = _folders_for_frames(make_keys([f"{key}.mp4" for key in keys]), material.photographs)
    for name, folder, look, wanted in zip(material.videos, folders, looks, chosen, strict=True):
        before = len(frames)
        reporter.status(STAGE, f"taking {len(wanted)} of {len(look.film.frames):,} frames of {look.path.name}")

        def show_frames(share: float, before: int = before, some: int = len(wanted)) -> None:
            share = _LOOK_SHARE + (1.0 - _LOOK_SHARE) * (before + share * some) / total
            reporter.progress(STAGE, share, "taking frames")

        white = median(bright) if bright else 0.0
        written = extract(look, wanted, made.folder / folder, white, show_frames)
        frames += [{"name": f"{folder}/{file}", "time": round(time, 4), "video": name} for file, time in written]
    return frames


def _require_movement(material: Material, filmed: Sequence[int], chosen: Sequence[int]) -> None:
    """Refuse videos of which too few frames, as many as are `chosen` of those `filmed`, show something new."""
    photographs, taken = len(material.photographs), sum(chosen)
    if photographs + taken >= min(_FEWEST_WITH_VIDEOS, photographs + sum(filmed)):
        return
    some = f"{taken} of its frames show" if taken > 1 else "one of its frames shows"
    what = f"the video hardly moves; only {some} something new"
    raise InputError(what, where=material.folder / material.videos[0], remedy="walk around the scene while filming")


def _folders_for_frames(wanted: Sequence[str], photographs: Sequence[str]) -> list[str]:
    """`wanted` where no photograph lies in a folder of that name; the frames of walk.mp4 must not meet walk/1.jpg."""
    taken = {PurePosixPath(name).parts[0].lower() for name in (FRAMES_FILE, *photographs)}
    folders = []
    for folder in wanted:
        while folder.lower() in taken:
            folder += "-frames"
        taken.add(folder.lower())
        folders.append(folder)
    return folders


def _warnings_about(name: str, look: Look) -> Iterator[CaptureWarning]:
    """`name` is the video's in the material, since the folder may be one that a zip was unpacked into."""
    if look.cut_at is not None:
        what = f"{name}: the video breaks off after {look.cut_at:.1f} s; what is there is used"
        yield CaptureWarning("video-cut", what)
    if look.is_shortened:
        what = f"{name}: only the first {MAX_SECONDS / 60:.0f} minutes of the video are used"
        yield CaptureWarning("video-long", what)
    if look.transfer:
        what = f"{name}: HDR video ({look.transfer.upper()}), brought into the range of sRGB"
        yield CaptureWarning("video-hdr", what)
    if look.is_log:
        what = f"{name}: log video, as it seems, which is used as it is: its colours are dull. {_GRADE}"
        yield CaptureWarning("video-log", what)


def _convert_photographs(material: Material, kinds: dict[str, str], made: Photographs, reporter: Reporter) -> None:
    if not material.photographs:
        made.warnings.extend(_depth_warning(material, material.depths))
        return
    reporter.status(STAGE, f"converting {len(material.photographs)} photographs")
    development = Development.common([material.folder / name for name in material.photographs])
    taken = set(material.photographs)
    headers: list[HeifHeader] = []
    for done, name in enumerate(material.photographs):
        source, kind = material.folder / name, kinds[name]
        if kind in _CONVERTED:
            name = _free_name(name, taken)
            if kind == "raw":
                exif = exif_of_raw(source)
            else:
                headers.append(read_heif_header(source, kind))
                exif = headers[-1].exif
            _write_jpeg(made.folder / name, source, exif, development)
        else:
            _link(source, made.folder / name)
        made.names.append(name)
        reporter.progress(STAGE, (done + 1) / len(material.photographs), f"photograph {done + 1}")
    made.warnings.extend(_warnings_about_photographs(material, headers))


def _warnings_about_photographs(material: Material, headers: Sequence[HeifHeader]) -> Iterator[CaptureWarning]:
    if gain_maps := sum(header.gain_map for header in headers):
        what = f"{material.folder}: the HDR gain maps of {gain_maps} photographs are not used"
        yield CaptureWarning("gain-map", what)
    if hdr := sum(bool(header.transfer) for header in headers):
        what = f"{material.folder}: {hdr} HDR photographs (PQ or HLG), brought into the range of sRGB"
        yield CaptureWarning("photograph-hdr", what)
    yield from _depth_warning(material, material.depths + sum(header.depth for header in headers))


def _copies_warning(material: Material) -> list[CaptureWarning]:
    if not material.copies:
        return []
    what = f"{material.folder}: files that show photographs once more are left out: {quote_first(material.copies)}"
    return [CaptureWarning("copies", what)]


def _frames_warning(material: Material) -> list[CaptureWarning]:
    frames = frames_among(material.folder, material.photographs, material.videos) if material.videos else []
    what = f"{len(frames)} photographs seem to be frames of a video beside them: {quote_first(frames)}"
    remedy = "give one of the two, or they count twice"
    return [CaptureWarning("video-frames", f"{material.folder}: {what}; {remedy}")] if frames else []


def _depth_warning(material: Material, count: int) -> list[CaptureWarning]:
    if not count:
        return []
    what = f"{material.folder}: {count} depth maps are not used; depths are found from the photographs"
    return [CaptureWarning("depth-maps", what)]


def _free_name(name: str, taken: set[str]) -> str:
    """`name` as a JPEG's, unlike all others also where case does not count: img_1.JPG may lie beside IMG_1.HEIC."""
    path = PurePosixPath(name)
    wanted = path.with_suffix(".jpg").as_posix()
    if wanted in taken or wanted.lower() in {other.lower() for other in taken}:
        wanted = path.with_name(f"{path.name}.jpg").as_posix()
    taken.add(wanted)
    return wanted


def _write_jpeg(path: Path, source: Path, exif: bytes, development: Development | None) -> None:
    color, _ = read_pixels(source, upright=True, development=development)
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(color).save(path, "JPEG", quality=_QUALITY, subsampling=0, exif=exif_for_jpeg(exif))


def _link(source: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    try:
        os.link(source.resolve(), target)
    except OSError:  # another disk; what is there already is refused again
        with open(source, "rb") as original, open(target, "xb") as copy:
            shutil.copyfileobj(original, copy)
