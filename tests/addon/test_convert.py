"""From a finished run to scene.blend and stills, in process and as a worker."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import bpy
import numpy as np
import pytest

from cvdgs.core.errors import InputError
from cvdgs.core.runtime.protocol import Reporter
from cvdgs.core.splats.io.ply import write_ply
from cvdgs.cvdgs_addon.scene import cameras, splats, worker
from cvdgs.cvdgs_addon.scene.convert import ConversionOptions, convert, load_run
from cvdgs.cvdgs_addon.scene.finished_run import PARTIAL_FOLDER, read_run
from cvdgs.cvdgs_addon.scene.import_capture import place_again
from cvdgs.cvdgs_addon.scene.placement import Placing, Up, placement
from cvdgs.cvdgs_addon.scene.render_settings import Display
from cvdgs.cvdgs_addon.scene.splat_nodes import Input

from ..patience import SOON
from . import ewa
from .scenes import cloud, opencv, read_png, synthetic_run, take

WORKER = Path(worker.__file__)


class Recorder(Reporter):
    def __init__(self) -> None:
        self.fractions: list[float] = []

    def progress(self, stage: str, fraction: float, message: str = "") -> None:
        self.fractions.append(fraction)


def entries(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


def test_a_run_becomes_a_scene_and_stills(run_folder):
    before, recorder = entries(run_folder), Recorder()
    result = convert(run_folder, reporter=recorder, options=ConversionOptions(view="view2"))
    stills = [f"stills/{layer}.png" for layer in ("original", "deutan-1.0", "tritan-0.5")]
    assert result.stills == stills
    assert entries(run_folder) - before == {"scene.blend", *stills}
    assert recorder.fractions == sorted(recorder.fractions)
    assert recorder.fractions[-1] == 1.0

    run = read_run(run_folder)
    view = run.view("view2")
    colors = {"original": run.gaussians.base_colors, **run.layers}
    for still, layer in zip(stills, colors, strict=True):
        expected = ewa.render(run.gaussians, colors[layer], view.camera, opencv(view.camera_to_world))
        assert ewa.psnr(read_png(run_folder / still), expected) > 45.0

    bpy.ops.wm.open_mainfile(filepath=str(run_folder / "scene.blend"))
    scene = bpy.context.scene
    assert scene.camera.name == "view2"
    assert sum(cameras.is_capture_camera(candidate) for candidate in scene.objects) == 5
    added = next(candidate for candidate in scene.objects if splats.is_splats(candidate))
    assert splats.layer_names(added) == ["original", "deutan-1.0", "tritan-0.5"]
    assert splats.get_input(added, Input.LAYER) == "color_deutan-1.0"
    assert scene.view_settings.view_transform == "Raw"


def test_scene_linear_display_uses_the_standard_view(run_folder):
    options = ConversionOptions(display=Display.SCENE_LINEAR, stills=False, background=(0.5, 0.5, 0.5))
    result = convert(run_folder, reporter=Reporter(), options=options)
    assert result.stills == []
    bpy.ops.wm.open_mainfile(filepath=str(run_folder / "scene.blend"))
    assert bpy.context.scene.view_settings.view_transform == "Standard"
    background = bpy.context.scene.world.node_tree.nodes["Background"].inputs["Color"].default_value
    assert background[0] == pytest.approx(0.21404, abs=1e-4)


def test_an_earlier_result_survives_a_failure(run_folder):
    (run_folder / "scene.blend").write_text("earlier")
    (run_folder / "splats.tritan-0.5.ply").write_text("ply but not really")
    before = entries(run_folder)
    with pytest.raises(InputError):
        convert(run_folder, reporter=Reporter())
    assert entries(run_folder) == before
    assert (run_folder / "scene.blend").read_text() == "earlier"


def test_a_run_without_gaussians_or_with_broken_ones_is_refused(run_folder):
    broken = cloud(400)
    broken.means[3] = np.nan
    write_ply(run_folder / "splats.ply", broken)
    with pytest.raises(InputError, match="positions are not finite"):
        convert(run_folder, reporter=Reporter())
    for path in run_folder.glob("splats*.ply"):
        write_ply(path, take(cloud(1), []))
    with pytest.raises(InputError, match="no Gaussians"):
        convert(run_folder, reporter=Reporter())


def test_loading_leaves_the_open_scene_as_it_is(scene, run_folder):
    scene.render.engine = "BLENDER_WORKBENCH"
    loaded = load_run(read_run(run_folder), scene)
    assert scene.render.engine == "BLENDER_WORKBENCH"
    assert scene.camera is None
    assert {candidate.parent for candidate in (loaded.splats, *loaded.cameras.values())} == {loaded.empty}


def test_an_upright_capture_of_sensible_size_stays_where_it_is(run_folder):
    run = read_run(run_folder)
    np.testing.assert_array_equal(placement(run.views, np.zeros(3)), np.eye(4))


def test_a_tilted_tiny_capture_is_set_upright_and_enlarged(run_folder):
    run = read_run(run_folder)
    tilt = np.eye(4)
    tilt[:3, :3] = 0.01 * np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])  # up becomes -Y, as in COLMAP
    tilt[:3, 3] = (5.0, 6.0, 7.0)
    views = []
    for view in run.views:
        pose = tilt @ view.camera_to_world
        pose[:3, :3] /= 0.01
        views.append(type(view)(view.key, view.camera, pose))
    matrix = placement(views, tilt[:3, 3])
    np.testing.assert_allclose(matrix @ np.append(tilt[:3, 3], 1.0), (0.0, 0.0, 0.0, 1.0), atol=1e-5)
    up = matrix[:3, :3] @ tilt[:3, :3] @ (0.0, 0.0, 1.0)
    assert up[2] / np.linalg.norm(up) > 0.999
    distances = [np.linalg.norm((matrix @ view.camera_to_world)[:3, 3]) for view in views]
    assert np.median(distances) == pytest.approx(3.0, rel=1e-5)


def test_what_the_worker_found_is_up_and_a_metre_is_a_unit(scene, run_folder):
    file = run_folder / "capture" / "transforms.json"
    up = np.array([0.1, -0.2, 1.0]) / np.linalg.norm([0.1, -0.2, 1.0])  # 13 degrees off: else taken for upright
    document = json.loads(file.read_text()) | {"up": (2.0 * up).tolist(), "metres_per_unit": 0.5}
    file.write_text(json.dumps(document))
    loaded = load_run(read_run(run_folder), scene)
    matrix = np.array(loaded.empty.matrix_basis)
    np.testing.assert_allclose(matrix[:3, :3] @ up, (0.0, 0.0, 0.5), atol=1e-5)
    place_again(loaded.empty, Placing(Up.X, 20.0))
    place_again(loaded.empty, Placing())
    np.testing.assert_allclose(np.array(loaded.empty.matrix_basis), matrix, atol=1e-5)


@pytest.mark.parametrize("damage", [{"up": [0, 0, 0]}, {"up": "z"}, {"up": [1, 2]}, {"metres_per_unit": -1}])
def test_a_damaged_up_or_unit_is_refused(run_folder, damage):
    file = run_folder / "capture" / "transforms.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | damage))
    with pytest.raises(InputError, match="not the cameras of a run"):
        read_run(run_folder)


# ---------------------------------------------------------------------------------------------------------- the worker


def start(*arguments: str) -> subprocess.Popen[str]:
    command = [sys.executable, str(WORKER), *arguments]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def test_the_worker_speaks_the_protocol_and_nothing_else(run_folder):
    process = start(str(run_folder), "--view", "view1")
    output, errors = process.communicate(timeout=120)
    assert process.returncode == 0, errors
    events = [json.loads(line) for line in output.splitlines()]
    assert events[-1]["event"] == "result"
    assert events[-1]["stills"][0] == "stills/original.png"
    assert {event["stage"] for event in events[:-1]} == {"blender"}
    assert (run_folder / "scene.blend").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("nowhere",), "nowhere: no such folder"),
        ((".", "--display", "agx"), "invalid choice: 'agx'"),
        ((), "RUN_FOLDER"),
    ],
)
def test_the_worker_refuses_bad_input_in_one_line(arguments, complaint):
    process = start(*arguments)
    output, _ = process.communicate(timeout=60)
    assert process.returncode == 2
    (event,) = [event for event in map(json.loads, output.splitlines()) if event["event"] == "error"]
    assert event["kind"] == "input"
    assert complaint in event["message"]
    assert "\n" not in event["message"]


@pytest.mark.skipif(sys.platform == "win32", reason="a process group is cancelled in another way there")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_cancelling_in_the_middle_of_a_render_leaves_nothing(tmp_path, number):
    folder = synthetic_run(tmp_path / "run", count=20_000)  # minutes of rendering: every pixel meets hundreds
    before = entries(folder)
    process = start(str(folder))
    for line in process.stdout:
        if "rendering" in line:
            break
    time.sleep(0.7)
    assert (folder / PARTIAL_FOLDER).is_dir()
    process.send_signal(number)
    process.wait(timeout=SOON)
    assert process.returncode == 130
    process.communicate()
    assert entries(folder) == before
    assert not (folder / PARTIAL_FOLDER).exists()
