"""What the parts that try recipes on captures have in common on the command line."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ...core.console import ConsoleReporter
from ...core.evaluate.studies.scenes import DEMO, SHOWROOMS, capture_sources
from ...core.evaluate.studies.subject import CaptureFolder
from ...core.processors import available_processors
from .options import names

QUICK: Mapping[str, Any] = {"captures": (DEMO,), "max_size": 120, "iterations": 200, "seeds": 1}
"""What `--quick` changes of the defaults; what is asked for stays."""
_PLACES = ("--out", "--work")  # whose values are this machine's affair
_PLACE = "PATH"  # in their stead


def add_study_arguments(
    parser: argparse.ArgumentParser,
    *,
    captures: Sequence[str] = SHOWROOMS,
    max_size: int,
    iterations: int,
    seeds: int = 1,
    processes: int | None = None,
) -> None:
    """Declare the options, with the part's own defaults; `processes`: a processor each unless given."""
    add = parser.add_argument
    add(
        "--captures",
        type=names,
        default=tuple(captures),
        metavar="A,B",
        help=f"{', '.join(SHOWROOMS)}, folders or NAME=FOLDER ({','.join(captures)})",
    )
    add_trial_arguments(parser, max_size=max_size, iterations=iterations, seeds=seeds, processes=processes)
    add("--quick", action="store_true", help="the demo alone, small and short: whether it works at all")
    parser.set_defaults(usual={name: parser.get_default(name) for name in QUICK})


def add_trial_arguments(
    parser: argparse.ArgumentParser, *, max_size: int, iterations: int, seeds: int, processes: int | None = None
) -> None:
    """Declare the options of all parts that train scenes; arguments as for `add_study_arguments`."""
    add, processes = parser.add_argument, processes or available_processors()
    add("--max-size", type=int, default=max_size, metavar="PIXELS", help=f"longer side of the views ({max_size})")
    add("--iterations", type=int, default=iterations, metavar="N", help=f"of a geometry ({iterations})")
    add("--seeds", type=int, default=seeds, metavar="N", help=f"of everything random ({seeds})")
    add("--processes", type=int, default=processes, metavar="N", help=f"that share the work ({processes})")
    add("--work", type=Path, metavar="DIR", help="for scenes, pictures and what lets a run go on (OUT/work)")
    add("--again", action="store_true", help="forget what an earlier run has measured")


def settled(options: argparse.Namespace) -> argparse.Namespace:
    """The options, with those of `QUICK` where that is asked for and they were left at their defaults."""
    chosen = vars(options).copy()
    if options.quick:
        chosen |= {name: value for name, value in QUICK.items() if chosen[name] == options.usual[name]}
    return argparse.Namespace(**chosen)


def work_folder(options: argparse.Namespace) -> Path:
    """Where everything goes that is not a result."""
    return options.work or options.out / "work"


def chosen_sources(options: argparse.Namespace) -> list[CaptureFolder]:
    """The captures that were asked for; showrooms that are missing are rendered.

    Raises:
        InputError: there is no such capture, or it could not be rendered.
    """
    reporter = ConsoleReporter(sys.stderr)
    return capture_sources(options.captures, options.max_size, work_folder(options) / "scenes", reporter)


def shown_command(options: argparse.Namespace, arguments: Sequence[str] | None = None) -> str:
    """The command as texts show it: with the part's name first, without what is this machine's affair alone.

    Args:
        arguments: as the shell gave them; those of this process unless given.
    """
    words = [part for word in (sys.argv[1:] if arguments is None else arguments) for part in _option_and_value(word)]
    shown = [
        "DIR" if before in _PLACES else ",".join(_without_place(part) for part in word.split(","))
        for before, word in zip(["", *words], words, strict=False)
    ]
    return " ".join(["python scripts/benchmark.py", *(shown or [options.part])])


def made_by(options: argparse.Namespace, *, trained: bool = True, seeds: int | None = None) -> list[str]:
    """The lines of a text that say how its figures were made.

    Args:
        trained: whether scenes were.
        seeds: how many of them, where they are not those of the options.
    """
    seeds = seeds or options.seeds
    count = f"{seeds} seeds" if seeds > 1 else "one seed"
    training = f", {options.iterations:,} steps, {count}" if trained else ""
    return [f"By `{shown_command(options)}`: views of at most {options.max_size} pixels{training}."]


def write_text(path: Path, lines: Sequence[str]) -> str:
    """Write the lines of a text; returns it."""
    text = "\n".join(lines).rstrip() + "\n"
    path.write_text(text, encoding="utf-8")
    return text


def _option_and_value(word: str) -> list[str]:
    """``--option=value`` as two words; others as they are."""
    option, separator, value = word.partition("=")
    return [option, value] if word.startswith("-") and separator else [word]


def _without_place(word: str) -> str:
    """NAME=PATH for a named folder or file, and PATH/NAME for one without a name of its own."""
    name, separator, _ = word.partition("=")
    if separator:
        return f"{name}={_PLACE}"
    return f"{_PLACE}/{Path(word).name}" if "/" in word else word
