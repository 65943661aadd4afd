"""A real Dask cluster of separate processes: a scheduler, and workers that come and go and can be killed."""

import json
import os
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

import distributed
import psutil


@dataclass
class DaskFarm:
    """A scheduler and its workers.

    Attributes:
        folder: for their logs.
        host: that the scheduler listens on.
        prefix: of the scheduler's command line, such as one that enters a namespace.
    """

    folder: Path
    host: str = "127.0.0.1"
    prefix: tuple[str, ...] = ()
    _processes: dict[str, subprocess.Popen] = field(default_factory=dict)

    def __post_init__(self):
        file = self.folder / "scheduler.json"
        options = ["--host", self.host, "--port", "0", "--no-dashboard", "--no-show", "--scheduler-file", str(file)]
        self._start("scheduler", [*self.prefix, sys.executable, "-m", "distributed.cli.dask_scheduler", *options])
        # The scheduler writes into the file that is there already: it may be empty for a moment.
        self.wait_for(lambda: file.exists() and file.read_text().rstrip().endswith("}"))
        self.address = json.loads(file.read_text())["address"]

    def add_worker(self, name: str, *options: str, prefix: tuple[str, ...] = (), **variables: str) -> None:
        """A worker that does one task at a time; `wait_for_workers` says when it is there."""
        command = [*prefix, sys.executable, "-m", "distributed.cli.dask_worker", self.address, "--name", name]
        fixed = ["--nthreads", "1", "--no-nanny", "--no-dashboard", "--local-directory", str(self.folder / name)]
        self._start(name, [*command, *fixed, *options], **variables)

    def wait_for_workers(self, count: int, prefix: tuple[str, ...] = ()) -> None:
        code = "import sys, distributed as d; d.Client(sys.argv[1], timeout=40).wait_for_workers(int(sys.argv[2]), 40)"
        subprocess.run([*prefix, sys.executable, "-c", code, self.address, str(count)], check=True, timeout=90)

    def client(self) -> distributed.Client:
        return distributed.Client(self.address, set_as_default=False)

    def worker_of(self, process: int) -> str:
        """Name of the worker that a process was started by."""
        ancestors = {ancestor.pid for ancestor in psutil.Process(process).parents()}
        (name,) = [name for name, worker in self._processes.items() if worker.pid in ancestors]
        return name

    def kill(self, name: str) -> None:
        """End a process as the kernel does when memory runs out."""
        process = self._processes.pop(name)
        process.kill()
        process.wait()

    def close(self) -> None:
        for name in list(self._processes):
            self.kill(name)

    def wait_for(self, condition, seconds: float = 120.0) -> None:
        deadline = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < deadline, "it did not happen"
            time.sleep(0.05)

    def _start(self, name: str, command: list[str], **variables: str) -> None:
        with open(self.folder / f"{name}.log", "w") as log:
            self._processes[name] = subprocess.Popen(
                command, stdout=log, stderr=log, env={**os.environ, **variables}, start_new_session=True
            )


def is_running(process: int) -> bool:
    return psutil.pid_exists(process) and psutil.Process(process).status() != psutil.STATUS_ZOMBIE


def can_unshare(*namespaces: str) -> bool:
    """Whether this user may make such namespaces, as the options of ``unshare`` name them."""
    if shutil.which("unshare") is None:
        return False
    return subprocess.run(["unshare", *namespaces, "true"], capture_output=True).returncode == 0
