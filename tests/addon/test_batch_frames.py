"""The pictures of a batch's turntables: what they show, and that they are the same however the work is divided."""

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

from cvdgs.core.color.srgb import simulate_bytes
from cvdgs.core.errors import InputError
from cvdgs.core.runtime.protocol import Reporter
from cvdgs.cvdgs_addon.batch import worker
from cvdgs.cvdgs_addon.batch.frames import render_frames, turntable_of
from cvdgs.cvdgs_addon.batch.pixels import read_picture, write_picture
from cvdgs.cvdgs_addon.results import show_run
from cvdgs.cvdgs_addon.scene.display import set_up_render
from cvdgs.cvdgs_addon.scene.render_settings import Display, Engine
from cvdgs.cvdgs_addon.scene.splats import show_layer
from cvdgs.cvdgs_addon.scene.turntable import add_turntable, render_turntable

from ..patience import SOON
from .batches import frames_arguments

WORKER = Path(worker.__file__)
NEVER_MORE_THAN = 3  # levels of 255: what turning the whole scene may change by rounding


def render(out: Path, run: Path, threads: int = 0, **changes) -> dict:
    return render_frames(frames_arguments(run, **changes), out, threads=threads, reporter=Reporter())


def pictures(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def request(out: Path, run: Path, **changes) -> str:
    arguments = frames_arguments(run, **changes).to_dict()
    fields = {"job": "frames", "out": str(out), "arguments": arguments, "threads": 1}
    return json.dumps(fields) + "\n"


def test_a_picture_that_is_written_is_read_back_bit_for_bit(tmp_path):
    picture = np.random.default_rng(0).integers(0, 256, (13, 17, 3), np.uint8)
    write_picture(tmp_path / "new" / "0001.png", picture)
    np.testing.assert_array_equal(read_picture(tmp_path / "new" / "0001.png"), picture)
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["0001.png"]


def test_the_pictures_are_those_of_the_artists_turntable(addon, run_folder, tmp_path):
    render(tmp_path, run_folder, layer="deutan-1.0")
    bpy.ops.wm.read_homefile(use_empty=True)
    scene = bpy.context.scene
    splats = show_run(str(run_folder), scene)
    show_layer(splats, "deutan-1.0")
    set_up_render(scene, Engine.CYCLES, Display.PHOTO)
    turntable = turntable_of(frames_arguments(run_folder))
    add_turntable(scene, splats, turntable)
    render_turntable(scene, turntable, tmp_path / "artist", wait=True)
    for number in range(1, 5):
        ours, artists = (read_picture(tmp_path / kind / f"{number:04d}.png") for kind in ("turn", "artist"))
        difference = np.abs(ours.astype(int) - artists)
        assert np.quantile(difference, 0.999) <= NEVER_MORE_THAN
        assert artists.std() > 10.0, "there is something to see"


def test_however_the_work_is_divided_the_pictures_have_the_same_bits(run_folder, tmp_path):
    simulated = {"tritan-0.5": "seen"}
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    result = render(whole, run_folder, threads=1, simulated=simulated)
    assert result["pictures"] == len(result["seconds"]["pictures"]) == 4
    render(parts, run_folder, threads=2, first=3, last=4, simulated=simulated)
    assert sorted(pictures(parts / "turn")) == ["0003.png", "0004.png"]
    render(parts, run_folder, threads=2, first=1, last=2, simulated=simulated)
    for folder in ("turn", "seen"):
        assert pictures(whole / folder) == pictures(parts / folder)


def test_what_an_observer_sees_lies_beside_the_pictures(run_folder, tmp_path):
    render(tmp_path, run_folder, last=2, simulated={"deutan-1.0": "deutan", "protan-0.65": "protan"})
    for folder, observer in (("deutan", ("deutan", 1.0)), ("protan", ("protan", 0.65))):
        for name in ("0001.png", "0002.png"):
            picture, seen = (read_picture(tmp_path / where / name) for where in ("turn", folder))
            np.testing.assert_array_equal(seen, simulate_bytes(picture, *observer))
            assert np.abs(seen.astype(int) - picture).max() > 20, "something is seen otherwise"


def test_a_layer_that_the_run_does_not_have_is_refused(run_folder, tmp_path):
    with pytest.raises(InputError, match=r"no colour layer 'protan-1\.0'.*original, deutan-1\.0"):
        render(tmp_path, run_folder, layer="protan-1.0")
    with pytest.raises(InputError, match="'everyone' is no observer"):
        render(tmp_path, run_folder, simulated={"everyone": "seen"})
    assert not (tmp_path / "turn").exists()


def test_the_process_speaks_the_protocol_and_nothing_else(run_folder, tmp_path):
    command = [sys.executable, str(WORKER)]
    done = subprocess.run(
        command, input=request(tmp_path, run_folder, last=1), capture_output=True, text=True, timeout=60
    )
    events = [json.loads(line) for line in done.stdout.splitlines()]
    assert done.returncode == 0, done.stderr
    assert events[-1]["event"] == "result"
    assert events[-1]["pictures"] == 1
    assert {event["event"] for event in events} == {"status", "progress", "result"}


def test_cancelled_it_leaves_no_picture_half_written(run_folder, tmp_path):
    process = subprocess.Popen(
        [sys.executable, str(WORKER)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    process.stdin.write(request(tmp_path, run_folder, width=640, height_pixels=480))
    process.stdin.close()
    while "picture 1" not in process.stdout.readline():
        pass
    deadline = time.monotonic() + SOON
    while not (tmp_path / "turn").is_dir() and time.monotonic() < deadline:
        time.sleep(0.01)  # the folder is made just before the picture is rendered
    process.send_signal(signal.SIGINT)
    assert process.wait(timeout=SOON) == 130
    process.stdout.close()
    process.stderr.close()
    assert [path.name for path in (tmp_path / "turn").iterdir() if path.name.startswith(".")] == []


STARTER = """
import subprocess, sys
worker = subprocess.Popen([sys.executable, sys.argv[1]], stdin=subprocess.PIPE, text=True)
worker.stdin.write(sys.argv[2])
worker.stdin.close()
worker.wait()
"""


@pytest.mark.skipif(sys.platform == "win32", reason="a process that has lost its parent is not told there")
def test_it_ends_with_the_process_that_started_it(run_folder, tmp_path):
    endless = request(tmp_path, run_folder, frames=9999, last=9999)
    starter = subprocess.Popen(
        [sys.executable, "-c", STARTER, str(WORKER), endless], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    )
    while b"picture 2" not in starter.stdout.readline():
        pass  # a picture is announced before it is rendered: the first one lies there with the second one's message
    starter.kill()
    starter.wait()
    starter.stdout.read()  # until the worker, too, has closed it
    assert 0 < len(list((tmp_path / "turn").glob("*.png"))) < 9999
    assert not list((tmp_path / "turn").glob(".*"))
    starter.stdout.close()
