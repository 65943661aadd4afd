"""A study with people: makes its page, and analyses what they answered. Command: ``benchmark.py observers``."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from ....core.errors import InputError
from ....core.runtime.cli import ConsoleReporter
from ..enhancers.methods import check_labels
from ..options import Part, named_path, names, positive, shown_command, work_folder
from ..studies.captures import DEMO, SHOWROOMS, capture_sources
from .answers import read_answers
from .page import write_study_page
from .results import write_results
from .stimuli import METHODS, stills, turntables
from .study import KEY_FILE, read_key, with_codes, write_key

TYPES = ("protan", "deutan", "tritan")
_STILLS, _FRAMES, _SIZE = 4, 24, 480
_MOST_FILES = 1000
STAGE = "observers"


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--analyse", type=Path, nargs="+", metavar="FILE", help="participants' files; OUT is the folder of their study")
    what = f"{', '.join(SHOWROOMS)}, folders or NAME=FOLDER, whose photographs are shown ({DEMO})"
    add("--captures", type=names, default=(DEMO,), metavar="A,B", help=what)
    add("--stills", type=positive, default=_STILLS, metavar="N", help=f"photographs of each capture ({_STILLS})")
    what = "finished run whose turntable is shown, made with --turntable; may be repeated"
    add("--run", type=named_path, action="append", default=[], dest="runs", metavar="NAME=DIR", help=what)
    add("--frames", type=positive, default=_FRAMES, metavar="N", help=f"of a turntable ({_FRAMES})")
    what = f"types to make pictures for; the arrangement test chooses among them ({','.join(TYPES[:2])})"
    add("--cvd", type=names, default=TYPES[:2], metavar="A,B", help=what)
    add("--max-size", type=positive, default=_SIZE, metavar="PIXELS", help=f"longer side of the pictures ({_SIZE})")
    add("--seed", type=int, default=0, metavar="N", help="of the codes that hide the methods (0)")
    add("--work", type=Path, metavar="DIR", help="folder for rendered showrooms (OUT/work)")


def _measure(options: argparse.Namespace) -> str:
    """Write observers.html and its key; or with ``--analyse`` the results."""
    if options.analyse:
        return _analyse(options)
    _check(options)
    reporter = ConsoleReporter(sys.stderr)
    sources = capture_sources(options.captures, options.max_size, work_folder(options) / "scenes", reporter)
    stimuli = []
    for done, cvd in enumerate(options.cvd):
        reporter.progress(STAGE, done / len(options.cvd), f"pictures for {cvd} vision")
        stimuli += [found for source in sources for found in stills(source, cvd, options.stills)]
        stimuli += turntables(dict(options.runs), cvd, options.frames, options.max_size)
    key, coded = with_codes(stimuli, shown_command(options), options.seed)
    write_key(options.out, key)
    page = write_study_page(options.out, key, coded)
    return (
        f"{page.name}: {len(stimuli)} stimuli, study {key.study}. Give it to participants; keep {KEY_FILE}, without "
        "which their answers cannot be read."
    )


def _analyse(options: argparse.Namespace) -> str:
    if len(options.analyse) > _MOST_FILES:
        what = f"{len(options.analyse)} files are too many"
        raise InputError(what, where="--analyse", remedy=f"give {_MOST_FILES} at most")
    key = read_key(options.out)
    participants = read_answers(options.analyse, key)
    command = f"python scripts/benchmark.py observers --out DIR --analyse FILES ({len(participants)} files)"
    return write_results(options.out, participants, key, command)


def _check(options: argparse.Namespace) -> None:
    """Raises `InputError` for what would fail after minutes."""
    unknown = sorted(set(options.cvd) - set(TYPES))
    if unknown or not options.cvd or len(set(options.cvd)) < len(options.cvd):
        what = f"unusable types '{','.join(options.cvd)}'"
        raise InputError(what, where="--cvd", remedy=f"use some of {','.join(TYPES)}, each once")
    for name, value, least in (("--stills", options.stills, 1), ("--frames", options.frames, 2)):
        if value < least:
            raise InputError(f"{value} is too small", where=name, remedy=f"give {least} or more")
    labels = [name for name, _ in options.runs]
    check_labels(labels)
    if METHODS[0] in labels:
        raise InputError(f"a run cannot be called {METHODS[0]}", where="--run", remedy="give it another name")


PART = Part("observers", "a study with people: its page, and what they answered", _add_arguments, _measure)
