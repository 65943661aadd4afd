"""scripts/turntable.py on one machine: what is done, what is kept, what happens when something fails or is killed."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from cvdgs.core.batch.task import read_plan
from cvdgs.core.bootstrap import ROOT
from cvdgs.core.pipeline.continuation import describe_run
from cvdgs.core.runtime.resources import CARDS_VARIABLE
from cvdgs.core.settings import Settings

from ...patience import SOON
from .outcomes import contents, ends

TURNTABLE = "[turntable]\nframes = 4\nchunk = 4\nsize = [32, 24]\n"
ONE = TURNTABLE + '[[items]]\ncapture = "chair"\n'
CHAIR_FRAMES = "chair.deutan-1.0.cycles-turn.frames.0001-0004"
TWO = ONE + '[[items]]\ncapture = "sofa"\n'


def is_alive(process: int) -> bool:
    try:
        state = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return False
    return state != "Z"


def test_a_batch_makes_every_picture_and_then_only_what_is_missing(collection):
    for name in ("chair", "sofa"):
        collection.add_capture(name)
    collection.write_batch(TWO)
    code, events = collection.run()
    assert code == 0
    assert set(ends(events).values()) == {"done"}
    assert events[-1]["items"] == {"chair": True, "sofa": True}
    made = contents(collection.out)
    assert len(made) == 2 * 4

    diary = collection.diary
    code, events = collection.run()
    assert code == 0
    assert set(ends(events).values()) == {"kept"}
    assert collection.diary == diary

    (collection.out / "chair/deutan-1.0/cycles-turn/frames/0003.png").unlink()
    _, events = collection.run()
    assert [task for task, state in ends(events).items() if state == "done"] == [CHAIR_FRAMES]
    assert contents(collection.out) == made


@pytest.mark.slow
def test_a_changed_photograph_makes_a_new_run_and_new_gaussians_new_pictures(collection):
    capture = collection.add_capture("chair")
    collection.write_batch(ONE)
    collection.run()
    (capture / "photo.png").write_bytes(b"another")
    _, events = collection.run()
    assert ends(events)["chair.train"] == "done"
    assert ends(events)[CHAIR_FRAMES] == "kept"  # the worker of this test makes the same Gaussians of it
    collection.write_batch(ONE + "train.iterations = 8\n")
    _, events = collection.run()
    assert ends(events)["chair.train"] == "done"
    assert ends(events)[CHAIR_FRAMES] == "done"


@pytest.mark.parametrize("goes_on", [True, False])
def test_a_training_that_was_cancelled_goes_on_if_the_file_still_asks_for_the_same(collection, goes_on):
    capture = collection.add_capture("chair")
    checkpoint = collection.out / "chair" / "run" / ".checkpoint"
    checkpoint.mkdir(parents=True)
    begun = Settings(str(capture), str(checkpoint.parent), iterations=20_000, blend=False)
    (checkpoint / "run.json").write_text(json.dumps(describe_run(begun)))
    (checkpoint / "state.safetensors").touch()
    collection.write_batch(ONE + ("train.iterations = 20000\n" if goes_on else ""))
    collection.run()
    assert (collection.out / "chair/run/splats.ply").read_text() == ("20000" if goes_on else f"{Settings.iterations}")
    log = (collection.out / "chair/run/run.log").read_text()
    assert ("goes on" in log) is goes_on


def test_a_further_layer_is_added_without_training_again(collection):
    collection.add_capture("chair")
    collection.write_batch(ONE)
    collection.run()
    collection.write_batch('outputs = ["frames"]\nlayers = ["protan-0.6", "deutan"]\n' + ONE)
    code, events = collection.run()
    states = ends(events)
    assert code == 0
    assert states["chair.train"] == "kept"
    assert states["chair.layer.protan-0.6"] == "done"
    assert states[CHAIR_FRAMES] == "kept"
    assert states["chair.protan-0.6.cycles-turn.frames.0001-0004"] == "done"
    assert sorted(json.loads((collection.out / "chair/run/report.json").read_text())["layers"]) == [
        "deutan-1.0",
        "protan-0.6",
    ]


def test_a_finished_run_is_taken_as_it_is_and_a_layer_that_it_lacks_is_added_to_a_copy(collection):
    finished = collection.add_finished_run("finished", "deutan-1.0")
    files = {path: path.stat().st_mtime_ns for path in finished.rglob("*")}
    collection.write_batch(TURNTABLE + '[[items]]\nrun = "finished"\nlayers = ["original", "deutan"]\n')
    code, events = collection.run()
    assert code == 0
    assert {task.partition(".frames")[0] for task in ends(events)} == {
        "finished.original.cycles-turn",
        "finished.deutan-1.0.cycles-turn",
    }
    collection.write_batch(TURNTABLE + '[[items]]\nrun = "finished"\nlayers = ["deutan", "tritan"]\n')
    code, events = collection.run()
    assert code == 0
    assert ends(events)["finished.layer.tritan-1.0"] == "done"
    assert (collection.out / "finished/tritan-1.0/cycles-turn/frames/0001.png").exists()
    assert {path: path.stat().st_mtime_ns for path in finished.rglob("*")} == files


def test_a_layer_whose_file_was_lost_is_made_again_without_training(collection):
    collection.add_capture("chair")
    collection.write_batch(ONE)
    collection.run()
    lost = collection.out / "chair/run/splats.deutan-1.0.ply"
    content = lost.read_bytes()
    lost.unlink()
    code, events = collection.run()
    assert code == 0
    assert [task for task, state in ends(events).items() if state == "done"] == ["chair.layer.deutan-1.0"]
    assert lost.read_bytes() == content


def test_a_layer_whose_file_was_lost_is_added_to_a_copy_of_a_finished_run(collection):
    finished = collection.add_finished_run("finished", "deutan-1.0")
    (finished / "splats.deutan-1.0.ply").unlink()
    collection.write_batch(TURNTABLE + '[[items]]\nrun = "finished"\nlayers = ["deutan"]\n')
    code, events = collection.run()
    assert code == 0
    assert ends(events)["finished.layer.deutan-1.0"] == "done"
    assert (collection.out / "finished/run/splats.deutan-1.0.ply").is_file()
    assert not (finished / "splats.deutan-1.0.ply").exists()


@pytest.mark.parametrize(("behaviour", "said"), [("break", "ValueError: odd"), ("refuse", "black")])
def test_an_item_that_fails_does_not_stop_the_others(collection, behaviour, said):
    collection.add_capture("chair", behaviour)
    collection.add_capture("sofa")
    collection.write_batch(TWO)
    code, events = collection.run()
    result = events[-1]
    assert code == 3
    assert result["items"] == {"chair": False, "sofa": True}
    assert [failed["task"] for failed in result["failed"]] == ["chair.train"]
    assert said in result["failed"][0]["message"]
    assert said in Path(result["failed"][0]["log"]).read_text()
    assert ends(events)[CHAIR_FRAMES] == "blocked"
    attempts = [entry["what"] for entry in collection.diary if entry["subject"] == "chair"]
    assert len(attempts) == {"break": 2, "refuse": 1}[behaviour]  # unusable input is the same the next time


def test_a_task_that_fails_once_is_tried_again(collection):
    collection.add_capture("chair", "once:break")
    collection.write_batch(ONE)
    code, events = collection.run()
    assert code == 0
    warnings = [event["name"] for event in events if event["event"] == "warning"]
    assert [name for name in warnings if name != "no-web-page"] == ["task-retried"]  # the stub's Gaussians are text


@pytest.mark.parametrize("out", [".", "chair", "chair/show", "missing/../chair/show", "link/show"])
def test_results_inside_of_a_capture_are_refused_however_the_folder_is_called(collection, out):
    chair = collection.add_capture("chair")
    (collection.folder / "link").symlink_to(chair)
    collection.write_batch('[[items]]\ncapture = "chair"\n')
    code, (*_, refusal) = collection.run("--out", str(collection.folder / out))
    assert code == 2
    assert f"results would lie in {chair}" in refusal["message"]
    assert sorted(path.name for path in chair.iterdir()) == ["photo.png"]


def test_results_inside_of_a_run_that_lacks_a_layer_are_refused(collection):
    run = collection.add_finished_run("out/chair/run", "protan-1.0")
    collection.write_batch('[[items]]\nname = "chair"\nrun = "out/chair/run"\n')
    code, (*_, refusal) = collection.run()
    assert code == 2
    assert f"results would lie in {run}" in refusal["message"]


def test_results_may_lie_beside_what_they_are_made_from(collection):
    (collection.out / "chair").mkdir(parents=True)
    collection.add_capture("out/chair/photos")
    collection.write_batch(TURNTABLE + '[[items]]\nname = "chair"\ncapture = "out/chair/photos"\n')
    assert collection.run()[0] == 0
    assert set(ends(collection.run()[1]).values()) == {"kept"}


def test_no_more_runs_at_once_than_there_are_cores(collection):
    for name in "abc":
        collection.add_capture(name, "meet 2")
    items = "".join(f'[[items]]\ncapture = "{name}"\n' for name in "abc")
    collection.write_batch(TURNTABLE + "[needs]\ntrain_cores = 1\n" + items)
    assert collection.run(cores=2)[0] == 0
    at_once = peak = 0
    for entry in sorted(collection.diary, key=lambda entry: entry["at"]):
        at_once += 1 if entry["what"] == "begin" else -1
        peak = max(peak, at_once)
    assert peak == 2


def test_tasks_that_need_a_graphics_card_get_one_each(collection, monkeypatch):
    monkeypatch.delenv(CARDS_VARIABLE, raising=False)
    for name in ("a", "b", "c"):
        collection.add_capture(name, "meet 2")
    items = "".join(f'[[items]]\ncapture = "{name}"\n' for name in "abc")
    collection.write_batch(TURNTABLE + "[needs]\ntrain_cores = 1\n" + '[train]\ndevice = "cuda"\n' + items)
    assert collection.run("--gpus", "2", cores=8)[0] == 0
    in_use: set[str] = set()
    used = set()
    for entry in sorted(collection.diary, key=lambda entry: entry["at"]):
        if entry["subject"] in ("a", "b", "c"):
            if entry["what"] == "begin":
                assert entry["cards"] not in in_use
                in_use.add(entry["cards"])
            else:
                in_use.remove(entry["cards"])
            used.add(entry["cards"])
    assert used == {"0", "1"}


def cards_by_subject(collection):
    return {entry["subject"]: entry["cards"] for entry in collection.diary}


def test_tasks_get_cards_that_the_user_may_use(collection, two_cards, monkeypatch):
    monkeypatch.setenv(CARDS_VARIABLE, "1")
    collection.add_capture("chair")
    collection.write_batch(ONE)
    assert collection.run()[0] == 0
    assert cards_by_subject(collection)["chair"] == "1"


def test_tasks_that_take_no_card_see_none(collection, two_cards):
    collection.add_capture("chair")
    collection.write_batch(ONE)
    assert collection.run("--gpus", "0")[0] == 0
    assert set(cards_by_subject(collection).values()) == {""}


def test_a_file_that_asks_for_a_card_gets_what_there_is(collection, two_cards):
    collection.add_capture("chair")
    collection.write_batch(TURNTABLE + '[train]\ndevice = "cuda"\n[[items]]\ncapture = "chair"\n')
    assert collection.run("--gpus", "0")[0] == 0
    assert cards_by_subject(collection)["chair"] is None


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="looks at processes in /proc")
def test_killed_in_the_middle_its_processes_end_and_the_next_run_completes_it(collection):
    collection.add_capture("chair")
    sofa = collection.add_capture("sofa", "sleep 60")
    collection.write_batch(TWO)
    process = collection.start()
    chair_pictures = collection.out / "chair/deutan-1.0/cycles-turn/frames"
    collection.wait_for(lambda: (chair_pictures / "0004.png").exists() and sleeping(collection))
    os.kill(process.pid, signal.SIGKILL)
    process.communicate()
    collection.wait_for(lambda: not any(is_alive(entry["pid"]) for entry in collection.diary))
    (sofa / "behaviour").unlink()
    before = len(collection.diary)
    code, events = collection.run()
    assert code == 0
    assert ends(events)["chair.train"] == "kept"
    assert {entry["subject"].partition("/")[0] for entry in collection.diary[before:]} <= {"sofa", "chair"}
    assert len(contents(collection.out)) == 2 * 4
    assert not list(collection.out.rglob("*.partial"))
    assert not (collection.out / "sofa/run/.partial").exists()


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="looks at processes in /proc")
def test_cancelled_it_ends_its_processes_and_leaves_nothing_half_written(collection):
    collection.add_capture("chair", "sleep 60")
    collection.write_batch(ONE)
    process = collection.start()
    collection.wait_for(lambda: bool(collection.diary))
    process.send_signal(signal.SIGINT)
    output, _ = process.communicate(timeout=SOON)
    assert process.returncode == 130
    assert json.loads(output.splitlines()[-1])["kind"] == "cancelled"
    # The last of a group of processes that was killed may outlive the first, which is waited for, by a moment.
    collection.wait_for(lambda: not any(is_alive(entry["pid"]) for entry in collection.diary))
    assert not (collection.out / "chair" / "run").exists()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_stopped_while_captures_are_checked_it_was_cancelled_like_at_any_time(collection, number):
    (collection.add_capture("chair") / "slow").touch()
    collection.write_batch(ONE)
    process = collection.start()
    assert json.loads(process.stdout.readline())["stage"] == "check"
    process.send_signal(number)
    output, complaints = process.communicate(timeout=SOON)
    assert process.returncode == 130
    assert [json.loads(line)["kind"] for line in output.splitlines()] == ["cancelled"]
    assert not complaints
    assert not collection.out.exists()


def test_a_worker_that_fails_while_captures_are_checked_is_a_defect(collection):
    collection.add_capture("chair")
    collection.write_batch(ONE)
    (collection.folder / "worker").write_text("#!/bin/sh\nexit 1\n")
    code, events = collection.run()
    assert code == 1
    assert events[-1]["kind"] == "defect"
    assert "exit code 1" in events[-1]["message"]


@pytest.mark.parametrize("farm", ["openjd", "flamenco"])
def test_an_export_has_a_plan_of_its_own_and_a_batch_that_runs_keeps_its(collection, farm):
    for name in ("chair", "sofa"):
        collection.add_capture(name)
    collection.write_batch(ONE)
    collection.run()
    running = collection.out / ".batch" / "plan.json"
    before = running.read_bytes()
    collection.write_batch(TWO)
    code, events = collection.run("--export", farm)
    assert code == 0
    assert events[-1]["event"] == "result"
    assert Path(events[-1]["job"]).exists()
    assert running.read_bytes() == before
    exported = read_plan(collection.out / farm / "plan.json")
    assert exported.out == collection.out
    assert {task.item for task in exported.tasks} == {"chair", "sofa"}


def test_two_batches_do_not_work_in_the_same_folder(collection):
    collection.add_capture("chair", "sleep 60")
    collection.write_batch(ONE)
    first = collection.start()
    try:
        collection.wait_for(lambda: bool(collection.diary))
        code, events = collection.run()
        assert code == 2
        assert "another process" in events[-1]["message"]
    finally:
        first.send_signal(signal.SIGINT)
        first.communicate(timeout=SOON)


def test_progress_rises_and_tells_the_time_left(collection):
    for name in "ab":
        collection.add_capture(name, "sleep 1")
    collection.write_batch(TURNTABLE + "".join(f'[[items]]\ncapture = "{name}"\n' for name in "ab"))
    _, events = collection.run()
    told = [event for event in events if event["event"] == "progress"]
    fractions = [event["fraction"] for event in told]
    assert len(told) >= 2
    assert all(0.0 <= fraction <= 1.0 for fraction in fractions)
    assert fractions[-1] > fractions[0]
    assert all(event["seconds_left"] >= 0.0 for event in told)


def test_a_dry_run_tells_every_task_and_writes_nothing(collection):
    collection.add_capture("chair")
    collection.write_batch(ONE)
    code, events = collection.run("--dry-run")
    assert code == 0
    assert [task["name"] for task in events[-1]["tasks"]] == [
        "chair.train",
        "chair.layer.deutan-1.0",
        "chair.deutan-1.0.cycles-turn.frames.0001-0004",
    ]
    assert events[-1]["seconds"] > 0.0
    assert not collection.out.exists()


@pytest.mark.parametrize(
    ("folder", "said"),
    [("logs", "cannot be written ("), ("done", " - free space or check the permissions, then run again")],
)
def test_a_task_whose_log_or_record_cannot_be_written_says_so_once(collection, folder, said):
    collection.add_capture("chair")
    collection.write_batch(ONE)
    (collection.out / ".batch").mkdir(parents=True)
    (collection.out / ".batch" / folder).write_text("no folder")
    code, events = collection.run()
    assert code == 3
    (failed,) = events[-1]["failed"]
    assert failed["message"].startswith(str(collection.out / ".batch" / folder))
    assert said in failed["message"]
    assert not [event for event in events if event.get("name") == "task-retried"]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="the system has no device that is always full")
def test_a_task_whose_disk_is_full_says_so(collection):
    collection.add_capture("chair")
    collection.write_batch(ONE)
    log = collection.out / ".batch" / "logs" / "chair.train.log"
    log.parent.mkdir(parents=True)
    log.symlink_to("/dev/full")
    code, events = collection.run()
    assert code == 3
    assert "No space left on device" in events[-1]["failed"][0]["message"]


def answering(collection, stdout, *options: str) -> subprocess.Popen:
    """A command whose answer is printed to `stdout`."""
    collection.add_capture("chair")
    batch = collection.write_batch(ONE)
    command = [sys.executable, str(ROOT / "scripts" / "turntable.py"), str(batch), "--out", str(collection.out)]
    environment = {**os.environ, **collection.variables}
    return subprocess.Popen([*command, *options], env=environment, stdout=stdout, stderr=subprocess.PIPE, text=True)


@pytest.mark.parametrize("options", [["--dry-run"], ["--export", "openjd"]])
def test_an_answer_whose_reader_has_gone_ends_without_a_word(collection, options):
    process = answering(collection, subprocess.PIPE, *options)
    process.stdout.close()
    assert process.stderr.read() == ""
    assert process.wait(timeout=60) == 0


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="the system has no device that is always full")
@pytest.mark.parametrize("options", [["--dry-run"], ["--export", "openjd"], ["--example", "example.toml"]])
def test_an_answer_onto_a_full_disk_is_one_line(collection, monkeypatch, options):
    monkeypatch.chdir(collection.folder)
    with open("/dev/full", "w") as full:
        process = answering(collection, full, *options)
        complaint = process.communicate(timeout=60)[1]
    assert process.returncode == 2
    assert complaint.startswith("turntable.py: stdout: cannot be written (No space left on device)")
    assert complaint.count("\n") == 1


def test_captures_without_usable_cameras_are_found_before_anything_starts(collection):
    for name in ("chair", "sofa"):
        collection.add_capture(name)
    collection.write_batch(TWO + "train.cameras = 'given'\n[[items]]\ncapture = 'batch.toml'\n")
    command = [sys.executable, str(ROOT / "scripts" / "turntable.py"), str(collection.folder / "batch.toml")]
    ended = subprocess.run([*command, "--out", str(collection.out)], capture_output=True, text=True, timeout=120)
    assert ended.returncode == 2
    refusals = [line for line in ended.stderr.splitlines() if "batch.toml: items" in line]
    assert len(refusals) == 3
    assert "items[1].capture" in refusals[0]
    assert "only one photograph" in refusals[0]  # whose cameras would be estimated
    assert "items[2].capture" in refusals[1]
    assert "no cameras" in refusals[1]
    assert "batch.toml: not a capture - give a video, a zip or the folder with the photographs" in refusals[2]
    assert not collection.out.exists()


def test_the_example_is_a_batch_that_can_be_planned(tmp_path):
    script, example = str(ROOT / "scripts" / "turntable.py"), str(tmp_path / "example.toml")
    subprocess.run([sys.executable, script, "--example", example], check=True, timeout=60)
    planned = [sys.executable, script, example, "--out", str(tmp_path / "out"), "--dry-run"]
    told = subprocess.run(planned, capture_output=True, text=True, timeout=60)
    assert told.returncode == 0, told.stderr
    assert "showroom.train" in told.stdout
    assert subprocess.run([sys.executable, script, "--example", example], timeout=60).returncode == 2


@pytest.mark.skipif(os.name != "posix", reason="elsewhere the size of a file has no limit to set")
def test_an_example_that_does_not_fit_leaves_no_half_of_it(tmp_path):
    command = [sys.executable, str(ROOT / "scripts" / "turntable.py"), "--example", str(tmp_path / "example.toml")]
    limited = ["sh", "-c", 'ulimit -f 1 && exec "$@"', "sh", *command]
    told = subprocess.run(limited, capture_output=True, text=True, timeout=60)
    assert told.returncode == 2
    assert "example.toml: cannot be written" in told.stderr
    assert os.listdir(tmp_path) == []


def test_inside_blender_its_arguments_follow_the_double_dash(collection):
    pytest.importorskip("bpy")
    finished = collection.add_finished_run("finished", "deutan-1.0")
    batch = collection.write_batch(TURNTABLE + f"[[items]]\nrun = '{finished}'\n")
    script = str(ROOT / "scripts" / "turntable.py")
    arguments = ["blender", "-b", "-P", script, "--", str(batch), "--out", str(collection.out), "--dry-run"]
    started = f"import bpy, runpy, sys; sys.argv = {arguments!r}; runpy.run_path({script!r}, run_name='__main__')"
    told = subprocess.run([sys.executable, "-c", started], capture_output=True, text=True, timeout=60)
    assert told.returncode == 0, told.stderr
    assert "finished.deutan-1.0.cycles-turn.frames.0001-0004" in told.stdout


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ([], "a batch file and --out are needed"),
        (["nowhere.toml", "--out", "out"], "nowhere.toml"),
        (["--plan", "plan.json"], "--task"),
        (["b.toml", "--out", "out", "--cores", "0"], "--cores"),
        (["b.toml", "--out", "out", "--export", "zip"], "--export"),
        (["b.toml", "--out", "out", "--export", "openjd", "--cluster", "tcp://farm:8786"], "give one"),
    ],
)
def test_unusable_arguments_are_one_line_and_exit_code_two(tmp_path, options, said):
    command = [sys.executable, str(ROOT / "scripts" / "turntable.py"), *options]
    ended = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, timeout=60)
    assert ended.returncode == 2
    assert len(ended.stderr.splitlines()) == 1
    assert said in ended.stderr


def sleeping(collection) -> bool:
    return sum(entry["what"] == "begin" for entry in collection.diary) > sum(
        entry["what"] == "end" for entry in collection.diary
    )


def test_a_python_without_dask_is_refused_in_one_line():
    code = "import sys; sys.modules['distributed'] = None; import cvdgs.core.batch.dask"
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert "InputError: --cluster: this Python has no Dask" in ended.stderr.splitlines()[-1]
