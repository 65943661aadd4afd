"""What operators share: when they can be used, and errors as reports of one line."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps

import bpy

from ..core.errors import InputError
from ..core.runtime.supervisor import WorkerDefect
from ..cvdgs_addon.messages import in_panel_words
from ..cvdgs_addon.shown import NOTHING_TO_SHOW, RUN_UNKNOWN, shown_run, shown_splats

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


class NeedsGaussians:
    """An operator on the Gaussians of the sub-panel Display."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if shown_splats(context) is None:
            cls.poll_message_set(NOTHING_TO_SHOW)  # type: ignore[attr-defined]
            return False
        return True


class NeedsRun(NeedsGaussians):
    """An operator on files of the run that these Gaussians came from."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not super().poll(context):
            return False
        if not shown_run(context):
            cls.poll_message_set(RUN_UNKNOWN)  # type: ignore[attr-defined]
            return False
        return True
