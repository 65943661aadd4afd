"""A Dask cluster whose machines are network namespaces of the kernel: nothing reaches another but over the wire."""

import os
import shutil
import subprocess
import sys

import pytest

pytest.importorskip("distributed", reason="Dask is not installed (pip install cvdgs[farm])")

from cvdgs.core.bootstrap import ROOT

from .dask_farm import DaskFarm, can_unshare, is_running

SCRIPT = ROOT / "scripts" / "turntable.py"
TOOLS = ("unshare", "nsenter", "ip")
MACHINES = ("studio", "office")

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        not all(map(shutil.which, TOOLS)) or not can_unshare("--net"), reason="the kernel allows no network namespace"
    ),
]


class Network:
    """Machines on one switch, which the front and the scheduler share; all are gone when their processes are."""

    def __init__(self):
        self._holders = {}
        self._add("front")
        self._run("front", "ip", "link", "add", "switch", "type", "bridge")
        self._run("front", "ip", "address", "add", "10.77.0.1/24", "dev", "switch")
        self._run("front", "ip", "link", "set", "switch", "up")
        for number, name in enumerate(MACHINES, start=2):
            holder = self._add(name)
            peer = ["peer", "name", "wire", "netns", str(holder)]
            self._run("front", "ip", "link", "add", f"to-{name}", "type", "veth", *peer)
            self._run("front", "ip", "link", "set", f"to-{name}", "master", "switch", "up")
            self._run(name, "ip", "address", "add", f"10.77.0.{number}/24", "dev", "wire")
            self._run(name, "ip", "link", "set", "wire", "up")

    def on(self, machine):
        """What a command line begins with that is run on that machine."""
        return ("nsenter", "--net", "--target", str(self._holders[machine].pid))

    def close(self):
        for holder in self._holders.values():
            holder.kill()
            holder.wait()

    def _add(self, name):
        ready = "ip link set lo up && echo && exec sleep infinity"
        holder = subprocess.Popen(["unshare", "--net", "sh", "-c", ready], stdout=subprocess.PIPE)
        holder.stdout.readline()
        self._holders[name] = holder
        return holder.pid

    def _run(self, machine, *command):
        subprocess.run([*self.on(machine), *command], check=True)


@pytest.fixture
def network():
    network = Network()
    yield network
    network.close()


def test_a_batch_survives_the_loss_of_a_machine_in_the_middle(network, collection, tmp_path_factory):
    names = ("chair", "sofa", "rug")
    for name in names:
        collection.add_capture(name)
    (collection.folder / "sofa" / "behaviour").write_text("once:sleep 60")
    items = "".join(f'[[items]]\ncapture = "{name}"\n' for name in names)
    collection.write_batch("[turntable]\nframes = 4\nchunk = 2\nsize = [32, 24]\n" + items)
    farm = DaskFarm(tmp_path_factory.mktemp("farm"), host="10.77.0.1", prefix=network.on("front"))
    try:
        for machine in MACHINES:
            farm.add_worker(machine, prefix=network.on(machine), **collection.variables)
        farm.wait_for_workers(len(MACHINES), prefix=network.on("front"))
        command = [sys.executable, SCRIPT, collection.folder / "batch.toml", "--out", collection.out]
        batch = subprocess.Popen(
            [*network.on("front"), *command, "--cluster", farm.address],
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, **collection.variables},
        )
        farm.wait_for(lambda: "sofa" in [entry["subject"] for entry in collection.diary])
        (process,) = [entry["pid"] for entry in collection.diary if entry["subject"] == "sofa"]
        farm.kill(farm.worker_of(process))
        _, complaints = batch.communicate(timeout=120)
    finally:
        farm.close()
    assert batch.returncode == 0, complaints
    assert not is_running(process)
    begun = [entry["subject"] for entry in collection.diary if entry["what"] == "begin"]
    assert {name: begun.count(name) for name in names} == {"chair": 1, "sofa": 2, "rug": 1}
    assert len(list(collection.out.rglob("*.png"))) == len(names) * 4
