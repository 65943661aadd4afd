"""From a batch to its tasks: what there is, in which order, from which files, for which machines."""

import json
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cvdgs.core.batch.model import Batch, Item, Needs, Output, TurntableSettings
from cvdgs.core.batch.plan import make_plan
from cvdgs.core.batch.progress import estimated_seconds, measured_pace
from cvdgs.core.batch.records import fingerprint
from cvdgs.core.batch.task import Kind, Plan, Task, expand, plan_path, read_plan, write_plan
from cvdgs.core.errors import InputError
from cvdgs.core.rendering.requests import CameraPath
from cvdgs.core.runtime.resources import Resources
from cvdgs.core.settings import Settings

from ...effort import function_calls

SMALL = TurntableSettings(frames=5, chunk=2, size=(64, 48))
MACHINE = Resources(cores=4, memory_mb=8192, gpus=0)


@pytest.fixture
def chair(tmp_path):
    capture = tmp_path / "chair"
    capture.mkdir()
    layers = ("original", "deutan-1.0", "protan-0.6")
    return Item("chair", capture, None, layers, (), (CameraPath(),), SMALL, {}, frozenset(Output))


def planned(tmp_path, *items: Item, **others) -> Plan:
    return make_plan(Batch("Title", items), tmp_path / "out", **others)


def of_kind(plan: Plan, kind: Kind) -> list[Task]:
    return [task for task in plan.tasks if task.kind is kind]


def test_an_item_is_trained_once_and_every_layer_rendered_in_chunks(tmp_path, chair):
    plan = planned(tmp_path, chair)
    assert len(of_kind(plan, Kind.TRAIN)) == 1
    assert [task.arguments["settings"]["layers"][0]["cvd"] for task in of_kind(plan, Kind.LAYER)] == [
        "deutan",
        "protan",
    ]
    chunks = [task for task in of_kind(plan, Kind.FRAMES) if task.arguments["layer"] == "deutan-1.0"]
    assert [(task.arguments["first"], task.arguments["last"]) for task in chunks] == [(1, 2), (3, 4), (5, 5)]
    assert len(of_kind(plan, Kind.FRAMES)) == 3 * 3
    assert len(of_kind(plan, Kind.SHEET)) == len(of_kind(plan, Kind.PAGE)) == 1


def test_captures_layers_engines_and_cameras_multiply(tmp_path, chair):
    both = replace(chair, turntable=replace(SMALL, engines=("cycles", "eevee")))
    both = replace(both, cameras=(CameraPath(name="low"), CameraPath(name="high", height=1.0)))
    sofa = replace(both, name="sofa")
    folders = {task.arguments["folder"] for task in of_kind(planned(tmp_path, both, sofa), Kind.FRAMES)}
    assert len(folders) == 2 * 3 * 2 * 2
    assert "sofa/protan-0.6/eevee-high/frames" in folders


def test_whatever_a_task_needs_from_the_batch_is_made_by_one_before_it(tmp_path, chair):
    plan = planned(tmp_path, chair, replace(chair, name="sofa"))
    before: dict[str, set[str]] = {}
    made: dict[str, set[str]] = {}
    for task in plan.tasks:
        before[task.name] = set(task.after).union(*(before[name] for name in task.after))
        made[task.name] = {name for path in task.outputs for name in expand(path)}
        available = set().union(*(made[name] for name in before[task.name]))
        needed = {name for path in task.inputs if not path.startswith("/") for name in expand(path)}
        if task.kind is Kind.PAGE:
            needed = {
                name for name in needed if not name.endswith(("report.json", "viewer.html"))
            }  # made along with the run
        assert needed <= available, task.name


def test_no_two_tasks_leave_the_same_picture(tmp_path, chair):
    plan = planned(tmp_path, chair, replace(chair, name="sofa"))
    files = [str(path) for task in plan.tasks if task.kind is not Kind.LAYER for path in task.output_paths(plan.out)]
    assert len(set(files)) == len(files)


def test_layers_of_a_run_are_added_one_after_the_other(tmp_path, chair):
    plan = planned(tmp_path, chair)
    first, second = of_kind(plan, Kind.LAYER)
    assert first.after == ("chair.train",)
    assert second.after == (first.name,)


def test_the_original_is_seen_by_all_observers_and_a_layer_by_its_own(tmp_path, chair):
    seen = {
        task.arguments["layer"]: set(task.arguments["simulated"])
        for task in of_kind(planned(tmp_path, chair), Kind.FRAMES)
    }
    assert seen == {
        "original": {"deutan-1.0", "protan-0.6"},
        "deutan-1.0": {"deutan-1.0"},
        "protan-0.6": {"protan-0.6"},
    }


def test_pictures_side_by_side_say_what_they_are(tmp_path, chair):
    videos = {task.name: task.arguments for task in of_kind(planned(tmp_path, chair), Kind.VIDEO)}
    assert videos["chair.original.cycles-turn.video"]["captions"] == ("",)
    assert videos["chair.protan-0.6.cycles-turn.side-by-side.protan-0.6"]["captions"] == (
        "Enhanced",
        "Enhanced, as protan vision of severity 0.6 sees it",
    )
    assert videos["chair.original.cycles-turn.side-by-side.deutan-1.0"]["captions"] == (
        "Original",
        "Original, as deutan vision sees it",
    )


def test_only_what_is_asked_for_is_made(tmp_path, chair):
    plan = planned(tmp_path, replace(chair, outputs=frozenset({Output.FRAMES})))
    assert {task.kind for task in plan.tasks} == {Kind.TRAIN, Kind.LAYER, Kind.FRAMES}
    assert not any(task.arguments["simulated"] for task in of_kind(plan, Kind.FRAMES))


def test_a_finished_run_that_lacks_nothing_needs_frames_alone(tmp_path, chair):
    finished = replace(chair, capture=None, run=tmp_path / "run", present=("deutan-1.0", "protan-0.6"))
    plan = planned(tmp_path, finished)
    assert not of_kind(plan, Kind.TRAIN)
    assert not of_kind(plan, Kind.LAYER)
    assert {task.arguments["run"] for task in of_kind(plan, Kind.FRAMES)} == {str(tmp_path / "run")}


def test_a_layer_for_a_finished_run_takes_what_the_run_leaves_open(tmp_path, chair):
    train = {"enhancer": "cgan", "strength": 0.5, "change_budget": 3.0, "fit": 7, "device": "cpu", "iterations": 9}
    finished = replace(chair, capture=None, run=tmp_path / "run", present=("deutan-1.0",), train=train)
    (added,) = of_kind(planned(tmp_path, finished), Kind.LAYER)
    settings = added.arguments["settings"]
    assert {name: settings[name] for name in train} == {**train, "iterations": Settings.iterations}


def test_a_copy_of_a_finished_run_depends_on_all_that_is_rendered_of_it(tmp_path, chair):
    finished = replace(chair, capture=None, run=tmp_path / "run", present=("deutan-1.0",))
    plan = planned(tmp_path, finished)
    (added,) = of_kind(plan, Kind.LAYER)
    files = ("splats.ply", "capture/transforms.json", "splats.deutan-1.0.ply")
    assert set(added.inputs) == {f"{tmp_path}/run/{file}" for file in files}
    needed = {path for task in of_kind(plan, Kind.FRAMES) for path in task.inputs}
    assert needed <= set(added.outputs)


@pytest.mark.parametrize("simulation", ["machado", "brettel"])
def test_simulated_pictures_are_made_anew_for_another_model(tmp_path, chair, simulation):
    """Also those of the original colours, which a run with another model has to the last bit."""
    run = tmp_path / "run"
    run.mkdir()
    (run / "report.json").write_text(json.dumps({"settings": {"simulation": simulation}}))
    finished = replace(chair, capture=None, run=run, present=("deutan-1.0", "protan-0.6"))
    for item in (finished, replace(chair, train={"simulation": simulation})):
        plan, usual = planned(tmp_path, item), planned(tmp_path, chair)
        assert {task.arguments["model"] for task in of_kind(plan, Kind.FRAMES)} == {simulation}
        if item.capture is not None:
            pairs = zip(of_kind(plan, Kind.FRAMES), of_kind(usual, Kind.FRAMES), strict=True)
            assert {fingerprint(task) == fingerprint(other) for task, other in pairs} == {simulation == "machado"}


def test_the_captures_of_a_model_and_of_a_video_are_whole(tmp_path, chair):
    model, video = tmp_path / "walk" / "sparse" / "0", tmp_path / "film" / "walk.mp4"
    for file in (model / "cameras.bin", model.parents[1] / "images" / "1.jpg", video, video.parent / "masks/walk.png"):
        file.parent.mkdir(parents=True, exist_ok=True)
        file.touch()
    for capture, inputs in (
        (model, (str(tmp_path / "walk"),)),
        (video, (str(video), str(tmp_path / "film" / "masks" / "walk.png"))),
    ):
        (train,) = of_kind(planned(tmp_path, replace(chair, capture=capture)), Kind.TRAIN)
        assert train.inputs == inputs


def test_a_task_depends_on_the_weights_and_the_cameras_that_its_options_name(tmp_path, chair):
    named = replace(chair, train={"enhancer": "/a/own.safetensors", "cameras": "/a/cameras", "mode": "post"})
    (train,) = of_kind(planned(tmp_path, named), Kind.TRAIN)
    assert train.inputs == (str(chair.capture), "/a/own.safetensors", "/a/cameras")
    finished = replace(named, capture=None, run=tmp_path / "run")
    for added in of_kind(planned(tmp_path, finished), Kind.LAYER):
        assert "/a/own.safetensors" in added.inputs
        assert "/a/cameras" not in added.inputs  # the run has its own
    (train,) = of_kind(planned(tmp_path, replace(chair, train={"enhancer": "cgan", "cameras": "given"})), Kind.TRAIN)
    assert train.inputs == (str(chair.capture),)


def test_the_page_of_a_batch_waits_for_everything_but_forgives_failures(tmp_path, chair):
    plan = planned(tmp_path, chair, replace(chair, name="sofa"))
    page = plan.tasks[-1]
    assert page.kind.tolerates_failures
    assert set(page.after) == {task.name for task in plan.tasks[:-1]}
    assert not any(task.kind.tolerates_failures for task in plan.tasks[:-1])


@pytest.mark.parametrize(("device", "cards", "needed"), [("auto", 0, 0), ("auto", 2, 1), ("cuda", 0, 1), ("cpu", 2, 0)])
def test_training_takes_a_graphics_card_where_it_may(tmp_path, chair, device, cards, needed):
    plan = planned(tmp_path, replace(chair, train={"device": device}), graphics_cards=cards)
    assert of_kind(plan, Kind.TRAIN)[0].gpu == needed
    assert of_kind(plan, Kind.FRAMES)[0].gpu == 0


def test_a_plan_is_read_as_it_was_written_wherever_the_folder_lies(tmp_path, chair):
    plan = planned(tmp_path, chair)
    write_plan(plan)
    plan.out.rename(tmp_path / "elsewhere")
    read = read_plan(plan_path(tmp_path / "elsewhere"))
    assert read.out == tmp_path / "elsewhere"
    assert json.dumps([task.to_dict() for task in read.tasks]) == json.dumps([task.to_dict() for task in plan.tasks])
    assert read.retries == plan.retries


@pytest.mark.parametrize("text", ["", "[]", '{"format": 1}', '{"format": 9, "tasks": [], "retries": 1}'])
def test_a_damaged_plan_is_refused_in_one_line(tmp_path, text):
    (tmp_path / "plan.json").write_text(text)
    with pytest.raises(InputError) as refusal:
        read_plan(tmp_path / "plan.json")
    assert len(str(refusal.value).splitlines()) == 1


@pytest.mark.parametrize("name", ["../escape", "a/b", "", ".hidden", "a b"])
def test_a_task_whose_name_leads_out_of_its_folder_is_refused(name):
    with pytest.raises(ValueError, match="not a valid task name"):
        Task(name, Kind.VIDEO)


@pytest.mark.parametrize("place", ["../precious.html", "/home/precious.html", "chair\\..\\..\\precious", "C:precious"])
@pytest.mark.parametrize(
    ("kind", "arguments"),
    [
        (Kind.PAGE, lambda place: {"file": place}),
        (Kind.FRAMES, lambda place: {"folder": "chair/frames", "simulated": {"deutan-1.0": place}}),
        (Kind.FRAMES, lambda place: {"folder": place, "simulated": {}}),
        (Kind.TRAIN, lambda place: {"settings": {"out": place}}),
    ],
)
def test_a_plan_from_elsewhere_that_would_write_outside_of_its_folder_is_refused(tmp_path, kind, arguments, place):
    task = Task("chair", kind, outputs=("index.html",)).to_dict()
    plan = {"format": 1, "retries": 1, "tasks": [{**task, "arguments": arguments(place)}]}
    (tmp_path / "plan.json").write_text(json.dumps(plan))
    with pytest.raises(InputError, match=r"the plan is damaged .* lies outside of the batch's folder"):
        read_plan(tmp_path / "plan.json")


def test_a_plan_whose_tasks_wait_for_later_ones_is_refused(tmp_path):
    with pytest.raises(ValueError, match="before"):
        Plan(tmp_path, (Task("a", Kind.VIDEO, after=("b",)), Task("b", Kind.VIDEO)))


@given(st.integers(0, 9999), st.integers(0, 30))
def test_a_range_of_pictures_is_every_number_with_its_digits(first, more):
    last = min(first + more, 9999)
    names = expand(f"a/{{{first:04d}..{last:04d}}}.png")
    assert [int(name[2:6]) for name in names] == list(range(first, last + 1))
    assert {len(name) for name in names} == {len("a/0000.png")}


def test_more_cores_never_make_the_estimate_longer(tmp_path, chair):
    plan = planned(tmp_path, *(replace(chair, name=f"chair{number}") for number in range(5)))
    times = [estimated_seconds(plan, replace(MACHINE, cores=cores), {}, set()) for cores in (1, 2, 4, 8, 64)]
    assert times == sorted(times, reverse=True)
    assert times[0] > times[-1]


def test_what_is_done_takes_no_time_and_measured_times_replace_estimates(tmp_path, chair):
    plan = planned(tmp_path, chair)
    assert estimated_seconds(plan, MACHINE, {}, {task.name for task in plan.tasks}) == 0.0
    whole = estimated_seconds(plan, MACHINE, {}, set())
    assert estimated_seconds(plan, MACHINE, dict.fromkeys(Kind, 2.0), set()) == pytest.approx(2.0 * whole)
    assert measured_pace(plan.tasks, plan.out) == {}


def test_what_a_task_may_take_makes_no_other_pictures(tmp_path, chair):
    def with_cores(cores: int) -> Task:
        batch = Batch("Title", (chair,), needs=Needs(frame_cores=cores))
        return of_kind(make_plan(batch, tmp_path / "out"), Kind.FRAMES)[0]

    assert with_cores(8).cores == 8
    assert fingerprint(with_cores(8)) == fingerprint(with_cores(1))


def test_an_item_among_a_thousand_is_planned_with_no_more_effort_than_among_ten(tmp_path, chair):
    def plan_items(count: int) -> None:
        items = (replace(chair, name=f"item-{number}", turntable=TurntableSettings()) for number in range(count))
        assert len(planned(tmp_path, *items).tasks) == count * (1 + 2 + 3 * 4 + 3 + 4 + 1) + 1

    assert function_calls(lambda: plan_items(1000)) < 105 * function_calls(lambda: plan_items(10))
