"""What a batch is: objects of a collection, and how each is shown. Standard library only."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any

from ..capture.files import capture_root, list_images
from ..files.untrusted import is_file, is_folder
from ..rendering.requests import CameraPath
from ..runs.layout import MASKS_FOLDER, ORIGINAL
from ..settings import AUTO, CVD_TYPES, ESTIMATE, GIVEN, WEIGHTS_SUFFIX, Layer

_LAYER = re.compile(rf"({'|'.join(CVD_TYPES)})(?:-([0-9.]+))?")


class Output(StrEnum):
    """What is made of an item."""

    FRAMES = "frames"
    SIMULATED = "simulated"
    """The same frames as the layer's observer sees them."""
    VIDEO = "video"
    SIDE_BY_SIDE = "side-by-side"
    """A video of the frames beside the simulated ones."""
    CONTACT_SHEET = "contact-sheet"
    PAGE = "page"
    """The item is shown on the batch's page."""


@dataclass(frozen=True)
class TurntableSettings:
    """How an item is shown.

    Attributes:
        frames: pictures of a turn.
        frames_per_second: of videos.
        size: width and height of the pictures in pixels.
        engines: that render.
        chunk: pictures that one task renders; the scene is loaded once for them.
    """

    frames: int = 96
    frames_per_second: int = 24
    size: tuple[int, int] = (640, 480)
    engines: tuple[str, ...] = ("cycles",)
    chunk: int = 24


@dataclass(frozen=True)
class Needs:
    """What a task may take of a machine; one that has less gives it all that it has.

    Attributes:
        train_cores, train_memory_mb: for a run and for its layers.
        frame_cores, frame_memory_mb: for a chunk of frames.
    """

    train_cores: int = 4
    train_memory_mb: int = 4096
    frame_cores: int = 1
    frame_memory_mb: int = 2048


@dataclass(frozen=True)
class Item:
    """An object of the collection.

    Attributes:
        name: in file names; unique.
        capture: what a run takes: photographs, a video, a zip, a camera file; absolute; None for a finished run.
        run: folder of a finished run, absolute; None for a capture.
        layers: in order; `ORIGINAL` is the scene's own colours.
        present: layers that a finished run has already.
        train: options of a run, by their names in `Settings`.
    """

    name: str
    capture: Path | None
    run: Path | None
    layers: tuple[str, ...]
    present: tuple[str, ...]
    cameras: tuple[CameraPath, ...]
    turntable: TurntableSettings
    train: Mapping[str, Any]
    outputs: frozenset[Output]

    @property
    def source(self) -> Path:
        """What the item is made from: a folder, a video or a zip."""
        path = self.capture or self.run
        assert path is not None
        if path.suffix.lower() == ".json" and is_file(path):
            return path.parent
        # A model's own folder, whose photographs lie elsewhere in the capture.
        return capture_root(path) if any(is_file(path / name) for name in ("cameras.bin", "cameras.txt")) else path

    @property
    def masks(self) -> list[Path]:
        """What may be the mask of a lone video; a folder holds its own."""
        beside = self.source.parent / MASKS_FOLDER
        if not is_file(self.source) or not is_folder(beside):
            return []
        return [beside / name for name in list_images(beside) if name.startswith(self.source.stem)]


@dataclass(frozen=True)
class Batch:
    """A whole batch.

    Attributes:
        title: of its page.
        items: at least one.
        retries: how often a failed task is tried again.
    """

    title: str
    items: tuple[Item, ...]
    retries: int = 1
    needs: Needs = field(default_factory=Needs)


def names_files(option: str, value: Any) -> bool:
    """Whether `value` of an option of a run, by its name in `Settings`, is the path of a file or a folder."""
    if option == "enhancer":
        return str(value).endswith(WEIGHTS_SUFFIX)
    return option == "cameras" and value not in ("", AUTO, ESTIMATE, GIVEN)


def layer_of(name: str) -> Layer | None:
    """The layer that the batch file calls `name`: ``deutan``, ``deutan-0.6``; None for `ORIGINAL`.

    Raises:
        ValueError: there is no such layer.
    """
    if name == ORIGINAL:
        return None
    found = _LAYER.fullmatch(name)
    severity = float(found[2] or 1.0) if found else -1.0
    if found is None or not 0.0 <= severity <= 1.0:
        raise ValueError(f"'{name}' is not a layer")
    return Layer(found[1], severity)
