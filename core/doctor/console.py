"""The doctor on a console: a line for each finding, or JSON for programs. Standard library only."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Sequence

from ..runtime.cli import ConsoleReporter
from ..runtime.protocol import Reporter
from .checks import examine
from .interpreters import Finding, State

DOCTOR = "--doctor"
NAME_WIDTH = max(len("temporary files"), len("colour-science")) + 1


def diagnose_in_console(*, as_json: bool) -> int:
    """Examine and print; returns the exit code: 0 when the main job can run here, 2 when something is missing."""
    reporter = ConsoleReporter(sys.stderr) if sys.stderr.isatty() else Reporter()
    findings: list[Finding] = []
    for finding in examine(reporter):
        findings.append(finding)
        if not as_json:
            _say(format_finding(finding))
    if as_json:
        document = {"ready": not missing(findings), "findings": [finding.to_dict() for finding in findings]}
        _say(json.dumps(document, indent=2))
    else:
        _say(_last_word(findings))
    return 2 if missing(findings) else 0


def _say(text: str) -> None:
    """Print; discard everything once the reader of a pipe (``| head``) has gone."""
    try:
        print(text, flush=True)
    except BrokenPipeError:
        with open(os.devnull, "w") as nowhere:
            os.dup2(nowhere.fileno(), sys.stdout.fileno())


def missing(findings: Sequence[Finding]) -> list[str]:
    """The names of what has to be there and is not."""
    return [finding.name for finding in findings if finding.state is State.MISSING]


def format_finding(finding: Finding) -> str:
    """Its line, and one with the remedy if there is any."""
    line = f"{finding.state.value:<8}{finding.name:<{NAME_WIDTH}} {finding.found}"
    if finding.remedy:
        line += f"\n{'':<8}{'':<{NAME_WIDTH}} -> {finding.remedy}"
    return line


def _last_word(findings: Sequence[Finding]) -> str:
    names = missing(findings)
    if names:
        return f"Missing: {', '.join(names)}. Follow the arrows from top to bottom, then run the doctor again."
    return "Everything that a run needs is here."
