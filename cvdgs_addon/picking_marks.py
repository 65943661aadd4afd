"""Clicking the same places in two runs, one run after the other: which is shown, what was clicked, what comes next."""

from __future__ import annotations

from collections.abc import Sequence

import bpy
import mathutils
from bpy_extras.view3d_utils import region_2d_to_origin_3d, region_2d_to_vector_3d

from ..core.splats.similarity import FEWEST
from .scene.alignment import places_of_marks, set_marks
from .scene.picking import surface_point

Ray = tuple[mathutils.Vector, mathutils.Vector]


class Picking:
    """The places that were clicked so far; only the run whose turn it is can be seen meanwhile.

    Args:
        owners: the Gaussians of the two runs, in their order.
    """

    def __init__(self, owners: Sequence[bpy.types.Object]) -> None:
        self._owners = tuple(owners)
        self._before = [places_of_marks(owner) for owner in self._owners]
        self._places: list[list[mathutils.Vector]] = [[] for _ in self._owners]
        self._turn = 0
        self.has_ended = self.is_complete = False

    @property
    def in_words(self) -> str:
        """What to do now, for Blender's status bar."""
        name, count = self._owners[self._turn].name, len(self._places[self._turn])
        if self._turn:
            return f"Click place {count + 1} of {len(self._places[0])} of {name}; Esc: cancel"
        more = ""
        if count >= FEWEST:
            more = f"Enter: go on with {self._owners[1].name}; "
        return f"Click place {count + 1} of {name}, {FEWEST} or more in all; {more}Esc: cancel"

    def show(self) -> None:
        """Show the run whose turn it is, or both at the end."""
        for number, owner in enumerate(self._owners):
            owner.hide_set(not self.has_ended and number != self._turn)

    def add(self, origin: mathutils.Vector, direction: mathutils.Vector) -> None:
        """Mark where a ray in the scene meets the run; nothing where it does not."""
        owner, places = self._owners[self._turn], self._places[self._turn]
        place = surface_point(owner, origin, direction)
        if place is None:
            return
        places.append(place)
        set_marks(owner, dict(enumerate(places, start=1)))
        if self._turn and len(places) == len(self._places[0]):
            self._end(is_complete=True)

    def go_on(self) -> None:
        """The first run has all its places: it is the other one's turn."""
        if not self._turn and len(self._places[0]) >= FEWEST:
            self._turn = 1
            self.show()

    def take_back(self) -> None:
        """Put back the marks that were there."""
        for owner, places in zip(self._owners, self._before, strict=True):
            set_marks(owner, places)
        self._end(is_complete=False)

    def _end(self, *, is_complete: bool) -> None:
        self.has_ended, self.is_complete = True, is_complete
        self.show()


def ray_below(window: bpy.types.Window, event: bpy.types.Event) -> Ray | None:
    """Origin and direction of the ray below the mouse; None where it is not over the picture of a 3D view."""
    for area in window.screen.areas:
        over = [region for region in area.regions if _is_over(region, event)]
        if area.type != "VIEW_3D" or [region.type for region in over] != ["WINDOW"]:
            continue
        (region,) = over
        place, view = (event.mouse_x - region.x, event.mouse_y - region.y), region.data  # a quad view has four
        return region_2d_to_origin_3d(region, view, place), region_2d_to_vector_3d(region, view, place)
    return None


def _is_over(region: bpy.types.Region, event: bpy.types.Event) -> bool:
    right, top = region.x + region.width, region.y + region.height
    is_drawn = min(region.width, region.height) > 1
    return is_drawn and region.x <= event.mouse_x < right and region.y <= event.mouse_y < top
