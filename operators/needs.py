"""What several operators need before they can be used, as mixins with a poll and its message."""

from __future__ import annotations

import bpy

from ..cvdgs_addon.shown import NOTHING_TO_SHOW, RUN_UNKNOWN, shown_run, shown_splats


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
