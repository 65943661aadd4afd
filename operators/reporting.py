"""How operators tell what is wrong: one line that says what, where, and what to do, which Blender pops up."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps

import bpy

from ..core.errors import InputError
from ..core.runtime.supervisor import WorkerDefect
from ..cvdgs_addon.messages import in_panel_words

Method = Callable[..., set[str]]


def reports_errors(method: Method) -> Method:
    """For ``execute`` and ``invoke``: an unusable input becomes a report, and the operator is cancelled."""

    def call(operator: bpy.types.Operator, *arguments: object) -> set[str]:
        try:
            return method(operator, *arguments)
        except (InputError, WorkerDefect) as error:
            operator.report({"ERROR"}, in_panel_words(str(error)))
            return {"CANCELLED"}

    # Blender counts the parameters.
    if method.__name__ == "invoke":
        return wraps(method)(lambda self, context, event: call(self, context, event))
    return wraps(method)(lambda self, context: call(self, context))
