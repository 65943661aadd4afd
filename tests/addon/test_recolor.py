"""Recolouring selected Gaussians in a layer of its own, which renders and exports know, and taking it back."""

from __future__ import annotations

import colorsys
import math

import bpy
import numpy as np
import pytest

from cvdgs.core.errors import InputError
from cvdgs.cvdgs_addon.export import read_gaussians
from cvdgs.cvdgs_addon.results import show_run
from cvdgs.cvdgs_addon.scene import masks, splats
from cvdgs.cvdgs_addon.scene.masks import Treatment
from cvdgs.cvdgs_addon.scene.recolor import Change, changed, recolor
from cvdgs.cvdgs_addon.scene.splat_attributes import color_attribute, read_attribute
from cvdgs.cvdgs_addon.shown import shown_layer

from . import ewa
from .scenes import CAMERA, add_with_inverse, cloud, opencv, render_png, ring_view

POSE = ring_view(0.4)
LAYER, EDITED = "tritan-0.5", "tritan-0.5-edited"
CHANGE = Change(hue=0.3, saturation=0.8, value=1.1)


@pytest.fixture
def gaussians():
    return cloud(200)


@pytest.fixture
def added(scene, gaussians):
    return add_with_inverse(scene, gaussians, LAYER, POSE)


@pytest.fixture
def shown(addon, run_folder):
    return show_run(str(run_folder), bpy.context.scene)


def first(target: bpy.types.Object, count: int) -> np.ndarray:
    chosen = np.zeros(len(target.data.vertices), np.bool_)
    chosen[:count] = True
    return chosen


def colors_of(target: bpy.types.Object, layer: str) -> np.ndarray:
    return read_attribute(target.data, color_attribute(layer))[:, :3]


def test_colours_change_as_hue_saturation_and_value_do():
    colors = np.array([[0.8, 0.2, 0.1], [0.1, 0.5, 0.9], [0.4, 0.4, 0.4], [0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
    for change in (CHANGE, Change(), Change(hue=-0.5), Change(saturation=3.0, value=0.5)):
        for color, result in zip(colors, changed(colors, change), strict=True):
            hue, saturation, value = colorsys.rgb_to_hsv(*color)
            wanted = min(saturation * change.saturation, 1.0), min(value * change.value, 1.0)
            np.testing.assert_allclose(result, colorsys.hsv_to_rgb((hue + change.hue) % 1.0, *wanted), atol=1e-12)


def test_renders_and_exports_show_the_edited_layer_and_the_other_stays(scene, added, gaussians, tmp_path):
    before = colors_of(added, LAYER)
    assert recolor(added, first(added, 80), LAYER, CHANGE) == EDITED
    splats.show_layer(added, EDITED)
    colors = 1.0 - gaussians.base_colors
    colors[:80] = changed(colors[:80], CHANGE)
    expected = ewa.render(gaussians, colors, CAMERA, opencv(POSE))
    assert ewa.psnr(render_png(scene, tmp_path / "image.png"), expected) > 50.0
    np.testing.assert_allclose(read_gaussians(added, EDITED, 1.0).gaussians.base_colors, colors, atol=1e-5)
    np.testing.assert_array_equal(colors_of(added, LAYER), before)


def test_changes_of_an_edited_layer_add_up_and_are_taken_back_for_what_is_selected(added, gaussians):
    for layer in (LAYER, EDITED):
        assert recolor(added, first(added, 80), layer, Change(hue=0.1)) == EDITED
    source = 1.0 - gaussians.base_colors
    np.testing.assert_allclose(colors_of(added, EDITED)[:80], changed(source[:80], Change(hue=0.2)), atol=1e-5)
    masks.select(added, first(added, 30), extend=False)
    masks.treat_selected(added, Treatment.RESTORE)
    np.testing.assert_allclose(colors_of(added, EDITED)[:30], source[:30], atol=1e-6)
    np.testing.assert_allclose(colors_of(added, EDITED)[30:80], changed(source[30:80], Change(hue=0.2)), atol=1e-5)


def test_what_kept_its_original_colours_shows_the_new_ones(added, gaussians):
    masks.select(added, first(added, 80), extend=False)
    masks.treat_selected(added, Treatment.KEEP_ORIGINAL)
    recolor(added, first(added, 30), LAYER, CHANGE)
    exported = read_gaussians(added, EDITED, 1.0).gaussians.base_colors
    np.testing.assert_allclose(exported[:30], changed(1.0 - gaussians.base_colors[:30], CHANGE), atol=1e-5)
    np.testing.assert_allclose(exported[30:80], gaussians.base_colors[30:80], atol=1e-5)


def test_nothing_selected_is_told(added):
    with pytest.raises(InputError, match="no Gaussians are selected"):
        recolor(added, first(added, 0), LAYER, CHANGE)


def recolor_all(mode: str = "EDIT") -> None:
    """Recolour all Gaussians, in steps that undo takes back one by one."""
    bpy.ops.ed.undo_push(message="loaded")
    bpy.ops.cvdgs.edit_points()
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.object.mode_set(mode=mode)
    bpy.ops.ed.undo_push(message="selected")
    bpy.ops.cvdgs.recolor_selected(hue=1.0)
    bpy.ops.ed.undo_push(message="recoloured")


def test_every_change_of_a_slider_takes_effect_in_edit_mode(shown):
    """Blender takes the last change back before the next one, by undo."""
    layer, name = shown_layer(shown)[0], shown.name
    before = colors_of(shown, layer)
    recolor_all()
    bpy.ops.ed.undo()
    shown = bpy.data.objects[name]
    assert shown_layer(shown) == (layer, 1.0)
    bpy.ops.cvdgs.recolor_selected(hue=2.0)
    assert shown_layer(shown) == (f"{layer}-edited", 1.0)
    bpy.ops.object.mode_set(mode="OBJECT")
    expected = changed(before[:400], Change(hue=2.0 / (2.0 * math.pi)))
    np.testing.assert_allclose(colors_of(shown, f"{layer}-edited")[:400], expected, atol=1e-5)


@pytest.mark.parametrize("mode", ["OBJECT", "EDIT"])
def test_redo_shows_the_edited_layer_again(shown, mode):
    layer, name = shown_layer(shown)[0], shown.name
    recolor_all(mode)
    for _ in range(2):
        bpy.ops.ed.undo()
        assert shown_layer(bpy.data.objects[name]) == (layer, 1.0)
        bpy.ops.ed.redo()
        assert shown_layer(bpy.data.objects[name]) == (f"{layer}-edited", 1.0)


def test_redo_leaves_a_layer_that_was_chosen_since(shown):
    layer, name = shown_layer(shown)[0], shown.name
    recolor_all()
    bpy.ops.ed.undo()
    bpy.ops.cvdgs.recolor_selected(hue=2.0)
    bpy.ops.ed.undo_push(message="recoloured otherwise")
    bpy.ops.cvdgs.show_layer(layer=layer)
    bpy.ops.mesh.select_all(action="DESELECT")
    bpy.ops.ed.undo_push(message="deselected")
    bpy.ops.ed.undo()
    bpy.ops.ed.redo()
    assert shown_layer(bpy.data.objects[name]) == (layer, 1.0)


@pytest.mark.parametrize("mode", ["OBJECT", "EDIT"])
def test_the_operator_shows_what_it_made_and_take_all_back_removes_it(shown, mode):
    masks.select(shown, first(shown, 50), extend=False)
    bpy.context.view_layer.objects.active = shown
    bpy.ops.object.mode_set(mode=mode)
    layer = shown_layer(shown)[0]
    bpy.ops.cvdgs.recolor_selected(hue=math.pi)
    assert bpy.context.object.mode == mode
    assert shown_layer(shown) == (f"{layer}-edited", 1.0)
    bpy.ops.cvdgs.take_all_back()
    bpy.ops.object.mode_set(mode="OBJECT")
    assert shown_layer(shown) == (layer, 1.0)
    assert f"{layer}-edited" not in splats.layer_names(shown)
