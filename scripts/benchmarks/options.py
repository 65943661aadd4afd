"""The parts of scripts/benchmark.py as subcommands, and the options that several of them share."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import pandas as pd

from ...core.runtime.cli import ConsoleReporter
from ...core.runtime.resources import available_processors
from .provenance import SECONDS_PER_MINUTE, Facts, stamp
from .studies.captures import DEMO, SHOWROOMS, CaptureFolder, capture_sources

QUICK: Mapping[str, Any] = {"captures": (DEMO,), "max_size": 120, "iterations": 200, "seeds": 1}
"""The defaults under `--quick`; explicit options override them."""
_PATH_OPTIONS = ("--out", "--work")  # their values concern this machine alone
_PATH = "PATH"  # shown in place of local paths


@dataclass(frozen=True)
class Part:
    """A subcommand that measures something.

    Attributes:
        name: of the subcommand and of the files that it writes.
        summary: one line of help.
        add_arguments: adds its options; ``--out`` is already there.
        measure: measures and writes the files into ``options.out``; returns the text to print.
        pages: names of the pages among these that say by which recipe they were made.
        shaped_by: the constants that shape their figures.
    """

    name: str
    summary: str
    add_arguments: Callable[[argparse.ArgumentParser], None]
    measure: Callable[[argparse.Namespace], str]
    pages: tuple[str, ...] = ()
    shaped_by: Facts | None = None

    def run(self, options: argparse.Namespace, command: str = "") -> str:
        """Measure, and write into the pages where their figures come from.

        Args:
            command: as texts show it; that of this process by default.
        """
        before = {page: _written(options.out / page) for page in self.pages}
        started = time.monotonic()
        try:
            return self.measure(options)
        finally:  # also of a part that fails because of what its page says
            seconds = time.monotonic() - started
            for page in self.pages:
                if self.shaped_by is not None and _written(options.out / page) != before[page]:
                    stamp(options.out / page, command or shown_command(options), self.shaped_by, seconds)


def _written(page: Path) -> int:
    """When a page was written, in nanoseconds; 0 where there is none."""
    return page.stat().st_mtime_ns if page.is_file() else 0


def names(text: str) -> tuple[str, ...]:
    """Comma-separated words, at least one."""
    found = tuple(name.strip() for name in text.split(",") if name.strip())
    if not found:
        raise argparse.ArgumentTypeError(f"{text!r} names nothing")
    return found


def numbers(text: str) -> tuple[float, ...]:
    """Comma-separated numbers, at least one."""
    return tuple(float(number) for number in names(text))


def positive(text: str) -> int:
    """A whole number of at least 1."""
    try:
        found = int(text)
    except ValueError:
        found = 0
    if found < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number of at least 1")
    return found


def positives(text: str) -> tuple[int, ...]:
    """Comma-separated whole numbers of at least 1, at least one."""
    return tuple(map(positive, names(text)))


def named_path(text: str) -> tuple[str, Path]:
    """The name and the path of NAME=PATH."""
    name, separator, path = text.partition("=")
    if not separator or not name or not path:
        raise argparse.ArgumentTypeError(f"{text!r} is not NAME=PATH")
    return name, Path(path)


def add_study_arguments(
    parser: argparse.ArgumentParser,
    *,
    captures: Sequence[str] = SHOWROOMS,
    max_size: int,
    iterations: int,
    seeds: int | None = 1,
    processes: int | None = None,
    alone: bool = False,
) -> None:
    """Add the options of studies on several captures, for `with_quick_defaults`.

    Args:
        captures, max_size, iterations, seeds, processes: the part's own defaults; no `seeds` for a part that uses one
            alone, and no `processes` for one for each core.
        alone: whether the part lets nothing run at the same time.
    """
    add = parser.add_argument
    what = f"{', '.join(SHOWROOMS)}, folders or NAME=FOLDER ({','.join(captures)})"
    add("--captures", type=names, default=tuple(captures), metavar="A,B", help=what)
    sizes = {"max_size": max_size, "iterations": iterations}
    add_trial_arguments(parser, **sizes, seeds=seeds, processes=processes, alone=alone)
    add("--quick", action="store_true", help="the demo alone, small and short: a smoke test")
    leave_open(parser, QUICK)


def add_trial_arguments(
    parser: argparse.ArgumentParser,
    *,
    max_size: int,
    iterations: int,
    seeds: int | None,
    processes: int | None = None,
    alone: bool = False,
) -> None:
    """Add the options of all parts that train scenes; arguments as for `add_study_arguments`."""
    add, processes = parser.add_argument, processes or available_processors()
    parser.set_defaults(seeds=1, processes=1)
    add("--max-size", type=positive, default=max_size, metavar="PIXELS", help=f"longer side of the views ({max_size})")
    add("--iterations", type=positive, default=iterations, metavar="N", help=f"training steps ({iterations})")
    if seeds is not None:
        add("--seeds", type=positive, metavar="N", help=f"random seeds ({seeds})")
        parser.set_defaults(seeds=seeds)
    if not alone:
        add("--processes", type=positive, metavar="N", help=f"parallel processes ({processes})")
        parser.set_defaults(processes=processes)
    add("--work", type=Path, metavar="DIR", help="folder for scenes, pictures and finished trials (OUT/work)")
    add("--again", action="store_true", help="repeat trials that an earlier run has made")


def leave_open(parser: argparse.ArgumentParser, options: Iterable[str]) -> None:
    """Let `options` be None where they are not given, until `filled` gives them their defaults."""
    usual = {name: parser.get_default(name) for name in options}
    parser.set_defaults(usual=usual, **dict.fromkeys(usual))


def filled(options: argparse.Namespace, others: Mapping[str, Any] = MappingProxyType({})) -> argparse.Namespace:
    """The options, with their defaults for those that were left open; those of `others` come first."""
    defaults = {**options.usual, **others}
    given = {name: value for name, value in vars(options).items() if value is not None or name not in defaults}
    return argparse.Namespace(**{**defaults, **given})


def with_quick_defaults(options: argparse.Namespace) -> argparse.Namespace:
    """The options, with the values of `QUICK` for those that were not given if ``--quick`` was."""
    return filled(options, QUICK if options.quick else {})


def work_folder(options: argparse.Namespace) -> Path:
    """The folder for everything that is not a result."""
    return options.work or options.out / "work"


def chosen_sources(options: argparse.Namespace) -> list[CaptureFolder]:
    """The captures of ``--captures``; missing showrooms are rendered.

    Raises:
        InputError: there is no such capture, or it could not be rendered.
    """
    reporter = ConsoleReporter(sys.stderr)
    return capture_sources(options.captures, options.max_size, work_folder(options) / "scenes", reporter)


def shown_command(options: argparse.Namespace, arguments: Sequence[str] | None = None) -> str:
    """The command as texts show it: without local paths.

    Args:
        arguments: as the shell gave them; those of this process by default.
    """
    words = [part for word in (sys.argv[1:] if arguments is None else arguments) for part in _option_and_value(word)]
    shown = [
        "DIR" if before in _PATH_OPTIONS else ",".join(_without_path(part) for part in word.split(","))
        for before, word in zip(["", *words], words, strict=False)
    ]
    return " ".join(["python scripts/benchmark.py", *(shown or [options.part])])


def made_by(
    options: argparse.Namespace,
    trials: pd.DataFrame | None = None,
    *,
    views: str = "",
) -> list[str]:
    """The lines of a text that say how its figures were made; by which command says its provenance.

    Args:
        trials: columns of `Trial`, to say how long they took, in this call or an earlier one.
        views: which were used, if their size is not that of the options throughout.
    """
    views = views or f"Views of at most {options.max_size} pixels"
    training = f", {options.iterations:,} steps, {counted(options.seeds)}"
    took = "" if trials is None else f" {trials_took(trials, options.processes)}"
    return [f"{views}{training}.{took}"]


def counted(seeds: int) -> str:
    """The number of seeds, as texts name it."""
    return f"{seeds} seeds" if seeds > 1 else "one seed"


def trials_took(trials: pd.DataFrame, processes: int) -> str:
    """The number of trials and their minutes, in a sentence.

    Args:
        trials: columns of `Trial`, each trial once.
        processes: how many ran at a time.
    """
    minutes = trials.trial_seconds.sum() / SECONDS_PER_MINUTE
    if processes == 1:
        return f"{len(trials)} trials took {minutes:.0f} minutes, one after the other."
    return f"{len(trials)} trials took {minutes:.0f} minutes together, up to {processes} at a time."


def _option_and_value(word: str) -> list[str]:
    """``--option=value`` as two words; others as they are."""
    option, separator, value = word.partition("=")
    return [option, value] if word.startswith("-") and separator else [word]


def _without_path(word: str) -> str:
    """NAME=PATH for a named folder or file, PATH/NAME for an unnamed one."""
    name, separator, _ = word.partition("=")
    if separator:
        return f"{name}={_PATH}"
    return f"{_PATH}/{Path(word).name}" if "/" in word else word
