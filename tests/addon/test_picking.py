"""Clicking on Gaussians: where a ray meets their surface, and the same places of two runs that align them."""

from __future__ import annotations

from types import SimpleNamespace

import bpy
import mathutils
import numpy as np
import pytest

from cvdgs.core.errors import InputError
from cvdgs.core.splats.gaussians import SH_C0, Gaussians
from cvdgs.cvdgs_addon.picking_marks import Picking, ray_below
from cvdgs.cvdgs_addon.scene import masks, splats
from cvdgs.cvdgs_addon.scene.alignment import align_by_marks, places_of_marks, set_marks
from cvdgs.cvdgs_addon.scene.masks import Treatment
from cvdgs.cvdgs_addon.scene.picking import surface_point
from cvdgs.operators.alignment import CVDGS_OT_pick_marks

from .test_alignment import apart  # noqa: F401 - a fixture
from .test_neighbours import in_scene, two  # noqa: F401 - a fixture


@pytest.fixture
def walls(scene):
    """Two walls across X at 2 and 5, each of nine flat opaque Gaussians; (object, indices of the first wall)."""
    grid = np.stack(np.meshgrid([2.0, 5.0], [-1.0, 0.0, 1.0], [-1.0, 0.0, 1.0], indexing="ij"), -1).reshape(-1, 3)
    count = len(grid)
    gaussians = Gaussians(
        grid.astype(np.float32),
        np.log(np.tile(np.array([0.01, 0.6, 0.6], np.float32), (count, 1))),
        np.tile(np.array([1.0, 0, 0, 0], np.float32), (count, 1)),
        np.full(count, 4.0, np.float32),
        np.full((count, 1, 3), 0.2 / SH_C0, np.float32),
    )
    return splats.add_gaussians(gaussians, {}, scene.collection), np.flatnonzero(grid[:, 0] < 3.0)


EYE, AHEAD = mathutils.Vector((-1.0, 0.2, 0.1)), mathutils.Vector((2.0, 0.0, 0.0))


def test_a_ray_meets_the_first_surface(walls):
    place = surface_point(walls[0], EYE, AHEAD)
    np.testing.assert_allclose(place, (2.0, 0.2, 0.1), atol=0.02)


def test_so_it_does_where_the_object_was_turned_moved_and_resized(walls):
    matrix = mathutils.Matrix.LocRotScale((1.0, 2.0, 3.0), mathutils.Euler((0.4, 0.2, 1.0)), (2.0, 2.0, 2.0))
    walls[0].matrix_world = matrix
    place = surface_point(walls[0], matrix @ EYE, matrix.to_3x3() @ AHEAD)
    np.testing.assert_allclose(place, matrix @ mathutils.Vector((2.0, 0.2, 0.1)), atol=0.05)


def test_what_was_removed_is_not_met(walls):
    target, first = walls
    chosen = np.zeros(len(target.data.vertices), np.bool_)
    chosen[first] = True
    masks.select(target, chosen, extend=False)
    masks.treat_selected(target, Treatment.REMOVE)
    np.testing.assert_allclose(surface_point(target, EYE, AHEAD), (5.0, 0.2, 0.1), atol=0.02)


def test_a_ray_past_or_away_meets_nothing(walls):
    assert surface_point(walls[0], EYE, mathutils.Vector((0.0, 0.0, 1.0))) is None
    assert surface_point(walls[0], EYE, -AHEAD) is None


def look_at(owner, index: int) -> tuple[mathutils.Vector, mathutils.Vector]:
    """A ray at a Gaussian from outside, the same one in the run's own axes for either run."""
    place = mathutils.Vector(in_scene(owner)[index].tolist())
    outside = owner.matrix_world.to_3x3() @ mathutils.Vector((3.0, 5.0, 8.0))
    return place + outside, -outside


def test_the_same_places_picked_in_both_runs_align_them(apart):  # noqa: F811
    first, second = apart
    pick = Picking(apart)
    pick.show()
    assert (first.hide_get(), second.hide_get()) == (False, True)
    pick.go_on()
    assert "Click place 1 of " + first.name in pick.in_words, "three places are needed first"
    for index in (3, 50, 170):
        pick.add(*look_at(first, index))
    assert "Enter" in pick.in_words
    pick.go_on()
    assert (first.hide_get(), second.hide_get()) == (True, False)
    assert f"place 1 of 3 of {second.name}" in pick.in_words
    for index in (3, 50, 170):
        assert not pick.has_ended
        pick.add(*look_at(second, index))
    assert pick.is_complete
    assert (first.hide_get(), second.hide_get()) == (False, False)
    before = in_scene(first)
    assert align_by_marks(second, first).pairs == 3
    np.testing.assert_allclose(in_scene(second), before, atol=1e-3)


def test_who_cancels_gets_the_earlier_marks_back(apart):  # noqa: F811
    places = {2: mathutils.Vector((1.0, 2.0, 3.0)), 4: mathutils.Vector((0.0, 1.0, 0.0))}
    set_marks(apart[0], places)
    pick = Picking(apart)
    pick.add(*look_at(apart[0], 3))
    assert len(places_of_marks(apart[0])) == 1
    pick.take_back()
    assert pick.has_ended
    assert not pick.is_complete
    back = places_of_marks(apart[0])
    assert list(back) == [2, 4], "else they no longer match those of the other run"
    np.testing.assert_allclose(list(back.values()), list(places.values()), atol=1e-5)
    assert places_of_marks(apart[1]) == {}


def pressed(key: str, *, ctrl: bool = False) -> SimpleNamespace:
    return SimpleNamespace(type=key, value="PRESS", ctrl=ctrl, oskey=False)


def test_undo_leaves_the_picking_alone(apart):  # noqa: F811
    operator = SimpleNamespace(_pick=Picking(apart))
    assert CVDGS_OT_pick_marks.modal(operator, bpy.context, pressed("Z", ctrl=True)) == {"RUNNING_MODAL"}
    assert CVDGS_OT_pick_marks.modal(operator, bpy.context, pressed("Z")) == {"PASS_THROUGH"}


def test_picking_that_blender_ends_is_taken_back(apart):  # noqa: F811
    pick = Picking(apart)
    pick.show()
    pick.add(*look_at(apart[0], 3))
    CVDGS_OT_pick_marks.cancel(SimpleNamespace(_pick=pick), bpy.context)
    assert [owner.hide_get() for owner in apart] == [False, False]
    assert places_of_marks(apart[0]) == {}


def test_gaussians_out_of_sight_are_not_picked_in(apart):  # noqa: F811
    first, second = apart
    bpy.context.scene.view_layers.new("other")
    layer = bpy.context.view_layer
    layer.layer_collection.children[first.users_collection[0].name].exclude = True
    layer.update()
    assert first.name not in layer.objects
    with pytest.raises(InputError, match="not in this view layer"):
        CVDGS_OT_pick_marks.on_click(SimpleNamespace(), bpy.context, pressed("LEFTMOUSE"))
    assert not second.hide_get()


def test_each_picture_of_a_quad_view_is_clicked_in_by_itself():
    def region(x: int, height: float) -> SimpleNamespace:
        view = mathutils.Matrix.Translation((0.0, 0.0, -height))
        data = SimpleNamespace(view_matrix=view, perspective_matrix=view, is_perspective=True)
        return SimpleNamespace(type="WINDOW", x=x, y=0, width=100, height=100, data=data)

    regions = [region(0, 1.0), region(100, 2.0)]
    spaces = SimpleNamespace(active=SimpleNamespace(region_3d=regions[-1].data))
    area = SimpleNamespace(type="VIEW_3D", regions=regions, spaces=spaces)
    window = SimpleNamespace(screen=SimpleNamespace(areas=[area]))
    for x, height in ((50, 1.0), (150, 2.0)):
        origin, _ = ray_below(window, SimpleNamespace(mouse_x=x, mouse_y=50))
        assert origin.z == height
