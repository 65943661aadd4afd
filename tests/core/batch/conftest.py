"""Batches whose workers and Blender are small programs that behave and misbehave in known ways."""

import json
import os
import subprocess
import sys
import textwrap
import time
from dataclasses import dataclass
from pathlib import Path

import pytest

from cvdgs.core.bootstrap import ROOT
from cvdgs.core.runs.report import SCHEMA
from cvdgs.core.settings import Settings

from ...patience import SOON

REPORT = {
    "schema": SCHEMA, "versions": {"cvdgs": "0"}, "device": "cpu", "gaussians": 5, "sh_degree": 0,
    "capture": {"format": "colmap", "views": 9, "train": 7, "test": 2, "width": 64, "height": 48, "points": 5},
    "seconds": {"capture": 1.0, "blender": None, "total": None}, "peak_memory_mb": 1,
    "reconstruction": {"psnr": None, "ssim": 0.5}, "views_shown": [], "notes": {}, "warnings": [], "curve": [],
}  # fmt: skip

KINDS = dict.fromkeys(("input", "enhanced", "unenhanced", "rendered"))
LAYER = {
    "ccpr": {**KINDS, "tau": 6}, "ccpr_mean": KINDS, "ssim_simulated": KINDS, "psnr_to_enhanced": None,
    "naturalness": {"ssim": None, "delta_e": None}, "rwe": {"ratio": None, "enhanced_ratio": None},
}  # fmt: skip

# What both programs do: say that they began and ended, and misbehave as the file "behaviour" in the capture says. A
# behaviour holds until the file is removed; "once:" removes it.
PROLOGUE = f"""\
#!{sys.executable}
import json, os, signal, sys, time
from pathlib import Path

def emit(event, **fields):
    print(json.dumps({{"event": event, **fields}}), flush=True)

def note(what):
    with open(os.environ["DIARY"], "a") as diary:
        diary.write(json.dumps({{"what": what, "pid": os.getpid(), "at": time.time(), "subject": SUBJECT,
            "threads": os.environ.get("OMP_NUM_THREADS"), "cards": os.environ.get("CUDA_VISIBLE_DEVICES")}}) + "\\n")

def behave(file):
    note("begin")
    behaviour = file.read_text().strip() if file.exists() else ""
    if behaviour.startswith("once:"):
        file.unlink()
    behaviour = behaviour.removeprefix("once:")
    if behaviour == "refuse":
        emit("error", kind="input", message="photos: all black - use a light")
        sys.exit(2)
    if behaviour == "break":
        emit("error", kind="defect", message="ValueError: odd")
        sys.exit(1)
    if behaviour == "die":
        os.kill(os.getpid(), signal.SIGKILL)
    if behaviour.startswith("sleep"):
        time.sleep(float(behaviour.split()[1]))
    if behaviour.startswith("meet"):  # goes on when so many have begun
        while Path(os.environ["DIARY"]).read_text().count('"begin"') < int(behaviour.split()[1]):
            time.sleep(0.02)

request = json.loads(sys.stdin.readline())
"""

WORKER = (
    PROLOGUE
    + f"""
REPORT, LAYER = {REPORT!r}, {LAYER!r}
if request["job"] == "inspect-all":
    if any((Path(entry["capture"]) / "slow").exists() for entry in request["captures"]):
        time.sleep(60.0)
    emit("result", refusals=[None for _ in request["captures"]])
    sys.exit(0)
settings, folder = request["settings"], Path(request["folder"])
SUBJECT = Path(settings["capture"]).name
emit("status", stage="geometry", message="goes on" if request.get("checkpoint", dict()).get("resume") else "training")
behave(Path(settings["capture"]) / "behaviour")
(folder / "capture").mkdir(exist_ok=True)
(folder / "capture" / "transforms.json").write_text("{{}}")
(folder / "splats.ply").write_text(json.dumps(settings["iterations"]))
earlier = json.loads((folder / "report.json").read_text()) if settings["resume"] else dict(REPORT, layers={{}})
made = {{}}
for layer in settings["layers"]:
    name = f"{{layer['cvd']}}-{{layer['severity']:.1f}}"
    (folder / f"splats.{{name}}.ply").write_text(name)
    made[name] = LAYER
note("end")
emit("result", report=dict(earlier, settings=settings, layers={{**earlier["layers"], **made}}))
"""
)

BLENDER = (
    PROLOGUE
    + """
arguments, out = request["arguments"], Path(request["out"])
SUBJECT = arguments["folder"]
behave(out / arguments["run"] / "behaviour")
folders = [arguments["folder"], *arguments["simulated"].values()]
for number in range(arguments["first"], arguments["last"] + 1):
    for folder in folders:
        picture = out / folder / f"{number:04d}.png"
        picture.parent.mkdir(parents=True, exist_ok=True)
        picture.with_suffix(".partial").write_text(f"{folder} {number}")
        os.replace(picture.with_suffix(".partial"), picture)
    emit("progress", stage="frames", fraction=1.0, seconds_left=0.0, message="")
note("end")
emit("result", pictures=1, seconds={"loading": 0.1, "pictures": [0.1]})
"""
)


@dataclass
class Collection:
    """A folder of captures, with the programs that render them."""

    folder: Path

    def __post_init__(self):
        for name, body in (("worker", WORKER), ("blender", BLENDER)):
            program = self.folder / name
            program.write_text(body)
            program.chmod(0o755)

    @property
    def variables(self) -> dict[str, str]:
        return {
            "CVDGS_PYTHON": str(self.folder / "worker"),
            "CVDGS_BLENDER": str(self.folder / "blender"),
            "DIARY": str(self.folder / "diary"),
        }

    @property
    def out(self) -> Path:
        return self.folder / "out"

    def add_capture(self, name: str, behaviour: str = "") -> Path:
        capture = self.folder / name
        capture.mkdir()
        (capture / "photo.png").write_bytes(b"pixels of " + name.encode())
        if behaviour:
            (capture / "behaviour").write_text(behaviour)
        return capture

    def add_finished_run(self, name: str, *layers: str) -> Path:
        run = self.folder / name
        (run / "capture").mkdir(parents=True)
        (run / "capture" / "transforms.json").write_text("{}")
        settings = Settings("photographs", str(run)).to_dict()
        report = {**REPORT, "settings": settings, "layers": dict.fromkeys(layers, LAYER)}
        (run / "report.json").write_text(json.dumps(report))
        for file in ("splats.ply", *(f"splats.{layer}.ply" for layer in layers)):
            (run / file).write_text(file)
        return run

    def write_batch(self, text: str) -> Path:
        """A batch of frames alone, of one layer, unless `text` says otherwise."""
        usual = 'outputs = ["frames"]\nlayers = ["deutan"]\n' if "outputs" not in text else ""
        path = self.folder / "batch.toml"
        path.write_text(usual + textwrap.dedent(text))
        return path

    def start(self, *options: str, cores: int = 2) -> subprocess.Popen:
        script = str(ROOT / "scripts" / "turntable.py")
        command = [sys.executable, script, str(self.folder / "batch.toml"), "--out", str(self.out), "--json"]
        return subprocess.Popen(
            [*command, "--cores", str(cores), *options],
            env={**os.environ, **self.variables},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def run(self, *options: str, cores: int = 2) -> tuple[int, list[dict]]:
        """Exit code and events of scripts/turntable.py."""
        process = self.start(*options, cores=cores)
        output, complaints = process.communicate(timeout=60)
        assert not complaints, complaints
        return process.returncode, [json.loads(line) for line in output.splitlines()]

    @property
    def diary(self) -> list[dict]:
        """What the programs noted when they began and ended."""
        path = self.folder / "diary"
        return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []

    def wait_for(self, condition, seconds: float = SOON) -> None:
        deadline = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < deadline, "it did not happen"
            time.sleep(0.05)


@pytest.fixture
def collection(tmp_path):
    return Collection(tmp_path)
