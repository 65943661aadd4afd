"""Which options of a run that goes on with another, or adds to it, are given, and which are as in that one.

Standard library only.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import Any

from ..errors import InputError
from ..settings import AUTO, OPTIONS, Settings, flag

LAYERS = "layers"
"""Stands for ``--cvd`` and ``--severity`` among the names of options that are given, which otherwise are `OPTIONS`."""
NEW_RUN = "make a new run in another folder"


def completed(asked: Settings, own: Settings, given: Collection[str]) -> Settings:
    """`asked`, with the value in `own` of each of `OPTIONS` but ``resume`` that is not `given`.

    Turntables are made by Blender: where one of ``--turntable`` and ``--no-blend`` is given and does not go with the
    other one in `own`, that is as in `asked`.
    """
    values = {name: getattr(own, name) for name in OPTIONS if name != "resume" and name not in given}
    if values.get("turntable", asked.turntable) and not values.get("blend", asked.blend):
        values |= {"turntable": asked.turntable, "blend": asked.blend}
    return replace(asked, **values)


def completed_addition(asked: Settings, own: Settings, given: Collection[str] | None = None) -> Settings:
    """`completed` for layers that are added to a finished run, which has its `own` settings.

    Args:
        given: names of the options that are; None: all that may differ, and others that are not at their default.

    Raises:
        InputError: an option that is given has to be as in the finished run, and is not.
    """
    if given is None:
        given = {name for name in OPTIONS if not OPTIONS[name].fixed or getattr(asked, name) != _usual(name)}
    for name, option in OPTIONS.items():
        if option.fixed and name in given and getattr(asked, name) != getattr(own, name):
            raise InputError(
                f"the finished run has {_shown(getattr(own, name))}, not {_shown(getattr(asked, name))}",
                where=flag(name),
                remedy=f"leave it out, or {NEW_RUN}",
            )
    return completed(asked, own, given)


def _usual(name: str) -> Any:
    return getattr(Settings, name)


def _shown(value: Any) -> str:
    return AUTO if value is None else str(value)
