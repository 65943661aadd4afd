"""With Lamps: an artist's objects are rendered apart from the Gaussians, and stand among them all the same."""

from __future__ import annotations

import json
from pathlib import Path

import bpy
import numpy as np
import pytest

from cvdgs.cvdgs_addon.compositor.scene_tree import APART_NODE, ensure_tree, output_socket, scene_tree
from cvdgs.cvdgs_addon.scene import apart, display, splats
from cvdgs.cvdgs_addon.scene.apart import gaussians_scene, is_apart, objects_scene
from cvdgs.cvdgs_addon.scene.catcher import catchers_of, is_catcher_handle
from cvdgs.cvdgs_addon.scene.render_settings import Display, Engine
from cvdgs.cvdgs_addon.scene.turntable import Turntable, add_turntable, render_turntable
from cvdgs.ui.display import CVDGS_PT_display

from . import ewa
from .layouts import drawn
from .scenes import CAMERA, cloud, look_at, look_through, read_png, render_png, ring_view, take
from .test_apply_simulation import insert_glare, structure

EIGHT_BITS = 1.0 / 255.0


@pytest.fixture
def scene(addon):
    scene = bpy.context.scene
    look_through(scene, CAMERA, ring_view(0.4))
    settings = scene.render.image_settings
    if bpy.app.version >= (5, 0):
        settings.media_type = "IMAGE"
    settings.file_format, settings.color_mode = "PNG", "RGB"
    collection = bpy.data.collections.new("run")
    scene.collection.children.link(collection)
    shown = splats.add_gaussians(cloud(200), {}, collection, "run Gaussians")
    shown[display.BACKGROUND_PROPERTY] = (0.1, 0.1, 0.1)
    scene.cvdgs.display.colors = "SCENE_LINEAR"
    return scene


def add_thing(scene: bpy.types.Scene, location, size: float = 0.6, light: tuple | None = None) -> bpy.types.Object:
    """A cube; with `light` it shines evenly in that linear colour, so that a sample tells its colour."""
    corners = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    mesh = bpy.data.meshes.new("Thing")
    mesh.from_pydata([tuple(0.5 * size * end for end in corner) for corner in corners], [], faces)
    thing = bpy.data.objects.new("Thing", mesh)
    thing.location = location
    if light is not None:
        material = bpy.data.materials.new("Shining")
        if bpy.app.version < (5, 0):
            material.use_nodes = True
        nodes = material.node_tree.nodes
        nodes.clear()
        emission, output = nodes.new("ShaderNodeEmission"), nodes.new("ShaderNodeOutputMaterial")
        emission.inputs["Color"].default_value = (*light, 1.0)
        material.node_tree.links.new(emission.outputs[0], output.inputs[0])
        mesh.materials.append(material)
    scene.collection.objects.link(thing)
    return thing


def add_lamp(scene: bpy.types.Scene) -> bpy.types.Object:
    """A sun that shines straight down."""
    data = bpy.data.lights.new("Lamp", "SUN")
    data.energy = 3.0
    lamp = bpy.data.objects.new("Lamp", data)
    scene.collection.objects.link(lamp)
    return lamp


def test_gaussians_are_the_same_picture_apart_from_lamps(scene, tmp_path):
    display.set_up_render(scene, Engine.CYCLES, Display.SCENE_LINEAR)
    together = render_png(scene, tmp_path / "together.png")
    bpy.ops.cvdgs.set_up_render()
    assert is_apart(scene)
    add_lamp(scene)
    assert ewa.psnr(render_png(scene, tmp_path / "apart.png"), together) > 50.0


def test_a_thing_among_gaussians_hides_those_behind_it_and_is_hidden_by_those_before(scene, tmp_path):
    add_thing(scene, (0.2, 0.1, -0.1), light=(0.2, 0.6, 0.9))
    display.set_up_render(scene, Engine.CYCLES, Display.SCENE_LINEAR, {"cycles.filter_width": 1.0})
    scene.cycles.use_adaptive_sampling = False
    together = render_png(scene, tmp_path / "together.png")  # Cycles traces both: the oracle
    display.restore_render(scene)
    bpy.ops.cvdgs.set_up_render()
    seen = render_png(scene, tmp_path / "apart.png")
    assert ewa.psnr(seen, together) > 30.0
    scene.objects["Thing"].hide_render = True
    without = render_png(scene, tmp_path / "without.png")
    changed = np.abs(seen - without).max(axis=2) > 0.1
    assert changed.mean() > 0.03
    assert ewa.psnr(seen[changed], together[changed]) > 22.0


def test_objects_get_samples_bounces_and_a_denoiser_and_gaussians_one_sample(scene):
    bpy.ops.cvdgs.set_up_render()
    lit, shown = objects_scene(scene), gaussians_scene(scene)
    assert lit.cycles.samples >= 64
    assert lit.cycles.max_bounces >= 2
    assert lit.cycles.use_denoising
    assert lit.cycles.filter_width > 1.0
    assert (shown.cycles.samples, shown.cycles.use_denoising) == (1, False)
    assert {"samples", "use_denoising"} <= set(drawn(CVDGS_PT_display).properties)


def test_a_catcher_shows_the_shadow_and_nothing_else(scene, tmp_path):
    assert not bpy.ops.cvdgs.add_catcher.poll()
    bpy.data.objects.remove(next(found for found in scene.objects if splats.is_splats(found)))
    floor = take(cloud(1), [0] * 64)
    grid = np.linspace(-1.4, 1.4, 8)
    floor.means[:] = np.stack([*np.meshgrid(grid, grid), np.zeros((8, 8))], axis=-1).reshape(-1, 3)
    floor.log_scales[:], floor.opacity_logits[:] = np.log(0.25), 5.0
    floor.sh[:] = 1.0
    shown = splats.add_gaussians(floor, {}, scene.collection)
    shown[display.BACKGROUND_PROPERTY] = (0.1, 0.1, 0.1)
    look_through(scene, CAMERA, look_at((0.0, -0.5, 5.0)))
    add_lamp(scene)
    thing = add_thing(scene, (0.0, 0.0, 1.0))
    bpy.ops.cvdgs.set_up_render()
    bpy.ops.cvdgs.add_catcher()
    (handle,) = filter(is_catcher_handle, scene.objects)
    assert handle.location.z == pytest.approx(0.7)  # where the thing stands
    handle.location.z = 0.3
    thing.visible_camera = False
    caught = render_png(scene, tmp_path / "caught.png")
    thing.hide_render = True
    bare = render_png(scene, tmp_path / "bare.png")
    darker = bare.mean(axis=2) - caught.mean(axis=2)
    assert (darker > 0.2).sum() > 10
    assert abs(darker).mean() < 0.1, "the floor itself is not to be seen"
    assert np.median(abs(darker)) < 2 * EIGHT_BITS
    (plane,) = catchers_of(handle)
    assert plane.name not in scene.objects


@pytest.mark.parametrize("release", ["this", "an earlier one"])
def test_a_catcher_is_there_again_in_a_file_that_was_saved_without(scene, tmp_path, release):
    bpy.ops.cvdgs.set_up_render()
    bpy.ops.cvdgs.add_catcher()
    (handle,) = filter(is_catcher_handle, scene.objects)
    if release != "this":
        del handle["cvdgs_shadow_catcher_plane"]
    catchers_of(handle)[0].data.materials.append(bpy.data.materials.new("Rough"))
    bpy.ops.cvdgs.restore_render()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    bpy.ops.cvdgs.set_up_render()
    scene = bpy.context.scene
    (handle,) = filter(is_catcher_handle, scene.objects)
    (plane,) = catchers_of(handle)
    assert plane.data.materials[0].name == "Rough"
    assert list(objects_scene(scene).collection.children[2].objects) == [plane]
    bpy.data.objects.remove(handle)
    apart.follow(scene)
    assert not objects_scene(scene).collection.children[2].objects


def test_an_artists_own_shadow_catcher_hides_no_gaussians(scene, tmp_path):
    bpy.ops.cvdgs.set_up_render()
    without = render_png(scene, tmp_path / "without.png")
    plane = add_thing(scene, (0.0, 0.0, 0.0), size=6.0)
    plane.scale.z = 1e-3
    plane.is_shadow_catcher = True
    bpy.context.view_layer.update()
    things, _, catchers = objects_scene(scene).collection.children
    assert (list(things.objects), list(catchers.objects)) == ([], [plane])
    np.testing.assert_allclose(render_png(scene, tmp_path / "with.png"), without, atol=2 * EIGHT_BITS)
    plane.is_shadow_catcher = False
    apart.follow(scene)
    assert (list(things.objects), list(catchers.objects)) == ([plane], [])


def test_what_happens_in_the_scene_is_followed(scene):
    bpy.ops.cvdgs.set_up_render()
    lit, shown = objects_scene(scene), gaussians_scene(scene)
    thing, lamp = add_thing(scene, (0.0, 0.0, 0.0)), add_lamp(scene)
    scene.render.resolution_x = 99
    camera = look_through(scene, CAMERA, ring_view(1.0))
    bpy.context.view_layer.update()
    things, lamps, _ = lit.collection.children
    assert (set(things.objects), set(lamps.objects)) == ({thing}, {lamp})
    assert (lit.camera, shown.camera) == (camera, camera)
    assert shown.render.resolution_x == scene.render.resolution_x
    scene.collection.objects.unlink(thing)
    bpy.context.view_layer.update()
    assert not things.objects


def test_a_script_that_renders_at_once_gets_what_it_changed(scene, tmp_path):
    bpy.ops.cvdgs.set_up_render()
    look_through(scene, CAMERA, ring_view(2.0))
    add_thing(scene, (0.0, 0.0, 0.0), size=6.0, light=(0.0, 0.0, 1.0))
    np.testing.assert_allclose(
        np.median(render_png(scene, tmp_path / "blue.png"), axis=(0, 1)), [0.0, 0.0, 1.0], atol=0.05
    )


def render_frames(scene: bpy.types.Scene, folder: Path, count: int) -> list[np.ndarray]:
    """The pictures of an animation."""
    scene.frame_start, scene.frame_end = 1, count
    scene.render.filepath = str(folder / "####")
    bpy.ops.render.render(animation=True)
    return [read_png(folder / f"{frame:04d}.png") for frame in range(1, count + 1)]


def test_an_animation_cuts_to_the_cameras_that_markers_bind(scene, tmp_path):
    red, blue = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
    for frame, height, light in ((1, 0.0, red), (2, 40.0, blue)):
        add_thing(scene, (0.0, 0.0, height), size=6.0, light=light)
        view = look_at((3.5, 0.0, height + 1.2), (0.0, 0.0, height))
        scene.timeline_markers.new("cut", frame=frame).camera = look_through(scene, CAMERA, view)
    bpy.ops.cvdgs.set_up_render()
    for picture, light in zip(render_frames(scene, tmp_path, 2), (red, blue), strict=True):
        np.testing.assert_allclose(np.median(picture, axis=(0, 1)), light, atol=0.05)


def test_markers_that_are_bound_moved_or_deleted_are_followed(scene):
    bpy.ops.cvdgs.set_up_render()
    helpers, followers = (objects_scene(scene), gaussians_scene(scene)), apart.Followers()

    def bound() -> list[list[tuple]]:
        return [[(marker.frame, marker.camera) for marker in helper.timeline_markers] for helper in helpers]

    first, second = scene.timeline_markers.new("first", frame=1), scene.timeline_markers.new("second", frame=20)
    scene.timeline_markers.new("no cut", frame=10)
    first.camera, second.camera = scene.camera, look_through(scene, CAMERA, ring_view(1.0))
    bpy.context.view_layer.update()
    assert bound() == 2 * [[(1, first.camera), (20, second.camera)]]
    second.frame = 12
    bpy.context.view_layer.update()
    assert bound() == 2 * [[(1, first.camera), (12, second.camera)]]
    scene.timeline_markers.remove(first)
    followers.look()
    assert bound() == 2 * [[(12, second.camera)]]


@pytest.mark.parametrize(("stretched", "shown"), [(1, [False, True, False]), (2, [True, False, False])])
def test_a_thing_is_there_in_the_frames_in_which_it_is_not_hidden(scene, tmp_path, stretched, shown):
    thing = add_thing(scene, (0.0, 0.0, 0.0), size=6.0, light=(0.0, 0.0, 1.0))
    for frame, is_hidden in ((1, True), (2, False), (3, True)):
        thing.hide_render = is_hidden
        thing.keyframe_insert("hide_render", frame=frame)
    scene.frame_set(1)
    bpy.ops.cvdgs.set_up_render()
    scene.render.frame_map_old = stretched  # frame 1 shows what is keyed at 2, then
    scene.render.frame_map_new = 1
    is_blue = [
        np.allclose(np.median(picture, axis=(0, 1)), (0.0, 0.0, 1.0), atol=0.05)
        for picture in render_frames(scene, tmp_path, 3)
    ]
    assert is_blue == shown


def test_a_hidden_thing_neither_shows_nor_hides_gaussians(scene, tmp_path):
    bpy.ops.cvdgs.set_up_render()
    without = render_png(scene, tmp_path / "without.png")
    add_thing(scene, (0.0, 0.0, 0.0), light=(0.0, 0.0, 1.0)).hide_render = True
    np.testing.assert_allclose(render_png(scene, tmp_path / "hidden.png"), without, atol=EIGHT_BITS)


@pytest.mark.parametrize("how", ["hidden in renders", "excluded"])
def test_collections_that_are_not_rendered_are_left_out(scene, how):
    top, inner = (bpy.data.collections.new(name) for name in ("set", "props"))
    scene.collection.children.link(top)
    top.children.link(inner)
    thing, lamp = add_thing(scene, (0.0, 0.0, 0.0)), add_lamp(scene)
    for found, place in ((thing, inner), (lamp, top)):
        scene.collection.objects.unlink(found)
        place.objects.link(found)
    assert bpy.ops.cvdgs.set_up_render() == {"FINISHED"}
    lit, shown = objects_scene(scene), gaussians_scene(scene)
    assert {thing, lamp} <= set(lit.objects)
    if how == "excluded":
        for layer in scene.view_layers:
            layer.layer_collection.children[top.name].exclude = True
    else:
        top.hide_render = True
    apart.follow(scene)
    assert not {thing, lamp} & set(lit.objects)
    assert thing.name not in shown.objects
    run = scene.collection.children["run"]
    run.hide_render = True
    apart.follow(scene)
    assert not set(run.objects) & set(shown.objects)


def test_an_instance_of_gaussians_is_rendered_as_they_are(scene, tmp_path):
    bpy.ops.cvdgs.set_up_render()
    before = render_png(scene, tmp_path / "before.png")
    instance = bpy.data.objects.new("Instance", None)
    instance.instance_type, instance.instance_collection = "COLLECTION", bpy.data.collections["run"]
    scene.collection.objects.link(instance)
    for layer in scene.view_layers:
        layer.layer_collection.children["run"].exclude = True
    bpy.context.view_layer.update()
    np.testing.assert_array_equal(render_png(scene, tmp_path / "after.png"), before)


def test_what_only_a_view_layer_has_that_is_not_ticked_is_left_out(scene):
    proxies = bpy.data.collections.new("proxies")
    scene.collection.children.link(proxies)
    proxy, thing = add_thing(scene, (0.0, 0.0, 0.0)), add_thing(scene, (0.0, 0.0, 1.0))
    proxies.objects.link(proxy)
    scene.collection.objects.unlink(proxy)
    scene.view_layers[0].layer_collection.children["proxies"].exclude = True
    work = scene.view_layers.new("Work")
    work.use = False
    bpy.ops.cvdgs.set_up_render()
    things = objects_scene(scene).collection.children[0].objects
    assert set(things) == {thing}
    work.use = True
    apart.follow(scene)
    assert set(things) == {thing, proxy}
    work.use = False
    scene.view_layers[0].name = "Renamed"
    apart.follow(scene)
    assert thing in set(things)


def test_the_panel_warns_of_rigid_bodies_that_renders_do_not_move(scene):
    thing = add_thing(scene, (0.0, 0.0, 0.0))
    bpy.ops.cvdgs.set_up_render()
    bpy.context.view_layer.objects.active = thing
    thing.select_set(True)

    def warns() -> bool:
        return "rigid bodies" in " ".join(drawn(CVDGS_PT_display).texts)

    assert not warns()
    bpy.ops.rigidbody.object_add()
    assert warns()
    scene.cvdgs.display.engine = "EEVEE"  # renders nothing apart
    assert not warns()
    scene.cvdgs.display.engine = "CYCLES"
    bpy.ops.rigidbody.objects_remove()  # the last step of Bake to Keyframes
    assert not warns()


def test_restoring_leaves_no_trace(scene):
    scene.view_layers.new("Mine").use = False
    tree = ensure_tree(scene)
    del tree["cvdgs_made"]  # as if an artist had
    output = output_socket(tree)
    layers, glare = tree.nodes.new("CompositorNodeRLayers"), tree.nodes.new("CompositorNodeBlur")
    tree.links.new(layers.outputs["Image"], glare.inputs["Image"])
    tree.links.new(glare.outputs["Image"], output)
    before = structure(tree), {layer.name: layer.use for layer in scene.view_layers}
    groups = len(bpy.data.node_groups)
    bpy.ops.cvdgs.set_up_render()
    bpy.ops.cvdgs.set_up_render()
    assert is_apart(scene)
    assert structure(tree) != before[0]
    bpy.ops.cvdgs.restore_render()
    assert not is_apart(scene)
    assert list(bpy.data.scenes) == [scene]
    assert (structure(tree), {layer.name: layer.use for layer in scene.view_layers}) == before
    assert len(bpy.data.node_groups) <= groups + 2  # of the Gaussians, for light


def test_view_layers_that_were_renamed_meanwhile_are_rendered_again(scene):
    scene.view_layers.new("Mine").use = False
    bpy.ops.cvdgs.set_up_render()
    scene.view_layers[0].name, scene.view_layers["Mine"].name = "Beauty", "Proxies"
    scene.view_layers["CVD Rendered Apart"].name = "Nothing"
    apart.follow(scene)
    bpy.ops.cvdgs.restore_render()
    assert {layer.name: layer.use for layer in scene.view_layers} == {"Beauty": True, "Proxies": False}
    assert not any("cvdgs_rendered_layer" in layer for layer in scene.view_layers)


def test_view_layers_of_a_file_that_an_earlier_release_saved_are_rendered_again(scene):
    scene.view_layers.new("Mine").use = False
    name = scene.view_layers[0].name
    bpy.ops.cvdgs.set_up_render()
    for layer in scene.view_layers:
        for key in list(layer.keys()):
            del layer[key]
    scene["cvdgs_rendered_layers"] = json.dumps([name])
    bpy.ops.cvdgs.restore_render()
    assert {layer.name: layer.use for layer in scene.view_layers} == {name: True, "Mine": False}
    assert "cvdgs_rendered_layers" not in scene


@pytest.mark.parametrize("when", ["soon", "when it is saved"])
def test_what_renders_a_scene_apart_goes_with_it(scene, tmp_path, when):
    bpy.ops.cvdgs.set_up_render()
    other = bpy.data.scenes.new("Other")
    bpy.data.scenes.remove(scene)
    assert len(bpy.data.scenes) == 3
    if when == "soon":
        apart.Followers().look()
    else:
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    assert list(bpy.data.scenes) == [other]
    assert "CVD Objects" not in bpy.data.collections


def test_the_last_scenes_of_a_file_and_those_that_somebody_uses_stay(scene):
    bpy.ops.cvdgs.set_up_render()
    lit = objects_scene(scene)
    bpy.data.scenes.remove(scene)
    apart.remove_left_over()
    assert len(bpy.data.scenes) == 2
    add_thing(lit, (0.0, 0.0, 0.0))
    other = bpy.data.scenes.new("Other")
    apart.remove_left_over()
    assert set(bpy.data.scenes) == {lit, other}


@pytest.mark.parametrize("place", ["render", "Gaussians", "pictures", "output"])
def test_nodes_that_somebody_adds_stay_when_it_ends(scene, place):
    bpy.ops.cvdgs.set_up_render()
    tree = scene_tree(scene)
    node = tree.nodes[APART_NODE]
    group = node.inputs[1].links[0].from_node
    link = {
        "render": node.inputs[0].links[0],
        "Gaussians": group.inputs["Gaussians"].links[0],
        "pictures": node.inputs[1].links[0],
        "output": node.outputs["Vector"].links[0],
    }[place]
    glare = insert_glare(tree, link)
    before = len(bpy.data.node_groups)
    bpy.ops.cvdgs.restore_render()
    assert not is_apart(scene)
    assert scene_tree(scene) == tree
    (layers,) = (found for found in tree.nodes if found.bl_idname == "CompositorNodeRLayers")
    output = output_socket(tree)
    assert {found.name for found in tree.nodes} == {layers.name, "mine", output.node.name}
    assert output.links[0].from_node == (glare if place in ("render", "output") else layers)
    assert len(bpy.data.node_groups) == before - 1


def test_a_simulation_is_of_the_whole_picture(scene, tmp_path):
    add_thing(scene, (0.0, 0.0, 0.0), light=(0.0, 0.7, 0.0))
    bpy.ops.cvdgs.set_up_render()
    seen = render_png(scene, tmp_path / "seen.png")
    scene.cvdgs.viewer.cvd = "achromat"
    scene.cvdgs.simulate.in_renders = True
    grey = render_png(scene, tmp_path / "grey.png")
    assert np.ptp(seen, axis=2).max() > 0.5
    assert np.ptp(grey, axis=2).max() < 2 * EIGHT_BITS
    scene.cvdgs.simulate.in_renders = False
    np.testing.assert_allclose(render_png(scene, tmp_path / "back.png"), seen, atol=2 * EIGHT_BITS)
    assert scene_tree(scene) is not None


@pytest.mark.parametrize(("engine", "colors"), [("EEVEE", "SCENE_LINEAR"), ("CYCLES", "PHOTO")])
def test_only_cycles_with_lamps_renders_apart(scene, engine, colors):
    bpy.ops.cvdgs.set_up_render()
    assert is_apart(scene)
    scene.cvdgs.display.engine, scene.cvdgs.display.colors = engine, colors
    bpy.ops.cvdgs.set_up_render()
    assert not is_apart(scene)


@pytest.mark.parametrize("is_cut", [False, True])
def test_a_turntable_shows_things_from_its_own_camera(scene, tmp_path, is_cut):
    add_thing(scene, (0.0, 0.0, 0.0), size=6.0, light=(0.9, 0.0, 0.0))
    if is_cut:
        away = look_at((3.5, 0.0, 40.0), (9.0, 0.0, 40.0))
        scene.timeline_markers.new("cut", frame=1).camera = look_through(scene, CAMERA, away)
    bpy.ops.cvdgs.set_up_render()
    target = next(found for found in scene.objects if splats.is_splats(found))
    add_turntable(scene, target, Turntable(frames=2))
    render_turntable(scene, Turntable(frames=2, width=32, height_pixels=24), tmp_path, wait=True)
    picture = read_png(tmp_path / "0002.png")
    assert picture.shape == (24, 32, 3)
    assert np.median(picture[..., 0]) > 0.8
    assert apart.is_apart(scene)


@pytest.mark.parametrize("kind", ["FULL_COPY", "LINK_COPY"])
def test_a_copy_of_the_scene_renders_what_is_in_the_copy(scene, tmp_path, kind):
    thing = add_thing(scene, (0.0, 0.0, 0.0), light=(0.9, 0.0, 0.0))
    bpy.ops.cvdgs.set_up_render()
    helpers = objects_scene(scene), gaussians_scene(scene)
    original = render_png(scene, tmp_path / "original.png")
    bpy.ops.scene.new(type=kind)
    copy = bpy.context.scene
    shining = next(found for found in copy.objects if found.name.startswith(thing.name))
    assert (shining == thing) == (kind == "LINK_COPY")
    shining.hide_render = True
    without = render_png(copy, tmp_path / "copy.png")
    assert is_apart(copy)
    assert not {objects_scene(copy), gaussians_scene(copy)} & set(helpers)
    assert (without[..., 0] > 0.9).sum() < 0.1 * (original[..., 0] > 0.9).sum()
    shining.hide_render = False
    np.testing.assert_array_equal(render_png(copy, tmp_path / "again.png"), original)
    assert (objects_scene(scene), gaussians_scene(scene)) == helpers
    bpy.context.window.scene = scene
    np.testing.assert_array_equal(render_png(scene, tmp_path / "untouched.png"), original)


def test_restoring_a_copy_of_the_scene_leaves_the_original_apart(scene):
    bpy.ops.cvdgs.set_up_render()
    helpers = objects_scene(scene), gaussians_scene(scene)
    bpy.ops.scene.new(type="FULL_COPY")
    copy = bpy.context.scene
    assert copy != scene
    bpy.ops.cvdgs.restore_render()
    assert (objects_scene(scene), gaussians_scene(scene)) == helpers
    assert all(layer.use for layer in copy.view_layers)
    bpy.ops.cvdgs.set_up_render()
    assert is_apart(copy)
    assert not {objects_scene(copy), gaussians_scene(copy)} & set(helpers)
