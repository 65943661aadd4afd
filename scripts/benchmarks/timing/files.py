"""How long files of many Gaussians and points take to write, to read, and to import into Blender.

Command: ``benchmark.py files``.
"""

from __future__ import annotations

import argparse
import struct
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import count
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ....core.capture.colmap_files import read_model
from ....core.errors import InputError
from ....core.runtime.cli import ConsoleReporter
from ....core.runtime.process import Workers, blender_command
from ....core.runtime.protocol import Reporter
from ....core.runtime.supervisor import finish
from ....core.splats.io.files import SUFFIXES, read_gaussians, write_gaussians
from ....core.splats.raster.benchmark import random_gaussians
from ..options import Part, positive
from ..tables import frame_of, markdown_table, write_csv, write_text
from .blender_worker import PATH as BLENDER_TIMER

STAGE = "files"
WRITE, READ, ADD, EVALUATE = "write", "read", "add", "evaluate"
_SIZE = (1920, 1080)  # pixels of the view that the Gaussians fill
_PINHOLE = (1920.0, 1920.0, 960.0, 540.0)  # fx, fy, cx, cy of a model
_IMAGES = 3  # each sees every point of the model
_POINT = np.dtype(
    [
        ("id", "<u8"),
        ("position", "<f8", 3),
        ("color", "u1", 3),
        ("error", "<f8"),
        ("track_length", "<u8"),
        ("track", "<u4", (_IMAGES, 2)),
    ]
)


@dataclass(frozen=True)
class FileTiming:
    """One timed action.

    Attributes:
        round: its number.
        file: the format, or "Blender".
        action: `WRITE`, `READ`; in Blender `READ` a PLY, `ADD` it to the scene, `EVALUATE` it for the viewport.
        megabytes: of the file.
        seconds: wall time.
    """

    round: int
    file: str
    action: str
    megabytes: float
    seconds: float


def time_files(gaussians: int, points: int, rounds: int, reporter: Reporter) -> list[FileTiming]:
    """Write and read Gaussians in every format, read COLMAP models, and bring the Gaussians into Blender.

    Files are read right after they were written, so from memory rather than from disk.

    Args:
        gaussians: in a file, of SH degree 0.
        points: of a model, each seen by three images.
        reporter: receives a warning if there is no Blender.
    """
    scene = random_gaussians(gaussians, *_SIZE)
    found = []
    with tempfile.TemporaryDirectory() as scratch:
        files = [Path(scratch) / f"scene{suffix}" for suffix in SUFFIXES]
        models = {form: Path(scratch) / form for form in ("binary", "text")}
        for form, folder in models.items():
            write_model(folder, points, text=form == "text")
        for turn in range(1, rounds + 1):
            for path in files:
                written = _seconds(partial(write_gaussians, path, scene))
                found.append(FileTiming(turn, path.suffix, WRITE, _megabytes(path), written))
                found.append(
                    FileTiming(turn, path.suffix, READ, _megabytes(path), _seconds(partial(read_gaussians, path)))
                )
            for form, folder in models.items():
                size = _megabytes(*folder.iterdir())
                found.append(FileTiming(turn, f"COLMAP, {form}", READ, size, _seconds(partial(read_model, folder))))
            reporter.progress(STAGE, turn / (rounds + 1), f"round {turn} of {rounds}")
        try:
            found += _in_blender(files[0], rounds)
        except InputError as error:
            reporter.warning("no-blender", f"{error}: Blender is left out")
    return found


def write_file_times(folder: Path, gaussians: int, points: int, found: list[FileTiming]) -> str:
    """Write ``files.csv`` and ``files.md``; returns the text of the latter."""
    times = frame_of(FileTiming, found)
    write_csv(folder / "files.csv", times)
    actions = [WRITE, READ, ADD, EVALUATE]
    medians = times.pivot_table(index="file", columns="action", values="seconds", aggfunc="median", sort=False)
    table = medians.reindex(columns=actions).assign(megabytes=times.groupby("file").megabytes.first()).reset_index()
    rounds = times["round"].max()
    lines = [
        f"{gaussians:,} Gaussians of SH degree 0; COLMAP models of {points:,} points. Seconds, medians of {rounds}:",
        "",
        *markdown_table(
            table, [("file", "file", ""), ("megabytes", "MB", ".0f"), *((name, name, ".2f") for name in actions)]
        ),
    ]
    return write_text(folder / "files.md", lines)


def _in_blender(file: Path, rounds: int) -> list[FileTiming]:
    """Import the PLY file `file` into an empty scene, in one Blender process."""
    request = {"job": "time-import", "out": str(file.parent), "arguments": {"file": file.name, "rounds": rounds}}
    job = Workers().start_command(blender_command([], BLENDER_TIMER), request)
    return [
        FileTiming(turn, "Blender", action, _megabytes(file), seconds)
        for turn, times in enumerate(finish(job, lambda _: None)["rounds"], start=1)
        for action, seconds in times.items()
    ]


def _seconds(work: Callable[[], object]) -> float:
    started = time.perf_counter()
    work()
    return time.perf_counter() - started


def _megabytes(*paths: Path) -> float:
    return sum(path.stat().st_size for path in paths) / 1e6


def write_model(folder: Path, points: int, *, text: bool) -> None:
    """Write a COLMAP model with one camera, and `_IMAGES` images that see all of its points."""
    folder.mkdir()
    rng = np.random.default_rng(0)
    positions, colors = rng.normal(size=(points, 3)), rng.integers(0, 256, (points, 3), np.uint8)
    if text:
        _write_text(folder, positions, colors)
    else:
        _write_binary(folder, positions, colors)


def _write_text(folder: Path, positions: NDArray[np.float64], colors: NDArray[np.uint8]) -> None:
    tracks = " ".join(f"{image} 0" for image in range(1, _IMAGES + 1))
    lines = {
        "cameras": ["1 PINHOLE " + " ".join(map(str, (*_SIZE, *_PINHOLE))) + "\n"],
        "images": [f"{image} 1 0 0 0 {image} 0 0 1 {image}.png\n\n" for image in range(1, _IMAGES + 1)],
        "points3D": (
            f"{number} {x:.6f} {y:.6f} {z:.6f} {red} {green} {blue} 0.5 {tracks}\n"
            for number, (x, y, z), (red, green, blue) in zip(
                count(1), positions.tolist(), colors.tolist(), strict=False
            )
        ),
    }
    for name, content in lines.items():
        with open(folder / f"{name}.txt", "w", encoding="ascii") as file:
            file.writelines(content)


def _write_binary(folder: Path, positions: NDArray[np.float64], colors: NDArray[np.uint8]) -> None:
    points = np.zeros(len(positions), _POINT)
    points["id"] = np.arange(1, len(positions) + 1)
    points["position"], points["color"], points["error"] = positions, colors, 0.5
    points["track_length"] = _IMAGES
    points["track"][:, :, 0] = np.arange(1, _IMAGES + 1)
    images = [
        struct.pack("<I7dI", image, 1, 0, 0, 0, image, 0, 0, 1) + f"{image}.png\0".encode() + bytes(8)
        for image in range(1, _IMAGES + 1)
    ]
    (folder / "cameras.bin").write_bytes(struct.pack("<QIiQQ4d", 1, 1, 1, *_SIZE, *_PINHOLE))
    (folder / "images.bin").write_bytes(struct.pack("<Q", _IMAGES) + b"".join(images))
    (folder / "points3D.bin").write_bytes(struct.pack("<Q", len(points)) + points.tobytes())


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--gaussians", type=positive, default=1_000_000, metavar="N", help="Gaussians in a file (1000000)")
    add("--points", type=positive, default=1_000_000, metavar="N", help="points of a COLMAP model (1000000)")
    add("--rounds", type=positive, default=5, metavar="N", help="repetitions; medians are reported (5)")


def _measure(options: argparse.Namespace) -> str:
    """Write and read files, and import one into Blender; writes files.csv and files.md."""
    found = time_files(options.gaussians, options.points, options.rounds, ConsoleReporter(sys.stderr))
    return write_file_times(options.out, options.gaussians, options.points, found)


PART = Part("files", "many Gaussians and points in and out of files, and into Blender", _add_arguments, _measure)
