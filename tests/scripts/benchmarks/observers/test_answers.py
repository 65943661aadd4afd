"""Files of answers are strangers' files: what a page of this study cannot have written is refused in one line."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cvdgs.core.errors import InputError
from cvdgs.scripts.benchmarks.observers.answers import read_answers
from cvdgs.scripts.benchmarks.observers.study import KEY_FILE, Key, read_key, with_codes, write_key

from .sessions import saved, session, stimuli, study


@pytest.fixture(scope="module")
def key() -> Key:
    return study()


def changed(change: Callable[[dict[str, Any]], Any]) -> Callable[[dict[str, Any]], dict[str, Any]]:
    def make(values: dict[str, Any]) -> dict[str, Any]:
        values = copy.deepcopy(values)
        change(values)
        return values

    return make


def mixed_stimuli(values: dict[str, Any]) -> None:
    last_of_its_block = len(values["answers"]) // 2 - 7  # before the repeated pairs
    values["answers"][0]["left"] = values["answers"][last_of_its_block]["left"]


DAMAGE = {
    "another format": changed(lambda v: v.update(format="something")),
    "another study": changed(lambda v: v.update(study="0" * 12)),
    "a later version": changed(lambda v: v.update(version=2)),
    "one field more": changed(lambda v: v.update(name="Ann")),
    "a participant with a path": changed(lambda v: v.update(participant="../x")),
    "a cap twice": changed(lambda v: v["arrangement"].__setitem__(0, v["arrangement"][1])),
    "caps that are no numbers": changed(lambda v: v.update(arrangement=[True] * 15)),
    "no answers": changed(lambda v: v.update(answers=[])),
    "answers that are no list": changed(lambda v: v.update(answers={})),
    "an answer twice": changed(lambda v: v["answers"].append(v["answers"][0])),
    "more answers than pairs": changed(lambda v: v.update(answers=v["answers"] * 9)),
    "an unknown question": changed(lambda v: v["answers"][0].update(question="price")),
    "an unknown picture": changed(lambda v: v["answers"][0].update(left="ffffffff")),
    "a picture beside itself": changed(lambda v: v["answers"][0].update(left=v["answers"][0]["right"])),
    "two photographs in a pair": changed(mixed_stimuli),
    "neither picture chosen": changed(lambda v: v["answers"][0].update(choice="ffffffff")),
    "a time before the question": changed(lambda v: v["answers"][0].update(ms=-1)),
    "a list for a text": changed(lambda v: v["answers"][0].update(left=[])),
}


@pytest.mark.parametrize("damage", DAMAGE.values(), ids=DAMAGE.keys())
def test_what_a_page_cannot_have_written_is_refused_in_one_line(key: Key, tmp_path, damage) -> None:
    path = tmp_path / "answers.json"
    path.write_text(json.dumps(damage(session(key, 1))), encoding="utf-8")
    with pytest.raises(InputError) as refused:
        read_answers([path], key)
    assert "\n" not in str(refused.value)
    assert "answers.json" in str(refused.value)


@pytest.mark.parametrize("content", ["", "[]", "null", "{", '"text"', "[" * 100_000, "x" * (2 << 20)])
def test_other_files_are_refused(key: Key, tmp_path, content: str) -> None:
    path = tmp_path / "answers.json"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(InputError):
        read_answers([path], key)


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text(max_size=9), lambda inner: st.lists(inner, max_size=4)
)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_a_file_with_any_value_replaced_is_read_or_refused(key: Key, tmp_path, data) -> None:
    values = session(key, 3)
    values["answers"] = values["answers"][:4]
    holder = data.draw(st.sampled_from([values, values["answers"][0], values["answers"][3]]))
    holder[data.draw(st.sampled_from(sorted(holder)))] = data.draw(JSON)
    path = tmp_path / "answers.json"
    path.write_text(json.dumps(values), encoding="utf-8")
    with suppress(InputError):  # nothing else may come
        assert read_answers([path], key)


def test_a_participant_counts_once(key: Key, tmp_path) -> None:
    path = saved(tmp_path, session(key, 7))
    copied = tmp_path / "copy.json"
    copied.write_bytes(path.read_bytes())
    with pytest.raises(InputError, match="same participant"):
        read_answers([path, copied], key)


def test_a_session_that_was_broken_off_counts_as_far_as_it_went(key: Key, tmp_path) -> None:
    values = session(key, 8)
    values["answers"] = values["answers"][:5]
    (participant,) = read_answers([saved(tmp_path, values)], key)
    assert len(participant.answers) == 5


def test_the_key_is_read_as_it_was_written(key: Key, tmp_path) -> None:
    write_key(tmp_path, key)
    assert read_key(tmp_path) == key
    write_key(tmp_path, key)


def test_the_key_of_a_study_that_may_have_answers_is_not_overwritten(key: Key, tmp_path) -> None:
    write_key(tmp_path, key)
    other, _ = with_codes(stimuli(), "command", seed=1)
    with pytest.raises(InputError, match="another study"):
        write_key(tmp_path, other)
    assert read_key(tmp_path) == key


@pytest.mark.parametrize("content", ["{}", "[]", '{"format": "cvdgs-observers", "shown": {"a": {}}}'])
def test_a_damaged_key_is_refused(tmp_path, content: str) -> None:
    (tmp_path / KEY_FILE).write_text(content, encoding="utf-8")
    with pytest.raises(InputError):
        read_key(tmp_path)


def test_the_key_hides_the_methods_behind_codes(key: Key) -> None:
    assert all(len(code) == 8 and set(code) <= set("0123456789abcdef") for code in key.shown)
    assert key.methods("still") == ["original", "lut", "scene", "gain"]
    assert key.most_answers == 2 * 2 * 4 * 6
