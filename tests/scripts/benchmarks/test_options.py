"""The options that parts share: quick defaults, work folders, and the command as texts show it."""

from __future__ import annotations

import argparse
from pathlib import Path

import pandas as pd
import pytest

from cvdgs.scripts.benchmarks.options import (
    QUICK,
    add_study_arguments,
    made_by,
    shown_command,
    trials_took,
    with_quick_defaults,
    work_folder,
)
from cvdgs.scripts.benchmarks.studies.captures import SHOWROOMS


def options(*arguments: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    parser.add_argument("--out", type=Path)
    add_study_arguments(parser, max_size=240, iterations=800, seeds=3)
    return parser.parse_args(arguments)


def test_quick_changes_what_was_left_at_its_default_and_nothing_else():
    quick = with_quick_defaults(options("--quick", "--iterations", "70"))
    assert quick.iterations == 70
    assert (quick.captures, quick.max_size, quick.seeds) == (QUICK["captures"], QUICK["max_size"], QUICK["seeds"])
    usual = with_quick_defaults(options())
    assert (usual.captures, usual.max_size, usual.iterations, usual.seeds) == (SHOWROOMS, 240, 800, 3)


def test_what_is_not_a_result_goes_to_the_work_folder():
    assert work_folder(options("--out", "tables")) == Path("tables/work")
    assert work_folder(options("--out", "tables", "--work", "scratch")) == Path("scratch")


def test_a_text_says_how_many_trials_ran_at_a_time():
    trials = pd.DataFrame({"trial_seconds": [90.0, 150.0]})
    assert trials_took(trials, 1) == "2 trials took 4 minutes, one after the other."
    assert trials_took(trials, 3) == "2 trials took 4 minutes together, up to 3 at a time."
    assert made_by(options("--processes", "3"), trials)[0].endswith(trials_took(trials, 3))


def test_a_text_gives_the_size_of_all_views_unless_it_differs():
    assert made_by(options()) == ["Views of at most 240 pixels, 800 steps, 3 seeds."]
    assert made_by(options(), views="Views of 120, 240 pixels", seeds=1) == [
        "Views of 120, 240 pixels, 800 steps, one seed."
    ]


@pytest.mark.parametrize(
    ("arguments", "shown"),
    [
        ("table --out /home/me/out --seeds 2", "table --out DIR --seeds 2"),
        ("table --out=/home/me/out --work=/tmp/w", "table --out DIR --work DIR"),
        ("table --captures demo,room=/home/me/room,/data/fox", "table --captures demo,room=PATH,PATH/fox"),
        ("table --captures=room=/home/me/room", "table --captures room=PATH"),
        ("ablation --weights instance=/home/me/w.safetensors", "ablation --weights instance=PATH"),
    ],
)
def test_texts_show_no_local_paths(arguments, shown):
    found = shown_command(argparse.Namespace(part="table"), arguments.split())
    assert found == f"python scripts/benchmark.py {shown}"
