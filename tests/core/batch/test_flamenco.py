"""The Flamenco job and its type, compiled in Node with what Flamenco's Manager offers to job types."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from cvdgs.core.batch.export import JOB_FILE, JOB_TYPE, export_flamenco
from cvdgs.core.batch.task import Kind, Plan, Task, read_plan, task_command

NODE = shutil.which("node") or shutil.which("nodejs")
MANAGER = Path(__file__).with_name("flamenco_manager.js")

pytestmark = pytest.mark.skipif(NODE is None, reason="job types are JavaScript, and Node is not installed")

TURNTABLE = (
    Task("train-vase", Kind.TRAIN, gpu=1),
    Task("frames-vase-1", Kind.FRAMES, ("train-vase",)),
    Task("frames-vase-2", Kind.FRAMES, ("train-vase",)),
    Task("video-vase", Kind.VIDEO, ("frames-vase-1", "frames-vase-2")),
    Task("page", Kind.PAGE, ("video-vase",)),
)


@pytest.fixture
def folder(tmp_path):
    return export_flamenco(Plan(tmp_path / "summer collection", TURNTABLE))


def read_job(folder):
    return json.loads((folder / JOB_FILE).read_text(encoding="utf-8"))


def compiled(folder, **settings):
    """What the Manager makes of the job, with other settings where they are given."""
    job = read_job(folder)
    job["settings"] |= settings
    file = folder / "submitted.json"
    file.write_text(json.dumps(job), encoding="utf-8")
    node = subprocess.run(
        [NODE, MANAGER, folder / f"{job['type']}.js", file], capture_output=True, text=True, timeout=60
    )
    assert node.returncode == 0, node.stderr
    return json.loads(node.stdout)


def test_every_task_of_the_plan_becomes_a_task_of_the_farm_with_its_dependencies(folder):
    assert {task["name"]: tuple(task["dependencies"]) for task in compiled(folder)["tasks"]} == {
        task.name: task.after for task in TURNTABLE
    }


def test_the_workers_run_the_command_that_every_engine_runs(folder):
    job = read_job(folder)
    plan = Path(job["settings"]["plan"])
    for task in compiled(folder)["tasks"]:
        (command,) = task["commands"]
        assert command["name"] == "exec"
        parameters = command["parameters"]
        assert parameters.keys() == {"exe", "args"}
        assert [parameters["exe"], *parameters["args"]] == task_command(sys.executable, plan, task["name"])


def test_tasks_that_need_a_graphics_card_go_to_workers_that_have_one(folder):
    types = {task["name"]: task["type"] for task in compiled(folder, gpu_task_type="cuda")["tasks"]}
    assert types == {
        "train-vase": "cuda",
        "frames-vase-1": "blender",
        "frames-vase-2": "blender",
        "video-vase": "blender",
        "page": "misc",
    }


def test_settings_are_of_the_kinds_that_the_manager_knows(folder):
    """By the enumerations of AvailableJobSetting in Flamenco's pkg/api/flamenco-openapi.yaml."""
    for setting in compiled(folder)["type"]["settings"]:
        assert setting["type"] in {"string", "int32", "float", "bool"}
        assert setting.get("subtype", "file_path") in {"file_path", "dir_path", "file_name", "hashed_file_path"}
        assert setting.get("visible", "visible") in {"visible", "hidden", "submission", "web"}


def test_a_job_has_what_the_managers_api_requires(folder):
    """By SubmittedJob in Flamenco's pkg/api/flamenco-openapi.yaml; platforms are called as in Go."""
    job = read_job(folder)
    assert {"name", "type", "priority", "submitter_platform"} <= set(job)
    assert 0 <= job["priority"] <= 100
    assert job["submitter_platform"] in {"linux", "windows", "darwin"}


def test_a_job_has_every_setting_that_its_type_requires_and_no_unknown_one(folder):
    settings = {setting["key"]: setting for setting in compiled(folder)["type"]["settings"]}
    given = set(read_job(folder)["settings"])
    assert {key for key, setting in settings.items() if setting.get("required")} <= given <= set(settings)


def test_the_job_names_its_type(folder):
    assert read_job(folder)["type"] == JOB_TYPE
    assert (folder / f"{JOB_TYPE}.js").is_file()


def test_the_job_keeps_the_plan_that_it_was_made_from(folder):
    assert read_plan(Path(read_job(folder)["settings"]["plan"])).tasks == TURNTABLE
