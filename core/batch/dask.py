"""A plan on the workers of a Dask cluster.

    dask scheduler
    dask worker tcp://SCHEDULER:8786 --nthreads 2 --resources "GPU=1"        on each machine, in cvdgs' environment
    python scripts/turntable.py BATCH.toml --out DIR --cluster tcp://SCHEDULER:8786

A worker does as many tasks at once as it has threads, each in a process of its own. Tasks that need a graphics card go
to workers that offer the resource GPU, and get one of their own where a worker offers several (GPU=2); where workers
offer CORES, or MEMORY in bytes, tasks are counted against those too, and one that needs more than any worker offers
takes all that one has. All machines see DIR, and the captures, under the same paths. When a worker is lost, its tasks
are done again on another one, and nothing else is. Whoever reaches a cluster can run anything on its machines: keep it
to a network of your own, or use Dask's TLS.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import queue
import threading
import time
import uuid
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ... import __version__
from ..errors import Cancelled, InputError
from ..runtime.process import Event, Job
from ..runtime.resources import CARDS_VARIABLE, Resources, card_names
from ..runtime.supervisor import Listener, WorkerDefect, finish
from .scheduler import PROGRESS_SECONDS, BatchOutcome, BatchScheduler
from .task import Plan, Task, plan_path
from .task_process import start_task

try:
    import distributed
    from distributed import Worker, get_worker
    from distributed.diagnostics.plugin import WorkerPlugin
except ImportError:
    raise InputError(
        "this Python has no Dask", where="--cluster", remedy="install it: pip install 'cvdgs[farm]'"
    ) from None

_CONNECT_SECONDS = 15.0
_WORKERS_SECONDS = 30.0  # for a first worker, where the cluster has just been started
_MIB = 1 << 20


def run_on_cluster(plan: Plan, address: str, listen: Listener) -> BatchOutcome:
    """Do the tasks of `plan`, whose file has been written, on a cluster.

    Args:
        address: of its scheduler, such as ``tcp://host:8786``.
        listen: receives the batch's progress, a ``task`` event at every end of a task, and warnings.

    Raises:
        InputError: the cluster cannot be reached or is lost, or its workers cannot do the plan.
        Cancelled: all tasks were ended; what is done is kept.
    """
    where = f"--cluster {address}"
    with _connect(address, where) as client:
        plan_file = str(plan_path(plan.out))
        _check_sight(client, plan_file, where)
        workers = list(client.scheduler_info(n_workers=-1)["workers"].values())
        _check_cards(plan, workers, where)
        return _Cluster(client, plan, plan_file, workers, listen).run()


def _connect(address: str, where: str) -> distributed.Client:
    try:
        client = distributed.Client(address, timeout=_CONNECT_SECONDS, set_as_default=False)
    except (OSError, ValueError) as error:  # a time-out is an OSError
        what = f"no Dask scheduler answers ({error or type(error).__name__})"
        raise InputError(what, where=where, remedy="start one with 'dask scheduler'") from None
    try:
        client.wait_for_workers(1, timeout=_WORKERS_SECONDS)
    except TimeoutError:
        client.close()
        raise InputError("the cluster has no workers", where=where, remedy=f"start a 'dask worker {address}'") from None
    return client


def _check_sight(client: distributed.Client, plan_file: str, where: str) -> None:
    """Raise `InputError` where a worker has another version of cvdgs, or another plan or none under the same path."""
    version, plan = look_at_plan(plan_file)
    for worker, seen in client.run(look_at_plan, plan_file, on_error="return").items():
        if isinstance(seen, Exception):
            what, remedy = f"cannot use cvdgs ({seen})", "start it in an environment where cvdgs is installed"
        elif seen[0] != version:
            what, remedy = f"has cvdgs {seen[0]}, not {version}", "install the same version on all machines"
        elif seen[1] != plan:
            what, remedy = f"does not see {plan_file}", "share the folder of --out under the same path on all machines"
        else:
            continue
        raise InputError(f"worker {worker} {what}", where=where, remedy=remedy)


def _check_cards(plan: Plan, workers: list[dict[str, Any]], where: str) -> None:
    """Raise `InputError` where a task would wait for ever."""
    most = max(worker["resources"].get("GPU", 0) for worker in workers)
    for task in plan.tasks:
        if task.gpu > most:
            what = f"task '{task.name}' needs {task.gpu} graphics card(s), more than any worker offers"
            remedy = "start a worker with --resources 'GPU=1' where there is a card, or plan with --gpus 0"
            raise InputError(what, where=where, remedy=remedy)


class _Cluster:
    """The tasks of a plan on a cluster that can do them."""

    def __init__(
        self, client: distributed.Client, plan: Plan, plan_file: str, workers: list[dict[str, Any]], listen: Listener
    ) -> None:
        self._client, self._plan, self._plan_file = client, plan, plan_file
        self._batch = f"cvdgs-{uuid.uuid4().hex}"
        self._offers = [worker["resources"] for worker in workers]
        self._scheduler = BatchScheduler(plan, _resources(workers), listen)
        self._running: dict[str, distributed.Future] = {}  # by task's name
        self._events: queue.Queue[tuple[str, Event | distributed.Future]] = queue.Queue()

    def run(self) -> BatchOutcome:
        self._client.register_plugin(TaskRunner(self._batch))
        self._client.subscribe_topic(self._batch, lambda stamped: self._events.put((stamped[1]["task"], stamped[1])))
        try:
            self._submit()
            while self._running:
                self._scheduler.report_progress()
                self._handle_next()
                self._submit()
            return self._scheduler.outcome
        finally:
            self._take_off()

    def _submit(self) -> None:
        for task in self._scheduler.ready():
            self._scheduler.hand_out(task)
            future = self._client.submit(
                do_task, self._batch, self._plan_file, task.name, task.gpu, resources=self._needs(task), pure=False
            )
            self._running[task.name] = future
            future.add_done_callback(lambda future, name=task.name: self._events.put((name, future)))

    def _needs(self, task: Task) -> dict[str, float]:
        """What `task` takes of a worker: what it needs, or all that the worker offers which has most of that.

        Dask lets a task wait for ever for more than any worker offers.
        """
        needs = {"GPU": task.gpu, "CORES": task.cores, "MEMORY": task.memory_mb * _MIB}
        shares = [
            {name: min(amount, offer.get(name, 0)) for name, amount in needs.items()}
            for offer in self._offers
            if offer.get("GPU", 0) >= task.gpu
        ]
        largest = max(shares, key=lambda share: (share["MEMORY"], share["CORES"]))  # too few cores only take longer
        return {name: amount for name, amount in largest.items() if amount}

    def _handle_next(self) -> None:
        """Handle the next event or end of a task, if there is one soon."""
        try:
            name, said = self._events.get(timeout=PROGRESS_SECONDS)
        except queue.Empty:
            return
        task = self._plan.task(name)
        if isinstance(said, distributed.Future):
            del self._running[name]
            self._take_back(task, said)
        elif name in self._running:
            self._scheduler.handle_event(task, said)

    def _take_back(self, task: Task, future: distributed.Future) -> None:
        """An attempt has ended, or Dask has given it up."""
        if future.status == "finished":
            attempt: Attempt = future.result()
            if attempt.complaint:
                self._scheduler.fail(task, attempt.seconds, attempt.complaint, for_good=attempt.is_input)
            else:
                self._scheduler.succeed(task, attempt.seconds, was_done=attempt.was_done)
        elif future.status == "error":  # above all KilledWorker: as many workers were lost with it as Dask tolerates
            self._scheduler.fail(task, 0.0, _one_line(future.exception()), for_good=False)
        else:
            raise InputError(
                "the connection to the Dask scheduler is lost",
                where=plan_path(self._plan.out),
                remedy="restart it and run the batch again; finished tasks are kept",
            )

    def _take_off(self) -> None:
        """Leave nothing of the batch on the cluster."""
        with contextlib.suppress(OSError):  # the scheduler is gone, and with it the batch
            # First the tasks, so that none is begun again while the runners end what is running.
            self._client.cancel(list(self._running.values()), force=True)
            self._client.unregister_worker_plugin(self._batch)
            self._client.unsubscribe_topic(self._batch)


def _resources(workers: list[dict[str, Any]]) -> Resources:
    """What all workers have together, for the time left; a thread counts as a core where no cores are offered."""
    return Resources(
        cores=int(sum(worker["resources"].get("CORES", worker["nthreads"]) for worker in workers)),
        memory_mb=int(sum(worker["resources"].get("MEMORY", worker["memory_limit"]) for worker in workers) // _MIB),
        gpus=int(sum(worker["resources"].get("GPU", 0) for worker in workers)),
    )


def _one_line(error: BaseException | None) -> str:
    return " ".join(str(error).split())


@dataclass(frozen=True)
class Attempt:
    """How an attempt at a task has ended.

    Attributes:
        seconds: that it took.
        complaint: what went wrong, in one line; "" for nothing.
        is_input: whether the input was unusable, and so will be the next time.
        was_done: whether there was nothing to do.
    """

    seconds: float
    complaint: str = ""
    is_input: bool = False
    was_done: bool = False


class TaskRunner(WorkerPlugin):
    """Does the tasks of one batch on a worker, and ends them when it is taken away.

    A worker that is killed cannot do that; its tasks notice by themselves that it is gone.

    Args:
        batch: name of the batch on this cluster, under which the worker keeps the runner and publishes its events.
    """

    def __init__(self, batch: str) -> None:
        self.name = batch

    def setup(self, worker: Worker) -> None:
        """The runner has reached its worker."""
        self._worker = worker
        self._lock = threading.Lock()
        self._jobs: set[Job] = set()
        self._cards = card_names(int(worker.state.total_resources.get("GPU", 0)))  # that are free
        self._cancelled = False

    async def teardown(self, worker: Worker) -> None:  # type: ignore[override]  # Dask awaits it
        """The batch has ended or was cancelled, or the worker closes."""
        with self._lock:
            self._cancelled = True
            jobs = list(self._jobs)
        await asyncio.gather(*(asyncio.to_thread(job.cancel) for job in jobs))

    def do(self, plan_file: str, task: str, cards: int) -> Attempt:
        """Do a task with so many graphics cards, and publish its events under the batch's name."""
        started = time.monotonic()
        complaint, is_input, was_done = "", False, False
        try:
            result = self._follow(plan_file, task, cards)
            was_done = bool(result.get("done_already"))
        except (InputError, WorkerDefect) as error:
            complaint, is_input = str(error), isinstance(error, InputError)
        except Cancelled:
            complaint = "cancelled"
        return Attempt(time.monotonic() - started, complaint, is_input, was_done)

    def _follow(self, plan_file: str, task: str, count: int) -> Event:
        with self._lock:
            if self._cancelled:
                raise Cancelled
            cards = self._cards[:count]
            variables = {CARDS_VARIABLE: ",".join(cards)} if cards else {}
            job = start_task(Path(plan_file), task, variables, note=f"for the Dask worker {self._worker.address}")
            self._jobs.add(job)
            self._cards = self._cards[count:]
        try:
            listen = _Throttled(lambda event: self._worker.log_event(self.name, {"task": task, **event}))
            return finish(job, listen, patience_seconds=None)  # it may wait for another process that does the same
        finally:
            with self._lock:
                self._jobs.discard(job)
                self._cards += cards


class _Throttled:
    """Passes on all events but progress that follows too soon: every one goes over the network to all who listen."""

    def __init__(self, listen: Listener) -> None:
        self._listen = listen
        self._last = -math.inf

    def __call__(self, event: Event) -> None:
        if event["event"] == "progress":
            now = time.monotonic()
            if now - self._last < PROGRESS_SECONDS:
                return
            self._last = now
        self._listen(event)


def do_task(batch: str, plan_file: str, task: str, cards: int) -> Attempt:
    """Do a task of a batch, which needs so many graphics cards, on the worker that this runs on."""
    runner = get_worker().plugins[batch]
    assert isinstance(runner, TaskRunner)
    return runner.do(plan_file, task, cards)


def look_at_plan(plan_file: str) -> tuple[str, bytes | None]:
    """The version of cvdgs where this runs, and the plan as it is seen there; None where it is not."""
    try:
        return __version__, Path(plan_file).read_bytes()
    except OSError:
        return __version__, None
