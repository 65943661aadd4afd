"""Whether estimated cameras suffice, what to say of photographs without a place, and a picture of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from math import ceil
from pathlib import Path
from statistics import median

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..files.untrusted import is_file, read_json
from .files import FRAMES_FILE, quote_first, resolve_inside
from .images import apply_orientation, read_header, read_pixels
from .scaling import downscale, fit_size
from .sfm_job import Placed

_LEAST_SHARE = 1 / 3  # of the photographs, below which a model is of a corner, or wrong
_FEW = 6  # photographs, up to which that is two
_NAMED = 3  # passages of a film that are named
_THUMBNAIL, _FRAME, _COLUMNS, _MOST_SHOWN = 120, 5, 10, 200  # the first two in pixels
_LEFT_OUT = np.array([213, 94, 0], np.uint8)  # vermilion of Okabe and Ito, which every colour vision tells from grey
_GROUND = 32
_AGAIN = "photograph again in small steps, so that neighbours show two thirds of the same, or give the cameras"


@dataclass(frozen=True)
class Frame:
    """When a video showed a photograph.

    Attributes:
        time: in seconds.
        video: the file's name.
    """

    time: float
    video: str


def frames_file(folder: Path, root: Path | None = None) -> Path | None:
    """The `FRAMES_FILE` in `folder` or, inside of the capture folder `root`, beside it; None without one.

    Raises:
        InputError: it is a link out of the capture folder.
    """
    is_below = root is not None and folder != root and folder.is_relative_to(root)
    places = (folder, folder.parent) if is_below else (folder,)
    place = next((place for place in places if is_file(place / FRAMES_FILE)), None)
    return place and resolve_inside(place, FRAMES_FILE, where=place, root=places[-1])


def read_frames(folder: Path, root: Path | None = None) -> dict[str, Frame]:
    """The frames of videos in `folder` by name, from its `frames_file`; none without one.

    Raises:
        InputError: the file is damaged, cannot be read, or is a link out of the capture folder.
    """
    file = frames_file(folder, root)
    if file is None:
        return {}
    remedy = f"remove {FRAMES_FILE}, or extract the frames again"
    document = read_json(file, remedy=remedy)
    try:
        listed = document["frames"]
        found = {str(entry["name"]): Frame(float(entry["time"]), str(entry["video"])) for entry in listed}
    except (ValueError, TypeError, KeyError, OverflowError):
        raise InputError("is no list of a video's frames", where=file, remedy=remedy) from None
    if not all(np.isfinite(frame.time) for frame in found.values()):
        raise InputError("has a time that is no number", where=file, remedy=remedy)
    return found


def require_enough(placed: Placed, names: Sequence[str], folder: Path) -> None:
    """Refuse cameras that would make no scene.

    Raises:
        InputError: with what to photograph instead.
    """
    count, found = len(names), len(placed.names)
    if found >= max(2, 0 if count <= _FEW else ceil(_LEAST_SHARE * count)):
        return
    if found < 2 and placed.matched and median(placed.matched) >= min(2, count - 1):
        what = "the photographs show the same, but not from places different enough to estimate cameras"
        remedy = "take a step to the side between photographs, turning on the spot shows no depth; or give the cameras"
        raise InputError(what, where=folder, remedy=remedy)
    if found < 2:
        what = "no cameras could be estimated from the photographs, for too few show the same from different places"
        raise InputError(what, where=folder, remedy=_AGAIN)
    lonely = [name for name, partners in zip(names, placed.matched, strict=True) if not partners]
    detail = f"; {len(lonely)} show nothing that another shows: {quote_first(lonely)}" if lonely else ""
    raise InputError(f"only {found} of {count} photographs could be connected{detail}", where=folder, remedy=_AGAIN)


def say_left_out(placed: Placed, names: Sequence[str], frames: Mapping[str, Frame]) -> str:
    """A line on the photographs that have no place; empty where all have one."""
    with_place = set(placed.names)
    left_out = [name for name in names if name not in with_place]
    if not left_out:
        return ""
    noun = "frames" if all(name in frames for name in names) else "photographs"
    said = f"{len(with_place)} of {len(names)} {noun} could be connected"
    if noun == "photographs":
        return f"{said}; without a place, and left out: {quote_first(left_out)}"
    return f"{said}; film more slowly at {_passages(names, with_place, frames)}"


def _passages(names: Sequence[str], with_place: set[str], frames: Mapping[str, Frame]) -> str:
    """The longest passages of the film without a place, e.g. ``0:12-0:15``, in order."""
    several = len({frame.video for frame in frames.values()}) > 1
    runs = []
    for (video, has_place), run in groupby(names, key=lambda name: (frames[name].video, name in with_place)):
        times = [frames[name].time for name in run]
        if not has_place:
            runs.append((times[-1] - times[0], video, times[0], times[-1]))
    longest = sorted(sorted(runs, reverse=True)[:_NAMED], key=lambda run: run[1:])
    return ", ".join(
        _span(first, ceil(last)) + (f" of {video}" if several else "") for _, video, first, last in longest
    )


def _span(first: float, last: float) -> str:
    return "-".join(dict.fromkeys((_clock(first), _clock(last))))


def _clock(seconds: float) -> str:
    return f"{int(seconds) // 60}:{int(seconds) % 60:02d}"


def contact_sheet(photographs: Sequence[tuple[Path, Path]], with_place: Sequence[bool]) -> NDArray[np.uint8]:
    """(H, W, 3) small pictures in rows; those without a place are dimmed in a vermilion frame.

    Args:
        photographs: of each, a file with its pixels and one with its EXIF orientation.
        with_place: of each, whether it has one.
    """
    step = max(1, ceil(len(photographs) / _MOST_SHOWN))
    shown = list(zip(photographs, with_place, strict=True))[::step]
    cells = [_cell(*files, has_place) for files, has_place in shown]
    columns = min(_COLUMNS, len(cells))
    side = _THUMBNAIL + 2 * _FRAME
    # Wide photographs leave no empty bands: rows are as high as their highest picture.
    rows = []
    for start in range(0, len(cells), columns):
        row = cells[start : start + columns]
        band = np.full((max(cell.shape[0] for cell in row), columns * side, 3), _GROUND, np.uint8)
        for column, cell in enumerate(row):
            top, left = (band.shape[0] - cell.shape[0]) // 2, column * side + (side - cell.shape[1]) // 2
            band[top : top + cell.shape[0], left : left + cell.shape[1]] = cell
        rows.append(band)
    return np.concatenate(rows)


def _cell(pixels: Path, header: Path, has_place: bool) -> NDArray[np.uint8]:
    image, _ = read_pixels(pixels)
    image = downscale(image, *fit_size(image.shape[1], image.shape[0], _THUMBNAIL))
    image = apply_orientation(image, read_header(header).orientation)
    if not has_place:
        image = image // np.uint8(2)
    cell = np.full((image.shape[0] + 2 * _FRAME, image.shape[1] + 2 * _FRAME, 3), _GROUND, np.uint8)
    if not has_place:
        cell[1:-1, 1:-1] = _LEFT_OUT
    cell[_FRAME:-_FRAME, _FRAME:-_FRAME] = image
    return cell
