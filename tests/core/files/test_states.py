"""The state of a computation in a file that somebody else may have made."""

import pytest

from cvdgs.core.errors import InputError
from cvdgs.core.files.states import read_state, write_state


def test_a_whole_number_beyond_all_floating_point_ones_is_damage(tmp_path):
    write_state(tmp_path / "state", {"small": 3, "huge": 10**400}, {})
    _, saved = read_state(tmp_path / "state", "the checkpoint", "start anew", most_bytes=1 << 20)
    assert saved.value("small", float) == 3.0
    with pytest.raises(InputError, match="the checkpoint is damaged"):
        saved.value("huge", float)
