"""Settings of a scene that are changed for a purpose and put back afterwards; what they were is saved with the scene.

A purpose is a name such as ``cvdgs_render``. A setting that somebody changed in the meantime stays as it is then.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from typing import Any

import bpy

from ...core.errors import InputError

Setting = str | float | bool | None
"""Plain values; a data-block stands as its name."""

_DATA_BLOCKS = {"world": "worlds", "camera": "objects"}  # last name of a path, and where its data-blocks are listed
_KEPT = "{purpose}:{path}"  # custom property that keeps a data-block in the file while another is in its place
_TOLERANCE = 1e-6  # relative: Blender keeps floats in single precision
_RENAMED = ('"BLENDER_EEVEE_NEXT"', '"BLENDER_EEVEE"')  # an engine's name before Blender 5.0, and from then on
# What to do where this Blender does not offer a choice, by path.
_REMEDIES = {
    "render.engine": "enable it in Preferences > Add-ons",
    "view_settings.view_transform": "start Blender without the environment variable OCIO",
}


def set_settings(scene: bpy.types.Scene, wanted: Mapping[str, Setting]) -> None:
    """Set the settings at the given paths (from the scene), for good.

    Raises:
        InputError: this Blender does not offer one of them; what comes before it is set.
    """
    for path, value in wanted.items():
        _set(scene, path, value)


def change_settings(scene: bpy.types.Scene, purpose: str, wanted: Mapping[str, Setting]) -> list[str]:
    """Set the settings at the given paths (from the scene) and remember what they were.

    Returns:
        What was changed, in words: "Render > Engine: BLENDER_EEVEE to CYCLES".

    Raises:
        InputError: this Blender does not offer one of them; nothing is changed then.
    """
    record = _record(scene, purpose)
    told = []
    with ExitStack() as taken_back:
        for path, value in wanted.items():
            before = _get(scene, path)
            if _same(before, value):
                continue
            if path not in record:
                _keep(scene, purpose, path)
            _set(scene, path, value)
            taken_back.callback(_set, scene, path, before)
            first = record[path][0] if path in record else before
            record[path] = [first, _get(scene, path)]
            told.append(f"{_label(path)}: {_shown(before)} to {_shown(value)}")
        taken_back.pop_all()
    scene[purpose] = json.dumps(record)
    return told


def restore_settings(scene: bpy.types.Scene, purpose: str) -> list[str]:
    """Put back what `change_settings` changed; returns that in words."""
    told = []
    record = _record(scene, purpose)
    # Backwards, because some values are there only under others: a look belongs to its view transform.
    pending = [path for path in reversed(record) if _is_ours(scene, path, record[path][1])]
    refused: list[str] = []
    while pending and pending != refused:
        refused = list(pending)
        pending = [path for path in pending if not _put_back(scene, purpose, path, record[path][0])]
    for path, (before, changed) in record.items():
        if path not in pending and not _same(before, changed) and _is(scene, path, before):
            told.append(f"{_label(path)}: {_shown(changed)} to {_shown(before)}")
        scene.pop(_KEPT.format(purpose=purpose, path=path), None)
    if purpose in scene:
        del scene[purpose]
    return told


def is_offered(scene: bpy.types.Scene, path: str, value: str) -> bool:
    """Whether this Blender offers `value` for the setting, a choice, at `path`; what it offers depends on others."""
    owner, name = _owner(scene, path)
    return bool(bpy.types.UILayout.enum_item_name(owner, name, value))


def setting_before(scene: bpy.types.Scene, purpose: str, path: str) -> Setting:
    """What a setting was before it was changed for the purpose, or is, where it was not changed."""
    record = _record(scene, purpose)
    return record[path][0] if path in record else _get(scene, path)


def changes(scene: bpy.types.Scene, purpose: str) -> Iterator[str]:
    """What was changed for the purpose, in words."""
    for path, (before, changed) in _record(scene, purpose).items():
        yield f"{_label(path)}: {_shown(before)} to {_shown(changed)}"


def _put_back(scene: bpy.types.Scene, purpose: str, path: str, value: Setting) -> bool:
    """Whether the setting could be set now; a file format cannot before its media type."""
    kept = _kept(scene, purpose, path)
    owner, name = _owner(scene, path)
    try:
        if kept is not None:
            setattr(owner, name, kept)
        else:
            _set(scene, path, value)
    except InputError:
        return False
    return True


def _lists(path: str) -> str | None:
    """Where the data-blocks are listed that the setting can be; None for a plain value."""
    return _DATA_BLOCKS.get(path.rpartition(".")[2])


def _keep(scene: bpy.types.Scene, purpose: str, path: str) -> None:
    """Blender does not save data-blocks that nothing uses."""
    owner, name = _owner(scene, path)
    block = getattr(owner, name) if _lists(path) else None
    if block is not None and not _is_deleted(block):  # a script's camera may be in no collection from the start
        scene[_KEPT.format(purpose=purpose, path=path)] = block


def _kept(scene: bpy.types.Scene, purpose: str, path: str) -> bpy.types.ID | None:
    """The data-block that was in place before, whatever it is called by now; None where somebody has deleted it."""
    kept = scene.get(_KEPT.format(purpose=purpose, path=path))
    return None if _is_deleted(kept) else kept


def _is_deleted(block: bpy.types.ID | None) -> bool:
    """Whether it is an object in no collection: what somebody deleted stays in the file as long as we keep it."""
    return isinstance(block, bpy.types.Object) and not block.users_collection


def _record(scene: bpy.types.Scene, purpose: str) -> dict[str, list[Any]]:
    """By path what a setting was and what it was changed to; what was kept stands under the name it has now."""
    record = json.loads(_with_names_of_today(scene.get(purpose) or "{}"))
    for path in filter(_lists, record):
        kept = _kept(scene, purpose, path)
        if kept is not None:
            record[path][0] = kept.name
        elif _KEPT.format(purpose=purpose, path=path) in scene:
            record[path][0] = None
    return record


def _with_names_of_today(record: str) -> str:
    """The text of a record, which Blender 4 may have saved: what the engine is called has changed since."""
    return record.replace(*_RENAMED) if bpy.app.version >= (5, 0) else record


def _owner(scene: bpy.types.Scene, path: str) -> tuple[bpy.types.bpy_struct, str]:
    parent, _, name = path.rpartition(".")
    return (scene.path_resolve(parent) if parent else scene), name


def _get(scene: bpy.types.Scene, path: str) -> Setting:
    owner, name = _owner(scene, path)
    value = getattr(owner, name)
    return getattr(value, "name", None) if _lists(path) else value


def _is(scene: bpy.types.Scene, path: str, value: Setting) -> bool:
    """Whether the setting has that value; it has none where somebody deleted what it belongs to, such as a marker."""
    try:
        return _same(_get(scene, path), value)
    except ValueError:
        return False


def _is_ours(scene: bpy.types.Scene, path: str, changed: Setting) -> bool:
    """Whether the setting is as it was changed, or empty since that data-block was deleted."""
    listed = _lists(path)
    is_gone = listed is not None and changed is not None and changed not in getattr(bpy.data, listed)
    return _is(scene, path, None if is_gone else changed)


def _set(scene: bpy.types.Scene, path: str, value: Setting) -> None:
    owner, name = _owner(scene, path)
    listed = _lists(path)
    if listed is not None:
        block = getattr(bpy.data, listed).get(value) if value is not None else None
        setattr(owner, name, block)
        return
    try:
        setattr(owner, name, value)
    except TypeError as error:
        what = f"this Blender does not offer {_label(path)} {_shown(value)}"
        raise InputError(what, where=scene.name, remedy=_REMEDIES.get(path, "use another Blender")) from error


def _same(a: Setting, b: Setting) -> bool:
    if isinstance(a, float) and isinstance(b, (int, float)):
        return math.isclose(a, b, rel_tol=_TOLERANCE)
    return a == b


def _label(path: str) -> str:
    return " > ".join(part.replace("_", " ").capitalize() for part in path.split("."))


def _shown(value: Setting) -> str:
    if isinstance(value, bool):
        return "on" if value else "off"
    return f"{value:g}" if isinstance(value, float) else str(value if value is not None else "none")
