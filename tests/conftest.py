"""For all tests: no network, and threads that wait without spinning, both said before anything else is imported."""

import os

import hypothesis
import pytest

from . import network

os.environ.setdefault("OMP_WAIT_POLICY", "passive")
network.refuse()
# Tests hold no seconds: an example takes as long as a busy machine makes it take.
hypothesis.settings.register_profile("patient", deadline=None)
hypothesis.settings.load_profile("patient")


@pytest.fixture(autouse=True)
def no_network():
    """Fails a test whose process asked for the network, even where the refusal was swallowed."""
    network.attempts.clear()
    yield network.attempts
    assert not network.attempts
