"""Fuzzes the readers for longer than a test may: each in a process of its own, with a bound on its memory.

    python -m tests.fuzz.campaign [NAME ...] [--executions 100000] [--seconds N] [--engine atheris|mutator] [--seed N]

From the repository's root. ``atheris`` (`pip install --require-hashes -r requirements-fuzz.txt`) follows the coverage
of the package; ``mutator`` applies the edits of `mutation` with fixed seeds and needs nothing. What a reader did not
expect is written to ``out/fuzz/<name>/`` (a copy in ``tests/fuzz/seeds/<name>/`` becomes a test) and ends that reader's
turn. Prints a line for each reader: executions, seconds, and what was found. Exit code: 1 where something was.
"""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import os
import random
import re
import resource
import sys
import time
import traceback
from pathlib import Path
from typing import TYPE_CHECKING

from .mutation import PAYLOADS, edited, random_edits

if TYPE_CHECKING:
    from .targets import Target  # only by name: atheris has to be there when the package is loaded

ROOT = Path(__file__).resolve().parents[2]
FINDINGS = ROOT / "out" / "fuzz"
MEMORY_BYTES = 4 << 30
"""Of address space that a reader's process may take with torch, OpenImageIO and pycolmap in it."""
_LEAST_LONGEST = 2048  # bytes of an input, or twice the longest example; longer ones take time and hide nothing
_LONGEST_WORD = 64  # bytes; of libFuzzer's dictionary


def main(arguments: list[str]) -> int:
    """Fuzz; returns the exit code."""
    options = _parse(arguments)
    targets = {target.name: target for target in _load(options.engine)}
    unknown = sorted(set(options.names) - set(targets))
    if unknown:
        print(f"campaign.py: no reader is called {', '.join(unknown)}; there are {', '.join(targets)}", file=sys.stderr)
        return 2
    print(f"| reader | executions ({options.engine}) | seconds | found |\n|---|--:|--:|---|", flush=True)
    found = 0
    for name in options.names or targets:
        started = time.monotonic()
        done, problem = _run_child(targets[name], options)
        found += bool(problem)
        print(f"| {name} | {done:,} | {time.monotonic() - started:.0f} | {problem or 'nothing'} |", flush=True)
    return 1 if found else 0


def _load(engine: str) -> tuple[Target, ...]:
    """The targets; for atheris with the package's code instrumented."""
    if engine != "atheris":
        return importlib.import_module("tests.fuzz.targets").TARGETS
    import atheris

    with atheris.instrument_imports(include=["cvdgs.core"]):
        return importlib.import_module("tests.fuzz.targets").TARGETS


def _parse(arguments: list[str]) -> argparse.Namespace:
    has_atheris = importlib.util.find_spec("atheris") is not None
    parser = argparse.ArgumentParser(prog="campaign.py", description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help="readers (default: all)")
    parser.add_argument("--executions", type=int, default=100_000, help="of each reader (100000)")
    parser.add_argument("--seconds", type=int, default=0, help="for each reader at most; 0: as long as it takes")
    parser.add_argument("--engine", choices=("atheris", "mutator"), default="atheris" if has_atheris else "mutator")
    parser.add_argument("--seed", type=int, default=1)
    return parser.parse_args(arguments)


def _run_child(target: Target, options: argparse.Namespace) -> tuple[int, str]:
    """Fuzz one reader in a process of its own; returns the executions and what was found."""
    folder = FINDINGS / target.name
    folder.mkdir(parents=True, exist_ok=True)
    process = os.fork()
    if process == 0:
        with open(folder / "log.txt", "w") as log:
            os.dup2(log.fileno(), 1)
            os.dup2(log.fileno(), 2)
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
        try:
            code = _fuzz(target, folder, options)
        except BaseException:
            traceback.print_exc()
            code = 1
        sys.stdout.flush()
        os._exit(code)
    code = os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
    log_text = (folder / "log.txt").read_text(encoding="utf-8", errors="replace")
    done = [int(number) for number in re.findall(r"^(?:Done |#)(\d+)\b", log_text, re.MULTILINE)]
    if code == 0:
        return max(done, default=0), ""
    reasons = re.findall(r"^(\w*(?:Error|Exception)\b.*|.*ERROR: libFuzzer.*)$", log_text, re.MULTILINE)
    return max(done, default=0), (reasons[0] if reasons else f"exit code {code}")[:120]


def _fuzz(target: Target, folder: Path, options: argparse.Namespace) -> int:
    """In the child: fuzz the reader; does not return under atheris, which ends the process."""
    starts = [*target.examples(), *(path.read_bytes() for path in (ROOT / "tests/fuzz/seeds" / target.name).glob("*"))]
    if options.engine == "mutator":
        return _mutate(target, starts, folder, options)
    import atheris

    corpus = folder / "corpus"
    corpus.mkdir(parents=True, exist_ok=True)
    for number, data in enumerate(starts):
        (corpus / f"example-{number}").write_bytes(data)
    words = folder / "words.txt"
    words.write_text("".join(f'"{_escaped(word)}"\n' for word in PAYLOADS if len(word) <= _LONGEST_WORD))
    flags = [f"-runs={options.executions}", f"-seed={options.seed}", f"-artifact_prefix={folder}/", "-timeout=30"]
    flags += [f"-max_len={_longest(target)}", f"-dict={words}", f"-max_total_time={options.seconds}", "-rss_limit_mb=0"]

    def read(data: bytes) -> None:
        try:
            target(data)
        except BaseException:  # libFuzzer itself keeps only what ends the process
            (folder / "crash").write_bytes(data)
            raise

    atheris.Setup([sys.argv[0], *flags, str(corpus)], read)
    atheris.Fuzz()
    return 0


def _longest(target: Target) -> int:
    return max(_LEAST_LONGEST, 2 * max(map(len, target.examples())))


def _escaped(word: bytes) -> str:
    """`word` as libFuzzer's dictionaries have it."""
    return "".join(f"\\x{byte:02x}" for byte in word)


def _mutate(target: Target, starts: list[bytes], folder: Path, options: argparse.Namespace) -> int:
    started, last, longest = time.monotonic(), folder / "last", _longest(target)
    for number in range(options.executions):
        if options.seconds and time.monotonic() - started > options.seconds:
            break
        generator = random.Random(options.seed * 1_000_003 + number)
        data = edited(generator.choice(starts), random_edits(generator))[:longest]
        last.write_bytes(data)  # stays where the process itself ends
        try:
            target(data)
        except BaseException:
            traceback.print_exc()
            (folder / f"crash-{number}").write_bytes(data)
            print(f"#{number + 1}")
            return 1
        if number % 1000 == 999:
            print(f"#{number + 1}", flush=True)
    else:
        number = options.executions
    print(f"Done {number}")
    last.unlink(missing_ok=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
