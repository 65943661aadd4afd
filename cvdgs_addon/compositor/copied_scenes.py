"""Copies of scenes: what was set up for the original is set up for a copy anew, or it would render the original's."""

from __future__ import annotations

import threading

import bpy

from ..scene.apart import names_scenes_of_another
from .apply import simulation_lifted, simulation_node


class CopiedScenes:
    """Looks after scenes that appear in an open file; a part of the add-on."""

    def __init__(self) -> None:
        self._known: set[int] | None = None  # by `session_uid`

        @bpy.app.handlers.persistent
        def look(*_: object) -> None:
            # Renders that a window starts come here on a thread of theirs: the copy was made, and looked after, before.
            if threading.current_thread() is threading.main_thread():
                self._look()

        @bpy.app.handlers.persistent
        def opened(*_: object) -> None:
            self._known = _scenes()

        self._handlers = {"depsgraph_update_post": look, "render_init": look, "load_post": opened}

    def register(self) -> None:
        # Blender hides its data from add-ons that it enables: then the scenes of the first change are those known.
        self._known = _scenes() if hasattr(bpy.data, "scenes") else None
        for event, handler in self._handlers.items():
            getattr(bpy.app.handlers, event).append(handler)

    def unregister(self) -> None:
        for event, handler in self._handlers.items():
            present = getattr(bpy.app.handlers, event)
            if handler in present:
                present.remove(handler)

    def _look(self) -> None:
        present = _scenes()
        appeared = present - self._known if self._known is not None else set()
        self._known = present
        for scene in [found for found in bpy.data.scenes if found.session_uid in appeared]:
            if scene.library is None and (names_scenes_of_another(scene) or _lacks_simulation(scene)):
                with simulation_lifted(scene):
                    pass  # takes away what was the original's; what follows is the copy's own
                self._known = _scenes()  # with those in which the copy's objects and Gaussians are rendered


def _scenes() -> set[int]:
    return {scene.session_uid for scene in bpy.data.scenes}


def _lacks_simulation(scene: bpy.types.Scene) -> bool:
    """Whether `scene` says that it simulates and does not: "Copy Settings" copies no compositor."""
    simulate = scene.cvdgs.simulate
    return (simulate.in_renders or simulate.in_viewport) and simulation_node(scene) is None
