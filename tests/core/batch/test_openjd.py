"""The Open Job Description bundle, judged by the reference implementation (openjd-model and the openjd command)."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip("openjd.model", reason="the farm's libraries are not installed (pip install cvdgs[farm])")
from openjd.model import (
    StepDependencyGraph,
    StepParameterSpaceIterator,
    create_job,
    decode_job_template,
    preprocess_job_parameters,
)

from cvdgs.core.batch.export import export_openjd, job_template
from cvdgs.core.batch.task import Kind, Plan, Task, read_plan

TURNTABLE = (
    Task("train-vase", Kind.TRAIN, item="vase", cores=2, memory_mb=4000, gpu=1),
    Task("frames-vase-1", Kind.FRAMES, ("train-vase",), item="vase"),
    Task("frames-vase-2", Kind.FRAMES, ("train-vase",), item="vase"),
    Task("video-vase", Kind.VIDEO, ("frames-vase-1", "frames-vase-2"), item="vase"),
    Task("page", Kind.PAGE, ("video-vase",)),
)


def job_of(plan):
    template = decode_job_template(template=job_template(plan))
    values = preprocess_job_parameters(
        job_template=template,
        job_parameter_values={},
        job_template_dir=plan.out,
        current_working_dir=plan.out,
    )
    return create_job(job_template=template, job_parameter_values=values)


def tasks_of(step):
    return [values["Task"].value for values in StepParameterSpaceIterator(space=step.parameterSpace)]


@st.composite
def plans(draw):
    """Plans of any shape: each task waits for some of those before it."""
    tasks = []
    for number in range(draw(st.integers(1, 12))):
        after = tuple(sorted(draw(st.sets(st.sampled_from([task.name for task in tasks]))))) if tasks else ()
        kind, item = draw(st.sampled_from(list(Kind))), draw(st.sampled_from(["", "vase", "x" * 80]))
        cores, memory, gpu = draw(st.tuples(st.integers(1, 4), st.sampled_from([0, 2000]), st.integers(0, 1)))
        tasks.append(Task(f"t{number}", kind, after, item=item, cores=cores, memory_mb=memory, gpu=gpu))
    return Plan(Path("batch").absolute(), tuple(tasks))


def openjd(*arguments, **variables):
    command = [sys.executable, "-m", "openjd", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, env={**os.environ, **variables})


def pictures(folder):
    return {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*.png")}


@settings(max_examples=30, deadline=None)
@given(plans())
def test_every_task_is_in_exactly_one_step_and_comes_after_those_that_it_waits_for(plan):
    order = [name for step in StepDependencyGraph(job=job_of(plan)).topo_sorted() for name in tasks_of(step)]
    assert sorted(order) == sorted(task.name for task in plan.tasks)
    assert all(order.index(earlier) < order.index(task.name) for task in plan.tasks for earlier in task.after)


@settings(max_examples=30, deadline=None)
@given(plans())
def test_a_step_asks_for_the_machine_that_each_of_its_tasks_needs(plan):
    for step in job_of(plan).steps:
        asked = {amount.name: amount.min for amount in step.hostRequirements.amounts}
        for task in map(plan.task, tasks_of(step)):
            assert asked["amount.worker.vcpu"] == task.cores
            assert asked.get("amount.worker.memory", 0) == task.memory_mb
            assert asked.get("amount.worker.gpu", 0) == task.gpu


def test_the_chunks_of_a_turntable_are_one_step(tmp_path):
    steps = job_of(Plan(tmp_path, TURNTABLE)).steps
    assert [len(tasks_of(step)) for step in steps] == [1, 2, 1, 1]


def test_more_chunks_than_a_step_may_have_become_several_steps(tmp_path):
    plan = Plan(tmp_path, tuple(Task(f"frames-{n}", Kind.FRAMES, item="vase") for n in range(2500)))
    assert [len(tasks_of(step)) for step in job_of(plan).steps] == [1024, 1024, 452]


def test_an_items_failure_does_not_stop_another_item(tmp_path):
    other = tuple(
        replace(
            t, name=t.name.replace("vase", "rug"), item="rug", after=tuple(a.replace("vase", "rug") for a in t.after)
        )
        for t in TURNTABLE[:-1]
    )
    job = job_of(Plan(tmp_path, (*TURNTABLE[:-1], *other)))
    for step in job.steps:
        item = step.name.split()[-1]
        assert all(edge.dependsOn.endswith(item) for edge in step.dependencies or [])


def test_the_command_accepts_the_bundle(tmp_path):
    checked = openjd("check", export_openjd(Plan(tmp_path, TURNTABLE)))
    assert checked.returncode == 0, checked.stdout


def test_the_bundle_keeps_the_plan_that_it_was_made_from(tmp_path):
    plan = Plan(tmp_path, TURNTABLE)
    template = export_openjd(plan)
    (name,) = [p["default"] for p in json.loads(template.read_text())["parameterDefinitions"] if p["name"] == "Plan"]
    assert read_plan(template.parent / name) == plan


def test_the_command_makes_the_files_that_one_machine_makes(collection):
    collection.add_capture("chair")
    collection.write_batch('[turntable]\nframes = 4\nchunk = 2\nsize = [32, 24]\n[[items]]\ncapture = "chair"\n')
    assert collection.run()[0] == 0
    made = pictures(collection.out)
    collection.out.rename(collection.folder / "made by one machine")
    collection.start("--export", "openjd").wait(timeout=60)
    ran = openjd("run", collection.out / "openjd" / "template.json", **collection.variables)
    assert ran.returncode == 0, ran.stdout
    assert made == pictures(collection.out)
