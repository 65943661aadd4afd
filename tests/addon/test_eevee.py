"""EEVEE's picture of Gaussians. In a process of its own, because Blender aborts where there is no OpenGL."""

from __future__ import annotations

import subprocess
import sys

import bpy
import pytest

from cvdgs.core import bootstrap
from cvdgs.cvdgs_addon.scene import display, splats
from cvdgs.cvdgs_addon.scene.render_settings import Display, Engine
from cvdgs.cvdgs_addon.scene.splat_nodes import Input

from . import ewa
from .scenes import CAMERA, cloud, look_through, opencv, read_png, ring_view

POSE = ring_view(0.4)
COUNT = 300

RENDER = """
import os, runpy, sys
runpy.run_path({bootstrap!r})["load"]()
import bpy
bpy.ops.wm.open_mainfile(filepath={scene!r})
bpy.context.scene.render.filepath = {image!r}
bpy.ops.render.render(write_still=True)
sys.stdout.flush()
os._exit(0)
"""


@pytest.mark.timeout(120)
@pytest.mark.parametrize(
    "limit", [pytest.param(0, id="instances", marks=pytest.mark.slow), pytest.param(COUNT, id="mesh")]
)
def test_eevee_shows_the_rasterisers_image(scene, tmp_path, limit):
    gaussians = cloud(COUNT)
    look_through(scene, CAMERA, POSE)
    added = splats.add_gaussians(gaussians, {}, scene.collection)
    splats.set_input(added, Input.MESH_LIMIT, limit)
    added[display.BACKGROUND_PROPERTY] = (0.0, 0.0, 0.0)
    display.set_up_render(scene, Engine.EEVEE, Display.PHOTO)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    image = tmp_path / "eevee.png"
    code = RENDER.format(bootstrap=bootstrap.__file__, scene=str(tmp_path / "scene.blend"), image=str(image))
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300)
    if result.returncode < 0 and not image.exists():
        pytest.skip("Blender aborts: no OpenGL")
    assert result.returncode == 0, result.stderr
    expected = ewa.render(gaussians, gaussians.base_colors, CAMERA, opencv(POSE))
    assert ewa.psnr(read_png(image), expected) > 40.0


def test_gaussians_throw_no_shadows(scene):
    """EEVEE spends minutes on the shadows of a few thousand of them."""
    added = splats.add_gaussians(cloud(3), {}, scene.collection)
    assert not added.visible_shadow
