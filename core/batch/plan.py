"""From a batch to its plan: the tasks of every item, in the order in which they may be done. Standard library only.

    OUT/index.html
    OUT/<item>/run/                                       the run, unless a finished one is taken as it is
    OUT/<item>/<layer>/<engine>-<camera>/frames/0001.png  and simulated-<observer>/0001.png beside it
    OUT/<item>/<layer>/<engine>-<camera>/turntable.mp4    and side-by-side-<observer>.mp4
    OUT/<item>/contact-sheet.png
    OUT/.batch/                                           plan, logs, records of what is done

The original colours are seen by the observers of all the item's layers, a layer by its own.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from ..rendering.frames import simulation_model
from ..rendering.requests import (
    CameraPath,
    FramesArguments,
    LayerArguments,
    PageArguments,
    SheetArguments,
    TrainArguments,
    VideoArguments,
    beside_each_other,
    seen_by,
)
from ..runs.layout import GAUSSIANS_FILE, ORIGINAL, REPORT_FILE, VIEWER_PAGE, layer_gaussians_file, pictures
from ..runs.report import CAMERAS
from ..settings import OPTIONS, Settings
from .model import Batch, Item, Needs, Output, layer_of, names_files
from .progress import (
    LAYER_ADDED_SECONDS,
    LAYER_KEPT_SECONDS,
    SHEET_SECONDS,
    frames_seconds,
    page_seconds,
    train_seconds,
    video_seconds,
)
from .task import Kind, Plan, Task

PAGE_FILE = "index.html"
_SHEET_COLUMNS = 8
_SMALL_MEMORY_MB = 512  # of a video, a contact sheet, a page


def make_plan(batch: Batch, out: Path, graphics_cards: int = 0) -> Plan:
    """The plan of `batch` in the folder `out`.

    Args:
        graphics_cards: of the machines that train; where there are some, training with the device "auto" takes one.
    """
    tasks: list[Task] = []
    shown = []
    for item in batch.items:
        planned = _PlannedItem(item, batch.needs, graphics_cards > 0)
        tasks += planned.tasks
        if Output.PAGE in item.outputs:
            shown.append(planned)
    if shown:
        tasks.append(_page(batch, shown))
    return Plan(out.absolute(), tuple(tasks), batch.retries)


def _page(batch: Batch, shown: Sequence[_PlannedItem]) -> Task:
    items = tuple(planned.entry for planned in shown)
    return Task(
        "page",
        Kind.PAGE,
        after=tuple(task.name for planned in shown for task in planned.tasks),
        arguments=PageArguments(batch.title, items, PAGE_FILE).to_dict(),
        inputs=tuple(name for planned in shown for name in planned.shown_files),
        outputs=(PAGE_FILE,),
        seconds=page_seconds(len(shown)),
        memory_mb=_SMALL_MEMORY_MB,
    )


@dataclass(frozen=True)
class _Turn:
    """One turntable: a layer, an engine, a camera."""

    item: Item
    layer: str
    engine: str
    camera: CameraPath

    @property
    def name(self) -> str:
        return f"{self.item.name}.{self.layer}.{self.engine}-{self.camera.name}"

    @property
    def folder(self) -> str:
        return f"{self.item.name}/{self.layer}/{self.engine}-{self.camera.name}"

    @property
    def frames(self) -> str:
        return f"{self.folder}/frames"

    @property
    def simulated(self) -> dict[str, str]:
        """Folder of a sequence by observer."""
        outputs = self.item.outputs
        if Output.SIMULATED not in outputs and Output.SIDE_BY_SIDE not in outputs:
            return {}
        layers = self.item.layers if self.layer == ORIGINAL else (self.layer,)
        return {layer: f"{self.folder}/simulated-{layer}" for layer in layers if layer != ORIGINAL}

    @property
    def video(self) -> str | None:
        return f"{self.folder}/turntable.mp4" if Output.VIDEO in self.item.outputs else None

    @property
    def side_by_side(self) -> dict[str, str]:
        """A video by observer."""
        if Output.SIDE_BY_SIDE not in self.item.outputs:
            return {}
        return {observer: f"{self.folder}/side-by-side-{observer}.mp4" for observer in self.simulated}


@dataclass
class _PlannedItem:
    """The tasks of an item.

    Attributes:
        tasks: in order.
    """

    item: Item
    needs: Needs
    has_graphics_card: bool
    tasks: list[Task] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.tasks += self._make_run()
        made = tuple(task.name for task in self.tasks)
        for turn in self.turns:
            chunks = list(self._chunks(turn, made))
            self.tasks += chunks
            self.tasks += self._videos(turn, tuple(task.name for task in chunks))
        if self.sheet is not None:
            frames = tuple(task.name for task in self.tasks if task.kind is Kind.FRAMES)
            self.tasks.append(self._sheet(self.sheet, frames))

    @property
    def turns(self) -> Iterator[_Turn]:
        item = self.item
        return (
            _Turn(item, layer, engine, camera)
            for layer in item.layers
            for engine in item.turntable.engines
            for camera in item.cameras
        )

    @cached_property
    def run(self) -> str:
        """Folder of the run: a finished one that lacks nothing, or the batch's own."""
        item = self.item
        return str(item.run) if item.run is not None and not self._missing else f"{item.name}/run"

    @cached_property
    def _missing(self) -> list[str]:
        """Layers that the item's run lacks."""
        return [layer for layer in self.item.layers if layer != ORIGINAL and layer not in self.item.present]

    @property
    def _model(self) -> str:
        """The one behind the run's simulations."""
        if self.item.run is not None:
            return simulation_model(self.item.run)
        return str(self.item.train.get("simulation", Settings.simulation))

    @property
    def sheet(self) -> str | None:
        return f"{self.item.name}/contact-sheet.png" if Output.CONTACT_SHEET in self.item.outputs else None

    @property
    def entry(self) -> dict[str, Any]:
        """The item's entry in the arguments of the page."""
        turntable = self.item.turntable
        turntables = [
            {
                "layer": turn.layer,
                "engine": turn.engine,
                "camera": turn.camera.name,
                "folder": turn.frames,
                "frames": turntable.frames,
                "frames_per_second": turntable.frames_per_second,
                "simulated": turn.simulated,
                "video": turn.video,
                "side_by_side": turn.side_by_side,
            }
            for turn in self.turns
        ]
        return {"name": self.item.name, "run": self.run, "sheet": self.sheet, "turntables": turntables}

    @property
    def shown_files(self) -> Iterator[str]:
        """Files that the page shows, where they are there."""
        frames = self.item.turntable.frames
        yield from (f"{self.run}/{name}" for name in (REPORT_FILE, VIEWER_PAGE))
        for turn in self.turns:
            for folder in (turn.frames, *turn.simulated.values()):
                yield pictures(folder, 1, frames)
            yield from filter(None, (turn.video, *turn.side_by_side.values()))
        yield from filter(None, (self.sheet,))

    def _make_run(self) -> Iterator[Task]:
        """The tasks that make the run, or add to it what it lacks; none for a finished one that lacks nothing."""
        item, name, run = self.item, self.item.name, self.run
        if not self._missing:
            return
        after: tuple[str, ...] = ()
        layers = [layer for layer in map(layer_of, self._missing) if layer is not None]
        if item.capture is not None:
            capture = str(item.capture)
            settings = Settings(capture, run, tuple(layers), blend=False, **item.train).to_dict()
            made_along = settings.pop("layers")
            yield self._worker_task(
                f"{name}.train",
                Kind.TRAIN,
                TrainArguments(settings, made_along).to_dict(),
                inputs=(str(item.source), *map(str, item.masks), *_files_of(item.train)),
                # Layers trained along with the run have tasks of their own: losing one costs no training.
                outputs=tuple(f"{run}/{file}" for file in (GAUSSIANS_FILE, CAMERAS)),
                seconds=train_seconds(item.train, len(layers)),
            )
            after = (f"{name}.train",)
        for index, layer in enumerate(layers):
            source = str(item.run) if item.run is not None and index == 0 else ""
            options = item.train if item.run is None else _layer_options(item.train)
            capture = str(item.capture) if item.run is None else f"{run}/{Path(CAMERAS).parent}"
            settings = Settings(capture, run, (layer,), blend=False, resume=True, **options).to_dict()
            copied = [GAUSSIANS_FILE, CAMERAS, *map(layer_gaussians_file, item.present)] if source else []
            yield self._worker_task(
                f"{name}.layer.{layer.name}",
                Kind.LAYER,
                LayerArguments(settings, source).to_dict(),
                inputs=(*(f"{source or run}/{file}" for file in copied or [GAUSSIANS_FILE]), *_files_of(options)),
                outputs=tuple(f"{run}/{file}" for file in (layer_gaussians_file(layer.name), *copied)),
                seconds=LAYER_ADDED_SECONDS if item.run else LAYER_KEPT_SECONDS,
                after=after,
            )
            after = (f"{name}.layer.{layer.name}",)  # one after the other: they write the same folder

    def _worker_task(self, name: str, kind: Kind, arguments: dict[str, Any], **others: Any) -> Task:
        device = self.item.train.get("device", Settings.device)
        return Task(
            name,
            kind,
            arguments=arguments,
            item=self.item.name,
            cores=self.needs.train_cores,
            memory_mb=self.needs.train_memory_mb,
            gpu=int(device == "cuda" or (device == "auto" and self.has_graphics_card)),
            **others,
        )

    def _chunks(self, turn: _Turn, after: tuple[str, ...]) -> Iterator[Task]:
        settings = self.item.turntable
        width, height_pixels = settings.size
        files = (GAUSSIANS_FILE, CAMERAS, *(() if turn.layer == ORIGINAL else (layer_gaussians_file(turn.layer),)))
        for first in range(1, settings.frames + 1, settings.chunk):
            last = min(first + settings.chunk - 1, settings.frames)
            arguments = FramesArguments.on(
                turn.camera,
                run=self.run,
                layer=turn.layer,
                engine=turn.engine,
                folder=turn.frames,
                first=first,
                last=last,
                frames=settings.frames,
                width=width,
                height_pixels=height_pixels,
                simulated=turn.simulated,
                model=self._model if turn.simulated else "",
            )
            folders = (turn.frames, *turn.simulated.values())
            yield Task(
                f"{turn.name}.frames.{first:04d}-{last:04d}",
                Kind.FRAMES,
                after=after,
                arguments=arguments.to_dict(),
                inputs=tuple(f"{self.run}/{file}" for file in files),
                outputs=tuple(pictures(folder, first, last) for folder in folders),
                item=self.item.name,
                seconds=frames_seconds(last - first + 1, settings.size, len(turn.simulated), self.needs.frame_cores),
                cores=self.needs.frame_cores,
                memory_mb=self.needs.frame_memory_mb,
            )

    def _videos(self, turn: _Turn, after: tuple[str, ...]) -> Iterator[Task]:
        if turn.video is not None:
            yield self._video(f"{turn.name}.video", {turn.frames: ""}, turn.video, after)
        for observer, file in turn.side_by_side.items():
            captions = beside_each_other(turn.layer, observer)
            sequences = dict(zip((turn.frames, turn.simulated[observer]), captions, strict=True))
            yield self._video(f"{turn.name}.side-by-side.{observer}", sequences, file, after)

    def _video(self, name: str, captioned: Mapping[str, str], file: str, after: tuple[str, ...]) -> Task:
        """A video of sequences side by side, each with its caption."""
        settings, sequences = self.item.turntable, tuple(captioned)
        return Task(
            name,
            Kind.VIDEO,
            after=after,
            arguments=VideoArguments(
                sequences, settings.frames, settings.frames_per_second, file, tuple(captioned.values())
            ).to_dict(),
            inputs=tuple(pictures(folder, 1, settings.frames) for folder in sequences),
            outputs=(file,),
            item=self.item.name,
            seconds=video_seconds(settings.frames, settings.size, len(sequences)),
            memory_mb=_SMALL_MEMORY_MB,
        )

    def _sheet(self, file: str, after: tuple[str, ...]) -> Task:
        rows: list[dict[str, Any]] = []
        frames = self.item.turntable.frames
        for turn in self.turns:
            where = self._label(turn)
            rows.append({"label": where, "folder": turn.frames, "frames": frames})
            for observer, folder in turn.simulated.items():
                rows.append({"label": seen_by(where, observer), "folder": folder, "frames": frames})
        return Task(
            f"{self.item.name}.contact-sheet",
            Kind.SHEET,
            after=after,
            arguments=SheetArguments(self.item.name, tuple(rows), min(_SHEET_COLUMNS, frames), file).to_dict(),
            inputs=tuple(pictures(row["folder"], 1, frames) for row in rows),
            outputs=(file,),
            item=self.item.name,
            seconds=SHEET_SECONDS,
            memory_mb=_SMALL_MEMORY_MB,
        )

    def _label(self, turn: _Turn) -> str:
        """The layer, and what distinguishes its turntables where there are several."""
        parts = [turn.layer]
        parts += [turn.engine] if len(self.item.turntable.engines) > 1 else []
        parts += [turn.camera.name] if len(self.item.cameras) > 1 else []
        return ", ".join(parts)


def _files_of(options: Mapping[str, Any]) -> Iterator[str]:
    """Weights and cameras that options of a run name."""
    return (value for name, value in options.items() if names_files(name, value))


def _layer_options(train: Mapping[str, Any]) -> dict[str, Any]:
    """Options that a finished run leaves open; the others are its own."""
    return {name: train[name] for name in train if not OPTIONS[name].fixed}
