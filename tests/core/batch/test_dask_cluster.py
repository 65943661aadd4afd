"""scripts/turntable.py --cluster on a real Dask cluster: a scheduler and workers as separate processes."""

import os
import signal

import pytest

pytest.importorskip("distributed", reason="Dask is not installed (pip install cvdgs[farm])")
from cvdgs.core.batch import dask as dask_cluster
from cvdgs.core.batch.task import Kind, Plan, Task, write_plan
from cvdgs.core.errors import InputError

from .dask_farm import DaskFarm, can_unshare, is_running
from .outcomes import contents, ends

TURNTABLE = "[turntable]\nframes = 2\nchunk = 2\nsize = [32, 24]\n"
ONE = TURNTABLE + '[[items]]\ncapture = "chair"\n'
TWO = ONE + '[[items]]\ncapture = "sofa"\n'


@pytest.fixture(scope="module")
def farm(tmp_path_factory):
    """Two workers, one of which offers a graphics card."""
    farm = DaskFarm(tmp_path_factory.mktemp("farm"))
    farm.add_worker("studio", "--resources", "GPU=1")
    farm.add_worker("office")
    farm.wait_for_workers(2)
    yield farm
    farm.close()


@pytest.fixture
def cluster(farm, collection):
    """Options for the farm, whose workers do tasks of the collection by its programs."""
    with farm.client() as client:
        client.run(lambda variables: os.environ.update(variables), collection.variables)
    return ["--cluster", farm.address]


def test_a_cluster_makes_the_files_that_one_machine_makes(collection, cluster):
    collection.add_capture("chair")
    collection.write_batch(ONE)
    code, events = collection.run(*cluster)
    assert code == 0
    assert set(ends(events).values()) == {"done"}
    made = contents(collection.out)
    collection.out.rename(collection.folder / "made by the cluster")
    assert collection.run()[0] == 0
    assert made == contents(collection.out)


@pytest.mark.slow
def test_a_second_run_gives_the_cluster_nothing_to_do(collection, cluster):
    collection.add_capture("chair")
    collection.write_batch(ONE)
    collection.run(*cluster)
    before = collection.diary
    code, events = collection.run(*cluster)
    assert code == 0
    assert set(ends(events).values()) == {"kept"}
    assert collection.diary == before


def test_training_goes_to_the_worker_that_offers_a_card(farm, collection, cluster):
    for name in ("chair", "sofa"):
        collection.add_capture(name)
    collection.write_batch(TWO)
    assert collection.run(*cluster, "--gpus", "1")[0] == 0
    with farm.client() as client:
        workers = client.scheduler_info()["workers"]
    (with_card,) = [address for address, worker in workers.items() if worker["name"] == "studio"]
    logs = [path.read_text() for path in collection.out.glob(".batch/logs/*train*.log")]
    assert len(logs) == 2
    assert all(with_card in log for log in logs)


def test_trainings_at_the_same_time_on_a_worker_with_two_cards_get_one_each(tmp_path, collection):
    farm = DaskFarm(tmp_path)
    try:
        two_cards = {**collection.variables, "CUDA_VISIBLE_DEVICES": "4,6"}
        farm.add_worker("studio", "--nthreads", "2", "--resources", "GPU=2", **two_cards)
        farm.wait_for_workers(1)
        for name in ("chair", "sofa"):
            collection.add_capture(name, "meet 2")
        collection.write_batch(TWO)
        assert collection.run("--cluster", farm.address, "--gpus", "1")[0] == 0
        assert {entry["cards"] for entry in collection.diary if entry["what"] == "begin"} >= {"4", "6"}
    finally:
        farm.close()


def test_tasks_that_take_no_card_see_none_on_a_worker_that_has_one(collection, cluster):
    collection.add_capture("chair")
    collection.write_batch(ONE)
    assert collection.run(*cluster, "--gpus", "0")[0] == 0
    assert {entry["cards"] for entry in collection.diary} == {""}


@pytest.mark.slow
def test_an_item_that_fails_does_not_stop_the_others_and_is_not_tried_in_vain(collection, cluster):
    collection.add_capture("chair", "refuse")
    collection.add_capture("sofa")
    collection.write_batch(TWO)
    code, events = collection.run(*cluster)
    assert code == 3
    assert events[-1]["items"] == {"chair": False, "sofa": True}
    assert [entry["subject"] for entry in collection.diary].count("chair") == 1


@pytest.mark.slow
def test_a_task_that_breaks_once_is_tried_again(collection, cluster):
    collection.add_capture("chair", "once:break")
    collection.write_batch(ONE)
    code, events = collection.run(*cluster)
    assert code == 0
    assert [event["name"] for event in events if event["event"] == "warning"] == ["task-retried"]


@pytest.mark.slow
def test_cancelling_ends_the_tasks_on_all_workers(farm, collection, cluster):
    for name in ("chair", "sofa"):
        collection.add_capture(name, "sleep 60")
    collection.write_batch(TWO)
    batch = collection.start(*cluster)
    farm.wait_for(lambda: len(collection.diary) == 2)
    batch.send_signal(signal.SIGINT)
    assert batch.wait(timeout=60) == 130
    assert not any(is_running(entry["pid"]) for entry in collection.diary)


def test_a_killed_workers_task_and_no_other_is_done_again(farm, collection, cluster):
    names = ("chair", "sofa", "rug")
    for name in names:
        collection.add_capture(name)
    (collection.folder / "sofa" / "behaviour").write_text("once:sleep 60")
    collection.write_batch(TWO + '[[items]]\ncapture = "rug"\n')
    batch = collection.start(*cluster)
    farm.wait_for(lambda: "sofa" in [entry["subject"] for entry in collection.diary])
    (process,) = [entry["pid"] for entry in collection.diary if entry["subject"] == "sofa"]
    killed = farm.worker_of(process)
    farm.kill(killed)
    try:
        batch.communicate(timeout=120)
        assert batch.returncode == 0
        assert not is_running(process)
        begun = [entry["subject"] for entry in collection.diary if entry["what"] == "begin"]
        assert begun.count("sofa") == 2
        assert all(begun.count(name) == 1 for name in names if name != "sofa")
        assert len(contents(collection.out)) == len(names) * 2
    finally:
        farm.add_worker(killed, *(["--resources", "GPU=1"] if killed == "studio" else []))
        farm.wait_for_workers(2)


def test_a_batch_that_needs_more_cards_than_any_worker_offers_is_refused(farm, tmp_path):
    plan = Plan(tmp_path, (Task("train", Kind.TRAIN, gpu=2),))
    write_plan(plan)
    with pytest.raises(InputError, match="needs 2 graphics"):
        dask_cluster.run_on_cluster(plan, farm.address, lambda _: None)


def test_a_task_that_needs_more_cores_and_memory_than_a_worker_offers_takes_all_of_it(tmp_path, collection):
    farm = DaskFarm(tmp_path)
    try:
        farm.add_worker("small", "--resources", "CORES=2 MEMORY=1e9", **collection.variables)
        farm.wait_for_workers(1)
        collection.add_capture("chair")
        collection.write_batch(ONE)
        batch = collection.start("--cluster", farm.address)
        try:
            batch.communicate(timeout=120)
        finally:
            batch.kill()
        assert batch.returncode == 0
    finally:
        farm.close()


@pytest.mark.slow
@pytest.mark.skipif(not can_unshare("--mount"), reason="the kernel allows no mount namespace here")
def test_a_worker_that_does_not_see_the_folder_is_refused(farm, collection, cluster):
    collection.add_capture("chair")
    collection.write_batch(ONE)
    hide = f"mount -t tmpfs none '{collection.folder}' && exec \"$@\""
    farm.add_worker("elsewhere", prefix=("unshare", "--mount", "sh", "-c", hide, "sh"))
    farm.wait_for_workers(3)
    try:
        code, events = collection.run(*cluster)
    finally:
        farm.kill("elsewhere")
    assert code == 2
    assert "does not see" in events[-1]["message"]


def test_an_address_where_no_scheduler_answers_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(dask_cluster, "_CONNECT_SECONDS", 0.5)
    with pytest.raises(InputError, match="no Dask scheduler answers"):
        dask_cluster.run_on_cluster(Plan(tmp_path, ()), "tcp://127.0.0.1:9", lambda _: None)
