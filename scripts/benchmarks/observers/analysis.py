"""How much each method is preferred: Bradley-Terry strengths by maximum likelihood, with bootstrap intervals.

Bradley and Terry (1952), "Rank analysis of incomplete block designs: I. The method of paired comparisons", Biometrika
39: the probability that i is chosen over j is 1 / (1 + exp(strength_j - strength_i)). A small ridge keeps strengths
finite where a method was always or never chosen. Participants differ from each other more than the answers of one
do, so the bootstrap draws whole participants.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import stats

from ..tables import frame_of
from .answers import Participant
from .study import KINDS, QUESTIONS, Key

EVERYBODY = "all"
RIDGE = 0.05
"""Of the squared strengths; weighs as much as a tenth of an answer."""
DRAWS = 2000
LEVEL = 0.95
"""Of the intervals."""
_NEWTON_STEPS = 40
_LONGEST_STEP = 1.0  # of a strength, so that far starts do not overshoot


@dataclass(frozen=True)
class Strength:
    """How much a method is preferred to the first one.

    Attributes:
        group: type of CVD by the arrangement test, or `EVERYBODY`.
        kind: of the stimuli.
        question: a name of `QUESTIONS`.
        method: its name.
        participants, answers: how many gave how many about the method, repeated pairs left out.
        strength: natural logarithm of the odds of being chosen over the first method.
        low, high: bounds of its interval; NaN with a single participant.
        preferred: probability in percent of being chosen over the first method.
    """

    group: str
    kind: str
    question: str
    method: str
    participants: int
    answers: int
    strength: float
    low: float
    high: float
    preferred: float


@dataclass(frozen=True)
class Agreement:
    """How often the second answer to a pair was the first one's.

    Attributes:
        group, question: as for `Strength`.
        pairs: shown twice.
        same: percent answered alike; 50 would be chance.
        low, high: bounds of its interval.
        left: percent of all answers that chose the left picture.
    """

    group: str
    question: str
    pairs: int
    same: float
    low: float
    high: float
    left: float


def strengths(participants: Sequence[Participant], key: Key, *, draws: int = DRAWS, seed: int = 0) -> pd.DataFrame:
    """A row of `Strength` for every method, question, kind and group that has answers.

    Args:
        draws: of the bootstrap.
        seed: of the draws.
    """
    rows = [
        row
        for group, members in groups(participants).items()
        for kind in KINDS
        for question in QUESTIONS
        for row in _strengths(group, members, kind, question, key.methods(kind), draws, seed)
    ]
    return frame_of(Strength, rows)


def agreement(participants: Sequence[Participant], *, draws: int = DRAWS, seed: int = 0) -> pd.DataFrame:
    """A row of `Agreement` for every question and group that has answers; as `strengths`."""
    rows = [
        row
        for group, members in groups(participants).items()
        for question in QUESTIONS
        for row in _agreement(group, members, question, draws, seed)
    ]
    return frame_of(Agreement, rows)


def groups(participants: Sequence[Participant]) -> dict[str, list[Participant]]:
    """Everybody, and if there are several types, the participants of each."""
    by_type: dict[str, list[Participant]] = {}
    for participant in sorted(participants, key=lambda one: one.cvd):
        by_type.setdefault(participant.cvd, []).append(participant)
    return {EVERYBODY: list(participants), **by_type}


def wins(participant: Participant, kind: str, question: str, methods: Sequence[str]) -> NDArray[np.float64]:
    """(K, K) how often each method was chosen over each other one; second showings left out."""
    counts = np.zeros((len(methods), len(methods)))
    for answer in participant.answers:
        if answer.kind == kind and answer.question == question and not answer.repeat:
            counts[methods.index(answer.chosen), methods.index(answer.other)] += 1.0
    return counts


def bradley_terry(counts: NDArray[np.float64], ridge: float = RIDGE) -> NDArray[np.float64]:
    """(..., K) strengths, whose mean is 0, by Newton's method on the penalised likelihood, which is concave.

    Args:
        counts: (..., K, K) how often each was chosen over each other one.
        ridge: half of it weighs the sum of squared strengths.
    """
    count = counts.shape[-1]
    total = counts + counts.swapaxes(-1, -2)
    found = np.zeros(counts.shape[:-1])
    for _ in range(_NEWTON_STEPS):
        chances = 1.0 / (1.0 + np.exp(found[..., None, :] - found[..., :, None]))
        slope = (counts - total * chances).sum(-1) - ridge * found
        curvature = total * chances * (1.0 - chances)
        hessian = -curvature
        hessian[..., range(count), range(count)] += curvature.sum(-1) + ridge
        step = np.linalg.solve(hessian, slope[..., None])[..., 0]
        found += np.clip(step, -_LONGEST_STEP, _LONGEST_STEP)
    return found - found.mean(-1, keepdims=True)


def _strengths(
    group: str, members: Sequence[Participant], kind: str, question: str, methods: Sequence[str], draws: int, seed: int
) -> list[Strength]:
    counts = np.array([wins(member, kind, question, methods) for member in members])
    counts = counts[counts.sum((1, 2)) > 0] if methods else counts
    if not methods or not len(counts):
        return []
    # Strengths over the first method: only differences mean anything.
    found = _over_the_first(bradley_terry(counts.sum(0)))
    low, high = _interval(lambda drawn: _over_the_first(bradley_terry(drawn)), counts, draws, seed)
    given = counts.sum(0) + counts.sum(0).T
    return [
        Strength(
            *(group, kind, question, method, len(counts), int(given[place].sum())),
            *(float(found[place]), float(low[place]), float(high[place])),
            preferred=float(100.0 / (1.0 + np.exp(-found[place]))),
        )
        for place, method in enumerate(methods)
    ]


def _agreement(group: str, members: Sequence[Participant], question: str, draws: int, seed: int) -> list[Agreement]:
    asked = [[answer for answer in member.answers if answer.question == question] for member in members]
    every = [answer for answers in asked for answer in answers]
    counted = []
    for answers in asked:
        first = {answer.pair: answer.chosen for answer in answers if not answer.repeat}
        again = [answer for answer in answers if answer.repeat and answer.pair in first]
        counted.append((sum(first[answer.pair] == answer.chosen for answer in again), len(again)))
    pairs = np.array([count for count in counted if count[1]], float).reshape(-1, 2)
    if not len(pairs):
        return []
    low, high = _interval(lambda drawn: 100.0 * drawn[..., 0] / drawn[..., 1], pairs, draws, seed)
    same, total = pairs.sum(0)
    left = 100.0 * sum(answer.chose_left for answer in every) / len(every)
    return [Agreement(group, question, int(total), float(100.0 * same / total), float(low), float(high), left)]


def _over_the_first(found: NDArray[np.float64]) -> NDArray[np.float64]:
    return found - found[..., :1]


def _interval(
    figure: Callable[[NDArray[np.float64]], NDArray[np.float64]], counts: NDArray[np.float64], draws: int, seed: int
) -> NDArray[np.float64]:
    """(2, ...) percentiles of a figure of summed counts over draws of participants; NaN for a single one.

    Args:
        figure: of (..., *shape) sums.
        counts: (participants, *shape).
    """
    number = len(counts)
    rng = np.random.default_rng(seed)
    times = rng.multinomial(number, np.full(number, 1.0 / number), size=draws).astype(float)
    found = figure(np.tensordot(times, counts, 1))
    # Percentiles of the bootstrap are too narrow for few participants: levels are those of Student's distribution
    # instead (Hesterberg 2015, "What teachers should know about the bootstrap", The American Statistician 69).
    wide = stats.t.ppf((1.0 + LEVEL) / 2.0, max(number - 1, 1)) * np.sqrt(number / max(number - 1, 1))
    bounds = np.quantile(found, stats.norm.cdf([-wide, wide]), axis=0)
    return bounds if number > 1 else np.full_like(bounds, np.nan)
