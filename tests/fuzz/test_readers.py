"""Whatever a file holds, its reader reads it or refuses it in one line. More executions: ``campaign.py``."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from .mutation import KINDS, PAYLOADS, Edit, edited
from .targets import TARGETS, Target

SEEDS = Path(__file__).parent / "seeds"
_EXECUTIONS = 60  # of each reader with damaged files
_PREFIXES = 40  # lengths that every example is cut to, evenly spread

_shares = st.floats(0.0, 1.0, exclude_max=True)
_edits = st.lists(
    st.builds(
        Edit,
        st.sampled_from(KINDS),
        _shares,
        _shares,
        st.integers(0, 63),
        st.integers(0, len(PAYLOADS) - 1),
        st.integers(0, 255),
    ),
    min_size=1,
    max_size=6,
)

each_target = pytest.mark.parametrize("target", TARGETS, ids=lambda target: target.name)


@cache
def examples_of(target: Target) -> tuple[bytes, ...]:
    return tuple(target.examples())


@each_target
def test_a_whole_file_is_read(target: Target) -> None:
    for data in examples_of(target):
        target.read(data)


@each_target
def test_a_cut_file_is_read_or_refused(target: Target) -> None:
    for data in examples_of(target):
        for length in sorted({len(data) * step // _PREFIXES for step in range(_PREFIXES)}):
            target(data[:length])


@each_target
@settings(
    max_examples=_EXECUTIONS,
    derandomize=True,
    deadline=None,
    database=None,
    phases=[Phase.generate, Phase.shrink],
    suppress_health_check=list(HealthCheck),
)
@given(data=st.data())
def test_a_damaged_file_is_read_or_refused(target: Target, data: st.DataObject) -> None:
    target(edited(data.draw(st.sampled_from(examples_of(target))), data.draw(_edits)))


@pytest.mark.parametrize(
    "seed",
    sorted(path for path in SEEDS.rglob("*") if path.is_file()),
    ids=lambda path: f"{path.parent.name}-{path.name}",
)
def test_what_once_went_wrong_does_not_any_more(seed: Path) -> None:
    (target,) = [target for target in TARGETS if target.name == seed.parent.name]
    target(seed.read_bytes())
