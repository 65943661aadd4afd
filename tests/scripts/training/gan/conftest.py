"""Pairs that are fitted once for all tests of a training."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from cvdgs.scripts.training.gan.examples import KEPT, PAIRED, Pairs


@pytest.fixture(scope="session")
def _fitted_pairs(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("pairs")
    for stream in (PAIRED, KEPT):
        Pairs(folder, 0, stream)[0]
    return folder


@pytest.fixture
def pairs(_fitted_pairs: Path, tmp_path: Path) -> Path:
    """A copy of a folder with one pair to train on and one that is kept, of seed 0."""
    return Path(shutil.copytree(_fitted_pairs, tmp_path / "pairs"))
