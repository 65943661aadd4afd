"""Looks at the capture that the user has picked: a worker reads it in the background, the panel shows what it found."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import bpy

from ..core.runtime.process import Workers
from ..core.runtime.supervisor import Listener, finish
from .activity import ACTIVITY, scene_by_uid
from .background import BackgroundJob, State
from .environment import make_workers
from .folders import normalised_folder
from .pictures import PICTURES
from .preferences import get_cache

JOB = "inspect"
_THUMBNAILS = 4
_THUMBNAIL_SIZE = 256  # pixels of the longer side; a side bar of usual width shows a square of about 120


@dataclass(frozen=True)
class Inspection:
    """What a worker found in a folder.

    Attributes:
        folder, cameras: where it looked, and where cameras come from.
        format: where the cameras come from.
        views: usable photographs.
        sizes: (width, height, count), most frequent first.
        points: sparse points.
        warnings: one line each.
        thumbnails: paths of small pictures.
        videos: whose frames become photographs, and `seconds` of them all.
    """

    folder: str
    cameras: str
    format: str
    views: int
    sizes: tuple[tuple[int, int, int], ...]
    points: int
    warnings: tuple[str, ...]
    thumbnails: tuple[Path, ...]
    videos: int
    seconds: float


def inspect(folder: str, cameras: str, thumbnails: Path, workers: Workers, listen: Listener) -> Inspection:
    """Let a worker look at the capture in `folder`.

    Args:
        cameras: as ``--cameras``.
        thumbnails: where small pictures are written.

    Raises:
        InputError: the folder cannot be used, or there is no worker.
    """
    pictures = {"folder": str(thumbnails), "count": _THUMBNAILS, "size": _THUMBNAIL_SIZE}
    request = {"job": "inspect", "capture": folder, "cameras": cameras, "thumbnails": pictures}
    result = finish(workers.start(request), listen)
    summary = result["summary"]
    return Inspection(
        folder,
        cameras,
        summary["format"],
        summary["views"],
        tuple((width, height, count) for width, height, count in summary["sizes"]),
        summary["points"],
        tuple(warning["message"] for warning in summary["warnings"]),
        tuple(Path(path) for path in result["thumbnails"]),
        summary["videos"],
        summary["seconds"],
    )


def start_inspection(scene: bpy.types.Scene) -> None:
    """Inspect the folder of `scene` in the background; an empty one is forgotten."""
    _clear(scene)
    ACTIVITY.drop(JOB)
    if scene.cvdgs.capture.folder:
        folder, cameras = _asked_for(scene)
        work = partial(inspect, folder, cameras, get_cache().thumbnails(folder))
        job = BackgroundJob("Inspecting the capture", work, make_workers(), ("start",))
        ACTIVITY.start(JOB, job, partial(_take_over, scene.session_uid, (folder, cameras)), ends_with_file=True)


def inspect_now(scene: bpy.types.Scene) -> None:
    """Inspect the folder of `scene` and wait for it; for scripts.

    Raises:
        InputError: it cannot be used.
    """
    _clear(scene)
    folder, cameras = _asked_for(scene)
    _fill(scene, inspect(folder, cameras, get_cache().thumbnails(folder), make_workers(), lambda _: None))


def catch_up(scene: bpy.types.Scene) -> None:
    """Know the folder of `scene` again, where the file goes back to a time when nobody had looked into it.

    What an inspection finds is no step of the undo history: nobody wants to undo that.
    """
    capture = scene.cvdgs.capture
    if not capture.folder or capture.inspected or capture.problem:
        return
    last = ACTIVITY.job(JOB)
    found = last.result if last is not None else None
    if isinstance(found, Inspection) and (found.folder, found.cameras) == _asked_for(scene):
        _fill(scene, found)
    else:
        start_inspection(scene)


def thumbnail_key(folder: str, number: int) -> str:
    """Under which `PICTURES` has a photograph of a capture."""
    return f"capture {number} {folder}"


def thumbnails_of(capture: bpy.types.PropertyGroup) -> list[str]:
    """Keys of the pictures of an inspected capture; loads those of an earlier session from the cache."""
    folder = capture.inspected
    keys = [thumbnail_key(folder, number) for number in range(_THUMBNAILS)]
    for number, key in enumerate(keys):
        if key not in PICTURES:
            PICTURES.load(key, get_cache().thumbnails(folder) / f"{number}.png", square=True)
    return [key for key in keys if key in PICTURES]


def _asked_for(scene: bpy.types.Scene) -> tuple[str, str]:
    """The folder that is picked, in full, and where its cameras come from."""
    capture = scene.cvdgs.capture
    return normalised_folder(capture.folder), capture.cameras.lower()


def _take_over(scene_uid: int, asked: tuple[str, str], job: BackgroundJob) -> None:
    scene = scene_by_uid(scene_uid)
    if scene is None or job.state is State.CANCELLED:
        return
    if _asked_for(scene) != asked:
        return  # undo has brought another folder back
    if job.state is State.FAILED:
        scene.cvdgs.capture.problem = job.problem
    else:
        _fill(scene, job.result)


def _clear(scene: bpy.types.Scene) -> None:
    capture = scene.cvdgs.capture
    capture.inspected = capture.format = capture.sizes = capture.warnings = capture.problem = ""
    capture.views = capture.points = capture.width = capture.height = capture.videos = 0
    capture.seconds = 0.0


def _fill(scene: bpy.types.Scene, found: Inspection) -> None:
    capture = scene.cvdgs.capture
    capture.inspected, capture.format = found.folder, found.format
    capture.views, capture.points = found.views, found.points
    capture.videos, capture.seconds = found.videos, found.seconds
    capture.width, capture.height = found.sizes[0][:2]
    capture.sizes = ", ".join(f"{width} × {height}" for width, height, _ in found.sizes)
    capture.warnings = "\n".join(found.warnings)
    for number, path in enumerate(found.thumbnails):
        PICTURES.load(thumbnail_key(found.folder, number), path, square=True)
