"""For all tests: no network, and threads that wait without spinning, both said before anything else is imported."""

import os

import pytest

from . import network

os.environ.setdefault("OMP_WAIT_POLICY", "passive")
network.refuse()


@pytest.fixture(autouse=True)
def no_network():
    """Fails a test whose process asked for the network, even where the refusal was swallowed."""
    network.attempts.clear()
    yield network.attempts
    assert not network.attempts
