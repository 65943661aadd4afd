"""Blender with a studio's own colour configuration, which the variable OCIO names, and other names than Blender's."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from cvdgs.core import bootstrap
from cvdgs.core.runtime.process import Job

from .scenes import read_png

REC709 = "Linear Rec.709 (sRGB)"
# Names as in the configurations of ACES 2.0; without their curves.
CONFIGURATION = """ocio_profile_version: 2
roles: {{default: Raw, data: Raw, scene_linear: ACEScg, default_byte: Screen, color_picking: Screen}}
displays:
  sRGB - Display:
    - !<View> {{name: ACES 2.0 - SDR 100 nits (Rec.709), colorspace: Screen}}
    - !<View> {{name: Raw, colorspace: Raw}}
colorspaces:
  - !<ColorSpace> {{name: ACEScg, encoding: scene-linear}}
  - !<ColorSpace> {{name: "{rec709}", encoding: scene-linear}}
  - !<ColorSpace> {{name: Screen, to_scene_reference: !<ExponentWithLinearTransform> {{gamma: 2.4, offset: 0.055}}}}
  - !<ColorSpace> {{name: Raw, isdata: true}}
"""
START = f"""
import runpy, sys
runpy.run_path({bootstrap.__file__!r})["load"]()
import bpy, cvdgs
bpy.ops.wm.read_homefile(use_factory_startup=True)
bpy.context.preferences.addons.new().module = "cvdgs"
cvdgs.register()
scene = bpy.context.scene
bpy.ops.cvdgs.load_run(directory=sys.argv[1])
shown = scene.cvdgs.display
def attempt(operator):
    try:
        operator()
    except RuntimeError as error:
        print(str(error).strip().splitlines()[-1])
def look():
    view = scene.view_settings
    return view.view_transform, view.look, view.exposure, scene.render.engine, scene.world.name, scene.cycles.samples
"""


@pytest.fixture
def studio(tmp_path: Path, run_folder: Path):
    """Runs a program in a Blender with the run in its start file; returns the lines that it prints."""

    def run(program: str, rec709: str | None = REC709) -> list[str]:
        environment = {**os.environ}
        environment.pop("OCIO", None)
        if rec709 is not None:
            environment["OCIO"] = str(tmp_path / "config.ocio")
            (tmp_path / "config.ocio").write_text(CONFIGURATION.format(rec709=rec709))
        command = [sys.executable, "-c", START + program + "\ncvdgs.unregister()", str(run_folder)]
        done = subprocess.run(command, capture_output=True, text=True, env=environment)
        assert done.returncode == 0, done.stderr
        return done.stdout.splitlines()

    return run


def test_gaussians_render_as_photographed_with_a_studios_colours(studio, tmp_path):
    pictures = []
    for name, rec709 in (("blenders", None), ("studios", REC709)):
        pictures.append(tmp_path / f"{name}.png")
        studio(
            "bpy.data.objects['Cube'].hide_render = True\n"
            "bpy.ops.cvdgs.set_up_render()\n"
            "from cvdgs.cvdgs_addon.scene.cameras import use_camera\n"
            "use_camera(scene, bpy.data.objects['view1'])\n"
            f"scene.render.filepath = {str(pictures[-1])!r}\n"
            "bpy.ops.render.render(write_still=True)",
            rec709,
        )
    blenders, studios = map(read_png, pictures)
    assert blenders.std() > 0.05
    assert (blenders == studios).all()


def test_what_a_studios_colours_lack_is_refused_and_nothing_is_changed(studio):
    told = studio(
        "scene.view_settings.exposure = 0.5\n"
        "before = look()\n"
        "shown.colors = 'SCENE_LINEAR'\n"
        "attempt(bpy.ops.cvdgs.set_up_render)\n"
        "print(look() == before, bpy.ops.cvdgs.restore_render.poll())"
    )
    said = "this Blender does not offer View settings > View transform Standard"
    assert any(said in line and "without the environment variable OCIO" in line for line in told), told
    assert told[-1] == "True False"


def test_what_was_set_up_before_stays_and_can_be_put_back(studio):
    told = studio(
        "before = look()\n"
        "bpy.ops.cvdgs.set_up_render()\n"
        "set_up = look()\n"
        "shown.colors = 'SCENE_LINEAR'\n"
        "attempt(bpy.ops.cvdgs.set_up_render)\n"
        "print(look() == set_up != before)\n"
        "bpy.ops.cvdgs.restore_render()\n"
        "print(look() == before)"
    )
    assert [line for line in told if line in ("True", "False")] == ["True", "True"]


SIMULATE = """
scene.view_settings.view_transform = "Raw"
bpy.ops.cvdgs.simulate()
from cvdgs.cvdgs_addon.compositor.apply import simulation_node
node = simulation_node(scene)
print(node is not None and any(link.to_node.bl_idname == "NodeGroupOutput" for link in node.node_tree.links))
print(sum(tree.bl_idname == "CompositorNodeTree" for tree in bpy.data.node_groups))
"""


def test_a_studios_colours_are_simulated_by_its_own_names(studio):
    assert "True" in studio(SIMULATE)


def test_colours_that_cannot_be_simulated_leave_no_half_made_nodes(studio):
    assert studio(SIMULATE, rec709="Nothing that we know")[-2:] == ["False", "0"]


def test_a_simulation_that_is_refused_is_not_ticked(studio):
    ticked = "print(scene.cvdgs.simulate.in_renders, scene.cvdgs.simulate.in_viewport)"
    assert studio(SIMULATE + ticked, rec709="Nothing that we know")[-1] == "False False"


def test_processes_of_a_run_have_blenders_own_colours(monkeypatch):
    """Their pictures are to be those of the trained Gaussians whatever a studio shows on its screens."""
    monkeypatch.setenv("OCIO", "/of/a/studio/config.ocio")
    lines: list[str] = []
    job = Job([sys.executable, "-c", "import os; print('variable:', os.environ.get('OCIO'))"], log=lines.append)
    list(job.events())
    assert "variable: None" in "".join(lines)
