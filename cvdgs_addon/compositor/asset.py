"""The node group "CVD simulation" as an asset: a small .blend in an asset library, for files without this add-on."""

from __future__ import annotations

from pathlib import Path

import bpy

from ...core.errors import InputError
from .simulation_group import DESCRIPTION, GROUP_NAME, simulation_group

FILE_NAME = "CVD simulation.blend"
_TAGS = ("CVD", "colour blindness", "accessibility")


def save_asset(folder: str | Path) -> Path:
    """Write the node group as an asset into `folder`; the open file stays as it is.

    Raises:
        InputError: the folder cannot be written.
    """
    folder = Path(folder)
    had_group = GROUP_NAME in bpy.data.node_groups
    group = simulation_group()
    had_asset = group.asset_data is not None
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not had_asset:
            group.asset_mark()
        group.asset_data.description = DESCRIPTION
        for tag in _TAGS:
            group.asset_data.tags.new(tag, skip_if_exists=True)
        bpy.data.libraries.write(str(folder / FILE_NAME), {group}, fake_user=True, compress=True)
    except (OSError, RuntimeError) as error:
        reason = getattr(error, "strerror", None) or str(error).strip().splitlines()[-1]
        raise InputError(f"cannot be written ({reason})", where=folder, remedy="choose another folder") from error
    finally:
        if not had_asset and group.asset_data is not None:
            group.asset_clear()
        if not had_group:
            _remove_with_parts(group)
    return folder / FILE_NAME


def library_folder() -> str:
    """Folder of the first asset library of the preferences; empty where there is none."""
    libraries = bpy.context.preferences.filepaths.asset_libraries
    return next((library.path for library in libraries if library.path), "")


def _remove_with_parts(group: bpy.types.NodeTree) -> None:
    """Remove a node group and those that only it uses."""
    parts = {node.node_tree for node in group.nodes if getattr(node, "node_tree", None) is not None}
    bpy.data.node_groups.remove(group)
    for part in parts:
        if part.users == 0:
            bpy.data.node_groups.remove(part)
