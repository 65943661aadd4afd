"""Refuses the network to the tests: in their processes by an audit hook, in their children by the environment."""

from __future__ import annotations

import ipaddress
import os
import socket
import sys
from typing import Any

# Nothing listens there (the discard service has been dead for decades): what goes through a proxy is refused at once.
DEAD_PROXY = "http://127.0.0.1:9"

attempts: list[str] = []
"""What was refused since the list was last cleared."""


def refuse() -> None:
    """From now on, and for good: audit hooks cannot be taken back."""
    for scheme in ("http_proxy", "https_proxy", "all_proxy"):
        os.environ[scheme] = os.environ[scheme.upper()] = DEAD_PROXY
    os.environ["no_proxy"] = os.environ["NO_PROXY"] = "localhost,127.0.0.1,::1"
    os.environ["PIP_NO_INDEX"] = "1"
    sys.addaudithook(_watch)


def _watch(event: str, arguments: tuple[Any, ...]) -> None:
    if event in ("socket.connect", "socket.sendto", "socket.sendmsg"):
        sender, address = arguments[0], arguments[1]
        # Connecting a datagram socket sends nothing: programs ask so for their own address.
        asks_only = event == "socket.connect" and sender.type == socket.SOCK_DGRAM
        if isinstance(address, tuple) and not asks_only and not is_here(str(address[0])):
            _refuse(event, address)
    elif event in ("socket.getaddrinfo", "socket.gethostbyname") and not is_here(arguments[0]):
        _refuse(event, arguments[0])


def is_here(host: str | bytes | None) -> bool:
    """Whether it is this machine: no name, a loopback address, or its own name."""
    name = host.decode() if isinstance(host, bytes) else host
    if not name or name in ("localhost", socket.gethostname()):
        return True
    try:
        address = ipaddress.ip_address(name.partition("%")[0])
    except ValueError:
        return False
    return address.is_loopback or address.is_unspecified


def _refuse(event: str, target: object) -> None:
    attempts.append(f"{event} {target}")
    raise PermissionError(f"tests have no network ({event} {target})")
