"""The arguments of each kind of task. Standard library only.

``FramesArguments.from_dict(task.arguments)`` reads it back; paths are those of `task`: relative to OUT, or absolute.
A sequence is a folder with the pictures ``0001.png``, ``0002.png`` and so on, as Blender numbers them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, Self

from ..runs.layout import ORIGINAL


@dataclass(frozen=True)
class _Arguments:
    def to_dict(self) -> dict[str, Any]:
        """A JSON-ready dictionary; `from_dict` reads it back."""
        return dict(vars(self))

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """The arguments of `to_dict`.

        Raises:
            TypeError: they are of another kind.
        """
        return cls(**{name: tuple(value) if isinstance(value, list) else value for name, value in values.items()})


@dataclass(frozen=True)
class Orbit:
    """A camera's way around the subject.

    Attributes:
        radius: from the axis in scene units; 0: as far as the photographs were taken from.
        height: above the subject's centre, as a share of the radius; None: as high as the photographs were taken from.
        focal_length: in millimetres for a sensor 36 mm wide; 0: that of the photographs.
        arc: in degrees; 360 goes all the way around, less swings to and fro; 0: as far around as the photographs go.
    """

    radius: float = 0.0
    height: float | None = None
    focal_length: float = 0.0
    arc: float = 0.0


@dataclass(frozen=True)
class CameraPath(Orbit):
    """A camera of a batch; its name becomes part of file names."""

    name: str = "turn"


@dataclass(frozen=True)
class TrainArguments(_Arguments):
    """How to make a run.

    Attributes:
        settings: `Settings.to_dict()` without its layers; ``out`` is the run's folder.
        layers: those that are made along with it, as in `Settings.to_dict()`. They do not make it another run: those
            that it lacks are added by tasks of their own.
    """

    settings: Mapping[str, Any]
    layers: tuple[Mapping[str, Any], ...]


@dataclass(frozen=True)
class LayerArguments(_Arguments):
    """How to add a layer to a run.

    Attributes:
        settings: `Settings.to_dict()` of the addition, with ``resume`` and one layer; ``out`` is the run's folder.
        source: a finished run outside of OUT that is copied into the run's folder first, so that it stays as it is;
            "" where the run is made by the batch.
    """

    settings: Mapping[str, Any]
    source: str = ""


@dataclass(frozen=True, kw_only=True)
class FramesArguments(_Arguments, Orbit):
    """Which frames of which turntable to render, on which orbit.

    Attributes:
        run: folder of the finished run.
        layer: in whose colours; `ORIGINAL` for the scene's own.
        engine: "cycles" or "eevee".
        folder: of the sequence.
        first, last: numbers of the pictures to render, both included, from 1 to `frames`.
        frames: pictures of a whole turn.
        width, height_pixels: of the pictures.
        simulated: folder of a sequence that shows the same pictures as an observer sees them, by the observer's layer
            name (``deutan-1.0``); empty for none.
        model: that these are simulated by; "" where there are none.
    """

    run: str
    layer: str
    engine: str
    folder: str
    first: int
    last: int
    frames: int
    width: int
    height_pixels: int
    simulated: Mapping[str, str]
    model: str

    @classmethod
    def on(cls, orbit: Orbit, **others: Any) -> Self:
        """The request for frames on `orbit`."""
        return cls(**{entry.name: getattr(orbit, entry.name) for entry in fields(Orbit)}, **others)


@dataclass(frozen=True)
class VideoArguments(_Arguments):
    """Which pictures make a video.

    Attributes:
        sequences: folders, side by side from left to right.
        frames: pictures of each.
        frames_per_second: of the video.
        file: the MP4.
        captions: what stands above each sequence; "" for nothing.
    """

    sequences: tuple[str, ...]
    frames: int
    frames_per_second: int
    file: str
    captions: tuple[str, ...]


@dataclass(frozen=True)
class SheetArguments(_Arguments):
    """What a contact sheet shows.

    Attributes:
        title: said at the top.
        rows: sequences from top to bottom, each with ``label``, ``folder`` and ``frames``.
        columns: pictures a row, evenly spread over the turn.
        file: the PNG.
    """

    title: str
    rows: tuple[Mapping[str, Any], ...]
    columns: int
    file: str


@dataclass(frozen=True)
class PageArguments(_Arguments):
    """What the page of a batch shows; whatever is missing there belongs to something that failed.

    Attributes:
        title: of the batch.
        items: each with ``name``, ``run`` (folder of its run, with report.json), ``sheet`` (PNG or null) and
            ``turntables``: a list with ``layer``, ``engine``, ``camera`` (its name in the batch file), ``folder``,
            ``frames``, ``frames_per_second``, ``simulated`` (folder by observer), ``video`` (MP4 or null) and
            ``side_by_side`` (MP4 by observer).
        file: the HTML file.
    """

    title: str
    items: tuple[Mapping[str, Any], ...]
    file: str


def vision(observer: str) -> str:
    """An observer, by a layer's name, in words: ``deutan vision``, ``protan vision of severity 0.6``."""
    cvd, _, severity = observer.partition("-")
    return f"{cvd} vision" if severity == "1.0" else f"{cvd} vision of severity {severity}"


def seen_by(what: str, observer: str) -> str:
    """What the picture `what` is called where it shows what an observer sees of it."""
    return f"{what}, as {vision(observer)} sees it"


def beside_each_other(layer: str, observer: str) -> tuple[str, str]:
    """Captions of a layer's pictures and, beside them, of what an observer sees of them."""
    what = "Original" if layer == ORIGINAL else "Enhanced"
    return what, seen_by(what, observer)
