"""The part of a batch file that says how captures become runs: options of ``scripts/run.py``. Standard library only."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..errors import InputError
from ..settings import WEIGHTS_SUFFIX, Layer, Settings, typed_value
from ..untrusted import is_file
from .table_reader import TableReader

# The others belong to the batch or to the item.
OPTIONS = (
    "simulation",
    "strength",
    "enhancer",
    "mode",
    "iterations",
    "gaussians",
    "sh_degree",
    "max_size",
    "holdout",
    "device",
    "seed",
    "refine_poses",
    "sfm",
)
_AUTO = "auto"


def read_train_options(table: TableReader, default: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """The options by their names in `Settings`, those of `table` before those of `default`.

    Args:
        folder: that the paths in the table start from.
    """
    options = dict(default)
    for name in OPTIONS:
        if name in table:
            try:
                options[name] = _checked(name, table.values[name], folder)
            except InputError as error:
                table.add(name, error.what, error.remedy)
    table.refuse_others(OPTIONS)
    return options


def _checked(name: str, value: Any, folder: Path) -> Any:
    """The value of an option, which `Settings` accepts.

    Raises:
        InputError: it does not.
    """
    if value == _AUTO and getattr(Settings, name) is None:
        return None
    value = typed_value(Settings, name, value)
    if name == "enhancer" and value.endswith(WEIGHTS_SUFFIX):
        value = os.path.normpath(folder / value)
        if not is_file(value):
            raise InputError(f"no such file: {value}", remedy=f"give a {WEIGHTS_SUFFIX} file that is there")
    Settings("capture", "out", (Layer("deutan", 1.0),), **{name: value})
    return value
