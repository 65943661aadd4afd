"""The tests run without a network: what asks for one is refused, here and in children, and this machine is not."""

import os
import shutil
import socket
import subprocess
import sys
import urllib.error
import urllib.request

import pytest

from cvdgs.core.bootstrap import ROOT

FAR_AWAY = "192.0.2.1"  # reserved for documentation (RFC 5737): nobody has it


@pytest.mark.parametrize(
    "ask",
    [
        lambda: socket.create_connection((FAR_AWAY, 80), timeout=1.0),
        lambda: socket.getaddrinfo("example.org", 443),
        lambda: socket.socket(socket.AF_INET, socket.SOCK_DGRAM).sendto(b"", (FAR_AWAY, 53)),
    ],
    ids=["connection", "name", "datagram"],
)
def test_other_machines_cannot_be_reached(ask, no_network):
    with pytest.raises(PermissionError, match="no network"):
        ask()
    assert len(no_network) == 1
    no_network.clear()


def test_this_machine_can_be_reached():
    with socket.create_server(("127.0.0.1", 0)) as server, socket.create_connection(server.getsockname()) as client:
        client.sendall(b"hello")
        assert server.accept()[0].recv(5) == b"hello"


def test_what_goes_through_urllib_is_refused_at_once():
    with pytest.raises(urllib.error.URLError, match="refused"):
        urllib.request.urlopen("http://example.org", timeout=5.0)


def test_children_are_refused_too():
    fetch = "import urllib.request; urllib.request.urlopen('https://example.org', timeout=5)"
    result = subprocess.run([sys.executable, "-c", fetch], capture_output=True, text=True)
    assert result.returncode != 0
    assert "refused" in result.stderr


@pytest.mark.slow
def test_a_whole_run_needs_no_network(tmp_path):
    """In a network namespace of its own there is no network at all, whatever a program tries."""
    command = ["unshare", "--map-root-user", "--net"]
    if shutil.which("unshare") is None or subprocess.run([*command, "true"]).returncode != 0:
        pytest.skip("needs unshare and the right to make namespaces")
    run = [sys.executable, ROOT / "scripts" / "run.py", ROOT / "core" / "demo" / "showroom", "--out", tmp_path / "out"]
    small = ["--iterations", "50", "--max-size", "96", "--enhancer", "cgan"]
    result = subprocess.run([*command, *run, *small], capture_output=True, text=True, env={**os.environ})
    assert result.returncode == 0, result.stderr
    assert (tmp_path / "out" / "scene.blend").is_file()
