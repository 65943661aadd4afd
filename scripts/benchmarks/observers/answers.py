"""The files that participants save: strangers' files, of which nothing is taken that the study did not ask."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ....core.color.arrangement import CAP_COUNT, score_arrangement, suggest
from ....core.errors import InputError
from ....core.files.untrusted import read_json
from .study import FORMAT, QUESTIONS, Key

NO_TYPE = "none or unclear"
"""Where the arrangement test names no type."""
_VERSION = 1
_MOST_BYTES = 1 << 20
_MOST_MILLISECONDS = 3_600_000
_PARTICIPANT = re.compile(r"[0-9a-f]{1,8}")
_FIELDS = {"format", "version", "study", "participant", "arrangement", "cvd", "answers"}
_ANSWER_FIELDS = {"question", "left", "right", "choice", "repeat", "ms"}
_REMEDY = "leave it out, or ask the participant to save it again"


@dataclass(frozen=True)
class Answer:
    """One choice.

    Attributes:
        question: a name of `QUESTIONS`.
        kind: of the stimulus.
        pair: the codes of both versions, in alphabetical order.
        chosen, other: methods.
        chose_left: the side.
        repeat: whether the pair was shown for the second time.
    """

    question: str
    kind: str
    pair: tuple[str, str]
    chosen: str
    other: str
    chose_left: bool
    repeat: bool


@dataclass(frozen=True)
class Participant:
    """What one file holds.

    Attributes:
        name: a random number, in hexadecimal digits.
        cvd: the type that the arrangement test suggests, or `NO_TYPE`; marked where the study has no pictures for it,
            and the choices are about pictures that were made for others.
        answers: in the order in which they were given.
    """

    name: str
    cvd: str
    answers: tuple[Answer, ...]


def read_answers(paths: Sequence[Path], key: Key) -> list[Participant]:
    """The participants of all files.

    Raises:
        InputError: a file is damaged, of another study or holds what a page cannot have written; or two are of one
            participant.
    """
    found: dict[str, Path] = {}
    participants = []
    for path in paths:
        participant = _participant(path, key)
        if participant.name in found:
            what = f"has the same participant as {found[participant.name].name}"
            raise InputError(what, where=path, remedy="give each participant's file once")
        found[participant.name] = path
        participants.append(participant)
    return participants


def _participant(path: Path, key: Key) -> Participant:
    values = read_json(path, most_bytes=_MOST_BYTES, remedy=_REMEDY)
    if not isinstance(values, dict) or values.get("format") != FORMAT:
        raise InputError("is not a file of answers", where=path, remedy=_REMEDY)
    if values.get("study") != key.study:
        what = f"its answers are to another study than {key.study}"
        raise InputError(what, where=path, remedy="analyse it with the folder of its own study (--out)")
    try:
        return _checked(values, key)
    except ValueError as error:
        raise InputError(f"is damaged: {error}", where=path, remedy=_REMEDY) from None


def _checked(values: dict[str, Any], key: Key) -> Participant:
    """Raises ValueError, which says what is wrong."""
    _demand(set(values) == _FIELDS and values["version"] == _VERSION, "its fields are not those of a page")
    name, caps, answers = values["participant"], values["arrangement"], values["answers"]
    _demand(isinstance(name, str) and bool(_PARTICIPANT.fullmatch(name)), "the participant is no number")
    whole = isinstance(caps, list) and all(type(cap) is int for cap in caps)
    _demand(whole and sorted(caps) == list(range(1, CAP_COUNT + 1)), "the row has not each of the caps once")
    _demand(isinstance(answers, list) and len(answers) <= key.most_answers, "it has more answers than there are pairs")
    _demand(len(answers) > 0, "it has no answers")
    checked = tuple(_answer(number, item, key) for number, item in enumerate(answers, start=1))
    _demand(len({(a.question, a.pair, a.repeat) for a in checked}) == len(checked), "a pair was answered twice")
    return Participant(name, _type_of(caps, key), checked)


def _type_of(caps: Sequence[int], key: Key) -> str:
    cvd = suggest(score_arrangement(caps)).cvd
    if not cvd:
        return NO_TYPE
    has_pictures = any(item.cvd == cvd for item in key.shown.values())
    return cvd if has_pictures else f"{cvd}, others' pictures"


def _answer(number: int, item: Any, key: Key) -> Answer:
    where = f"answer {number}"
    _demand(isinstance(item, dict) and set(item) == _ANSWER_FIELDS, f"the fields of {where} are not those of a page")
    left, right, choice, question = item["left"], item["right"], item["choice"], item["question"]
    texts = all(isinstance(value, str) for value in (left, right, choice, question))
    _demand(texts and question in QUESTIONS, f"{where} is to no question of the study")
    _demand(left in key.shown and right in key.shown and left != right, f"{where} is about no pair of the study")
    _demand(key.shown[left].stimulus == key.shown[right].stimulus, f"{where} is about no pair of the study")
    _demand(choice in (left, right), f"{where} chose neither picture")
    _demand(type(item["repeat"]) is bool, f"{where} is unusable")
    _demand(type(item["ms"]) is int and 0 <= item["ms"] <= _MOST_MILLISECONDS, f"{where} took no possible time")
    other = right if choice == left else left
    return Answer(
        question=question,
        kind=key.shown[left].kind,
        pair=(min(left, right), max(left, right)),
        chosen=key.shown[choice].method,
        other=key.shown[other].method,
        chose_left=choice == left,
        repeat=item["repeat"],
    )


def _demand(holds: bool, otherwise: str) -> None:
    if not holds:
        raise ValueError(otherwise)
