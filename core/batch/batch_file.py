"""The batch file: what to render for a whole collection, in TOML, checked as a whole. Standard library only.

title = "Autumn collection"
layers = ["original", "deutan-1.0"]        # "deutan" and "deutan-1.0" are the same

[train]                                    # options of scripts/run.py, for captures; files relative to this one
iterations = 3000

[turntable]
frames = 96
size = [640, 480]
engines = ["cycles"]

[cameras.low]                              # a turn for each camera
height = 0.1

[[items]]
capture = "captures/chair"                 # relative to the batch file; also a video, a zip or a transforms.json
layers = ["deutan-1.0", "protan-0.6"]      # an item's own values come before those above
turntable.frames = 48

[[items]]
run = "finished/sofa"                      # a finished run is taken as it is
"""

from __future__ import annotations

import os
import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ..capture.files import is_windows_device
from ..errors import InputError, abbreviated
from ..files.untrusted import is_file, is_there, read_text
from ..rendering.requests import CameraPath
from ..runs.layout import DIGITS, ORIGINAL
from ..runs.report import check_finished_run
from ..settings import AUTO, CVD_TYPES, ENGINES, OPTIONS, Layer, Settings, typed_value
from .model import Batch, Item, Needs, Output, TurntableSettings, layer_of, names_files
from .toml_reader import TableReader, UnusableFile

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*")
_NOT_IN_A_NAME = re.compile(r"[^A-Za-z0-9_-]+")
_MAX_FRAMES = 10**DIGITS - 1
_MAX_PIXELS = 16384  # of a side: Blender's own limit is 65536, and memory's is lower
_MAX_RETRIES = 100
_MAX_CORES, _MAX_MEMORY_MB = 1024, 2**24
_FAR = 1e6  # scene units
_MAX_BYTES = 1 << 20  # of a batch file: thousands of items
# In one line. Python's reader of TOML takes the square of a key's parts in time; more dots are no key of ours.
_MAX_DOTS = 32
_REASONABLE_SYNTAX = "see the start of core/batch/batch_file.py, or scripts/turntable.py --example FILE"
_BACKSLASHES = "write a path with / or in 'single quotes', because \\ means something else in double ones"


def read_batch(path: Path) -> Batch:
    """Read and check the batch file `path`.

    Raises:
        UnusableFile: with everything that is wrong in it.
        InputError: it cannot be read at all.
    """
    text = read_text(path, most_bytes=_MAX_BYTES, remedy="give a batch file in TOML").replace("\r\n", "\n")
    _refuse_endless_keys(text, path)
    try:
        values = tomllib.loads(text)
    except ValueError as error:  # also a number of thousands of digits, or a day that no month has
        raise UnusableFile(path, [_syntax_problem(str(error), text)]) from None
    except RecursionError:
        raise UnusableFile(path, [_syntax_problem("lists or tables are nested too deeply", text)]) from None
    problems: list[str] = []
    batch = _read(TableReader(values, (), problems), path.absolute().parent)
    if problems:
        raise UnusableFile(path, problems)
    return batch


def _refuse_endless_keys(text: str, path: Path) -> None:
    found = [number for number, line in enumerate(text.split("\n"), start=1) if line.count(".") > _MAX_DOTS]
    if found:
        what = f"more than {_MAX_DOTS} dots in one line"
        raise UnusableFile(path, [f"line {number}: {what} - split the line" for number in found])


@dataclass(frozen=True)
class _Defaults:
    """What holds for items that do not say otherwise."""

    folder: Path
    layers: tuple[str, ...]
    cameras: Mapping[str, CameraPath]
    turntable: TurntableSettings
    train: Mapping[str, Any]
    outputs: tuple[str, ...]


def _read(table: TableReader, folder: Path) -> Batch:
    defaults = _Defaults(
        folder,
        _read_layers(table, (ORIGINAL, Layer("deutan", 1.0).name)),
        _read_cameras(table.table("cameras")),
        _read_turntable(table.table("turntable"), TurntableSettings()),
        read_train_options(table.table("train"), {}, folder),
        table.choices("outputs", tuple(Output), tuple(Output)),
    )
    title = table.text("title", "Turntables")
    retries = table.integer("retries", Batch.retries, 0, _MAX_RETRIES)
    needs = _read_needs(table.table("needs"))
    tables = table.tables("items")
    if not table.values.get("items"):
        table.add_at((), "the batch has no items", "add [[items]] with a capture or a run")
    items = [_read_item(entry, defaults) for entry in tables]
    table.refuse_others()
    _refuse_equal_names(items, tables)
    return Batch(title, tuple(items), retries, needs)


def _read_item(table: TableReader, defaults: _Defaults) -> Item:
    capture, run = _read_path(table, "capture", defaults.folder), _read_path(table, "run", defaults.folder)
    if ("capture" in table) == ("run" in table):
        table.add_at((), "needs either a capture or a run", "give one of the two")
    name = table.text("name", _NOT_IN_A_NAME.sub("-", (capture or run or Path("item")).name).strip("-_") or "item")
    if not _NAME.fullmatch(name):
        table.add("name", f"'{name}' is not usable as a folder name", "use letters, digits, - and _")
    elif is_windows_device(name):
        table.add("name", f"'{name}' is a device on Windows, no folder", "give another name")
    layers = _read_layers(table, defaults.layers)
    names = table.choices("cameras", tuple(defaults.cameras), tuple(defaults.cameras))
    turntable = _read_turntable(table.table("turntable"), defaults.turntable)
    train = read_train_options(table.table("train"), defaults.train, defaults.folder)
    outputs = table.choices("outputs", defaults.outputs, tuple(Output))
    table.refuse_others()
    item = Item(
        name,
        capture,
        run,
        layers,
        (),
        tuple(defaults.cameras[name] for name in names),
        turntable,
        train,
        frozenset(Output(output) for output in outputs),
    )
    return _with_source_checked(item, table)


def _with_source_checked(item: Item, table: TableReader) -> Item:
    """Look at the capture or the finished run as far as that takes no time."""
    if item.run is not None:
        try:
            present = check_finished_run(item.run)
        except InputError as error:
            table.add("run", f"{error.where}: {error.what}", error.remedy)
            present = []
        return replace(item, present=tuple(present))
    if item.capture is not None:
        if not is_there(item.capture):  # what there is, the worker looks at
            table.add("capture", f"no such file or folder: {item.capture}", "give photographs, a video or a zip")
        layers = tuple(filter(None, map(layer_of, item.layers)))
        if not layers:
            key = "layers" if "layers" in table else "capture"
            table.add(key, "a capture needs a layer besides the original colours", 'add one, such as "deutan-1.0"')
            return item
        try:
            Settings(str(item.capture), "out", layers, **item.train)
        except InputError as error:
            table.add("train", f"{error.where.lstrip('-')}: {error.what}", error.remedy)
    return item


def _read_path(table: TableReader, key: str, folder: Path) -> Path | None:
    text = table.text(key)
    if not text:
        return None
    path = Path(os.path.normpath(folder / text))
    if _has_escapes(text) and not is_there(path):
        table.add(key, f"{abbreviated(text)} has control characters", _BACKSLASHES)
        return None
    return path


def _has_escapes(text: str) -> bool:
    """Whether something like a tab is in `text`, as in the path "C:\\temp" if that is what the file says."""
    return min(text) < " "


def _read_layers(table: TableReader, default: tuple[str, ...]) -> tuple[str, ...]:
    """Names as files and reports have them."""
    names: list[str] = []
    for index, text in enumerate(table.names("layers", default)):
        try:
            layer = layer_of(text)
        except ValueError:
            types = ", ".join(CVD_TYPES)
            remedy = f'give "{ORIGINAL}", or one of {types} with a severity from 0 to 1, such as "deutan-0.6"'
            table.add_at(("layers", index), f"unknown layer '{text}'", remedy)
            continue
        name = layer.name if layer else ORIGINAL
        if name in names:
            table.add_at(("layers", index), f"'{text}' appears twice", "name each once")
        else:
            names.append(name)
    return tuple(names) or default


def _read_cameras(table: TableReader) -> dict[str, CameraPath]:
    cameras = {}
    first: dict[str, str] = {}
    for name in table.values:
        camera = table.table(name)
        if not _NAME.fullmatch(name):
            table.add(name, "is not usable in a file name", "use letters, digits, - and _")
        # Some file systems do not tell capitals from small letters.
        other = first.setdefault(name.casefold(), name)
        if other != name:
            table.add(name, f"differs from '{other}' in capitals alone", "give one of them another name")
        usual = CameraPath()
        cameras[name] = CameraPath(
            camera.number("radius", usual.radius, 0.0, _FAR),
            camera.number("height", 0.0, -100.0, 100.0) if "height" in camera else usual.height,
            camera.number("focal_length", usual.focal_length, 0.0, 5000.0),
            camera.number("arc", usual.arc, 0.0, 360.0),
            name,
        )
        camera.refuse_others()
    return cameras or {CameraPath.name: CameraPath()}


def _read_turntable(table: TableReader, default: TurntableSettings) -> TurntableSettings:
    settings = TurntableSettings(
        table.integer("frames", default.frames, 1, _MAX_FRAMES),
        table.integer("frames_per_second", default.frames_per_second, 1, 240),
        _read_size(table, default.size),
        table.choices("engines", default.engines, ENGINES),
        table.integer("chunk", default.chunk, 1, _MAX_FRAMES),
    )
    table.refuse_others()
    return settings


def _read_size(table: TableReader, default: tuple[int, int]) -> tuple[int, int]:
    size = table.pair_of_integers("size", default, 2, _MAX_PIXELS)
    if "size" in table and any(side % 2 for side in size):
        table.add("size", f"{size[0]} x {size[1]} has an odd side; videos need even ones", "give even numbers")
    return size


def _read_needs(table: TableReader) -> Needs:
    usual = Needs()
    needs = Needs(
        table.integer("train_cores", usual.train_cores, 1, _MAX_CORES),
        table.integer("train_memory_mb", usual.train_memory_mb, 1, _MAX_MEMORY_MB),
        table.integer("frame_cores", usual.frame_cores, 1, _MAX_CORES),
        table.integer("frame_memory_mb", usual.frame_memory_mb, 1, _MAX_MEMORY_MB),
    )
    table.refuse_others()
    return needs


def _refuse_equal_names(items: Iterable[Item], tables: Sequence[TableReader]) -> None:
    first: dict[str, int] = {}
    for index, (item, table) in enumerate(zip(items, tables, strict=True)):
        other = first.setdefault(item.name.casefold(), index)  # as for cameras
        if other != index:
            table.add(
                "name",
                f"items {other + 1} and {index + 1} are both called '{item.name}'",
                "give one of them another name",
            )


def _syntax_problem(message: str, text: str) -> str:
    """`message` of Python's reader of `text`; it ends with ``(at line 3, column 7)`` where it knows the place."""
    found = re.search(r"\s*\(at line (\d+), column (\d+)\)", message)
    if found is None:
        return f"not valid TOML: {message} - {_REASONABLE_SYNTAX}"
    number = int(found[1])
    remedy = _BACKSLASHES if "\\" in text.split("\n")[number - 1] else _REASONABLE_SYNTAX
    return f"line {number}: not valid TOML: {message[: found.start()]} (column {found[2]}) - {remedy}"


_TRAIN_OPTIONS = tuple(name for name, option in OPTIONS.items() if option.in_batch)


def read_train_options(table: TableReader, default: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """The options by their names in `Settings`, those of `table` before those of `default`.

    Args:
        folder: that the paths in the table start from.
    """
    options = dict(default)
    for name in _TRAIN_OPTIONS:
        if name in table:
            try:
                options[name] = _checked(name, table.values[name], folder)
            except InputError as error:
                table.add(name, error.what, error.remedy)
    table.refuse_others(_TRAIN_OPTIONS)
    return options


def _checked(name: str, value: Any, folder: Path) -> Any:
    """The value of an option, which `Settings` accepts.

    Raises:
        InputError: it does not.
    """
    if value == AUTO and getattr(Settings, name) is None:
        return None
    value = typed_value(Settings, name, value)
    if names_files(name, value):
        value = os.path.normpath(folder / value)
        exists = is_file if name == "enhancer" else is_there  # a COLMAP model's folder has cameras, too
        if not exists(value):
            remedy = _BACKSLASHES if _has_escapes(value) else "name one that exists, relative to the batch file"
            raise InputError(f"no such file: {value}", remedy=remedy)
    Settings("capture", "out", (Layer("deutan", 1.0),), **{name: value})
    return value
