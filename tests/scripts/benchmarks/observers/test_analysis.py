"""The analysis finds what simulated participants prefer, and says no more than they answered."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.optimize import minimize

from cvdgs.scripts.benchmarks.observers.analysis import EVERYBODY, RIDGE, agreement, bradley_terry, strengths
from cvdgs.scripts.benchmarks.observers.answers import NO_TYPE, Participant, read_answers
from cvdgs.scripts.benchmarks.observers.results import NAME, write_results
from cvdgs.scripts.benchmarks.observers.study import Key

from .sessions import IN_ORDER, METHODS, ROWS, TRUTH, saved, session, study

REPLICATIONS, PARTICIPANTS = 60, 8
DRAWS = 300


@pytest.fixture(scope="module")
def key() -> Key:
    return study()


def participants(key: Key, folder, seeds, **options) -> list[Participant]:
    return read_answers([saved(folder, session(key, seed, **options)) for seed in seeds], key)


def of_everybody(found: pd.DataFrame, question: str) -> pd.DataFrame:
    return found[(found.group == EVERYBODY) & (found.question == question)].set_index("method")


@settings(max_examples=30, deadline=None)
@given(arrays(np.int64, (4, 4), elements=st.integers(0, 30)))
def test_strengths_are_those_of_a_general_optimiser(counts: np.ndarray) -> None:
    np.fill_diagonal(counts, 0)

    def loss(values: np.ndarray) -> float:
        differences = values[:, None] - values[None, :]
        return float((counts * np.logaddexp(0.0, -differences)).sum() + RIDGE / 2.0 * (values**2).sum())

    best = minimize(loss, np.zeros(4), method="BFGS", options={"gtol": 1e-8}).x
    np.testing.assert_allclose(bradley_terry(counts.astype(float)), best - best.mean(), atol=1e-4)


def test_two_methods_have_the_odds_of_their_counts() -> None:
    found = bradley_terry(np.array([[0.0, 300.0], [100.0, 0.0]]), ridge=1e-9)
    assert found[0] - found[1] == pytest.approx(np.log(3.0), abs=1e-6)


@pytest.mark.slow
def test_the_truth_about_simulated_participants_is_found(key: Key, tmp_path) -> None:
    """Of 95 % intervals at least 90 % have to hold the truth; and the order of means over all studies has to be it."""
    held, asked = 0, 0
    orders = {question: np.zeros(len(METHODS)) for question in TRUTH}
    for replication in range(REPLICATIONS):
        seeds = range(1000 * replication, 1000 * replication + PARTICIPANTS)
        found = strengths(participants(key, tmp_path, seeds), key, draws=DRAWS, seed=replication)
        for question, truth in TRUTH.items():
            rows = of_everybody(found, question)
            orders[question] += rows.strength[list(METHODS)].to_numpy()
            for method in METHODS[1:]:
                held += rows.low[method] <= truth[method] <= rows.high[method]
                asked += 1
    for question, truth in TRUTH.items():
        best_first = sorted(METHODS, key=lambda method: -truth[method])
        assert [METHODS[place] for place in np.argsort(-orders[question])] == best_first
    assert held / asked >= 0.9


def test_a_single_study_finds_the_order_of_what_lies_apart(key: Key, tmp_path) -> None:
    found = strengths(participants(key, tmp_path, range(24), noise=0.3), key, draws=DRAWS)
    rows = of_everybody(found, "visibility")
    assert rows.strength["scene"] > rows.strength["gain"] > rows.strength["original"] == 0.0
    assert rows.low["scene"] > 0.0
    assert rows.preferred["original"] == 50.0
    assert of_everybody(found, "naturalness").high["lut"] < 0.0


def test_participants_who_toss_coins_prefer_nothing(key: Key, tmp_path) -> None:
    nothing = {question: dict.fromkeys(METHODS, 0.0) for question in TRUTH}
    everybody = participants(key, tmp_path, range(40), truth=nothing)
    found = strengths(everybody, key, draws=DRAWS)
    assert found.strength.abs().max() < 0.5
    assert agreement(everybody, draws=DRAWS).same.between(35.0, 65.0).all()


def test_participants_who_are_sure_agree_with_themselves(key: Key, tmp_path) -> None:
    sure = {question: {method: 50.0 * place for place, method in enumerate(METHODS)} for question in TRUTH}
    everybody = participants(key, tmp_path, range(3), truth=sure)
    repeated = agreement(everybody, draws=DRAWS)
    assert (repeated.same == 100.0).all()
    assert np.isfinite(strengths(everybody, key, draws=DRAWS).strength).all()


def test_types_are_told_apart_by_the_row_of_caps(key: Key, tmp_path) -> None:
    sessions = [session(key, 1, cvd="protan"), session(key, 2), session(key, 3)]
    sessions.append({**session(key, 4), "arrangement": IN_ORDER})
    everybody = read_answers([saved(tmp_path, one) for one in sessions], key)
    found = strengths(everybody, key, draws=DRAWS)
    counts = found.groupby("group").participants.first().to_dict()
    assert counts == {EVERYBODY: 4, "protan": 1, "deutan": 2, NO_TYPE: 1}


def test_a_tritan_who_saw_pictures_made_for_others_is_a_group_of_its_own_that_says_so(key: Key, tmp_path) -> None:
    tritan = {**session(key, 1, cvd="protan"), "arrangement": ROWS["tritan"]}
    (participant,) = read_answers([saved(tmp_path, tritan)], key)
    assert participant.cvd == "tritan, others' pictures"
    served = study(types=("protan", "tritan"))
    (participant,) = read_answers([saved(tmp_path, session(served, 1, cvd="tritan"))], served)
    assert participant.cvd == "tritan"


def test_a_single_participant_has_no_interval(key: Key, tmp_path) -> None:
    found = strengths(participants(key, tmp_path, [5]), key, draws=DRAWS)
    assert found.low.isna().all()
    assert found.strength.notna().all()


def test_the_results_are_a_table_a_text_and_a_chart(key: Key, tmp_path) -> None:
    text = write_results(tmp_path, participants(key, tmp_path, range(6)), key, "command", draws=DRAWS)
    written = pd.read_csv(tmp_path / f"{NAME}.csv")
    assert set(written.method) == set(METHODS)
    assert "| all | visibility | scene | 6 |" in text
    assert {path.name for path in tmp_path.glob("*.svg")} == {f"{NAME}.svg", f"{NAME}-dark.svg"}
