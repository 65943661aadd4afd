"""What the add-on does by itself when a scene changes under it."""

from __future__ import annotations

import bpy
import pytest

from cvdgs.cvdgs_addon import watching
from cvdgs.cvdgs_addon.scene import splats

from .scenes import cloud


@pytest.fixture
def shown(monkeypatch) -> list[str]:
    """Names of the scenes that were shown in colour; how is tested with the preview."""
    found: list[str] = []
    monkeypatch.setattr(watching, "show_in_color", lambda scene: found.append(scene.name))
    return found


def test_gaussians_that_are_linked_or_appended_are_shown_in_colour_once(addon, shown):
    scene, watcher = bpy.context.scene, watching.ViewWatcher()
    watcher.look()
    bpy.ops.object.empty_add()
    watcher.look()
    assert shown == []
    splats.add_gaussians(cloud(5), {}, scene.collection)
    watcher.look()
    watcher.look()
    assert shown == [scene.name]
    splats.add_gaussians(cloud(5), {}, scene.collection)
    watcher.look()
    assert shown == [scene.name], "those of a scene that has some do not change what somebody looks at"


def test_a_scene_that_is_met_with_gaussians_stays_as_it_is(addon, shown):
    splats.add_gaussians(cloud(5), {}, bpy.context.scene.collection)
    watching.ViewWatcher().look()
    assert shown == []


def test_who_chose_another_form_is_left_alone(addon, shown):
    scene, watcher = bpy.context.scene, watching.ViewWatcher()
    scene.cvdgs.display.automatic = False
    watcher.look()
    splats.add_gaussians(cloud(5), {}, scene.collection)
    watcher.look()
    assert shown == []


def test_views_are_followed_anew_after_an_undo(addon, monkeypatch):
    followed: list[str] = []
    monkeypatch.setattr(watching, "follow_shading", lambda scene, _views: followed.append(scene.name))
    splats.add_gaussians(cloud(5), {}, bpy.context.scene.collection)
    watcher = watching.ViewWatcher()
    watcher.look()
    watcher.look()
    assert len(followed) == 1, "nothing has changed"
    watcher.look_again()
    watcher.look()
    assert len(followed) == 2
