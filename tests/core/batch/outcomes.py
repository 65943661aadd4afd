"""What a batch did, as its tests compare it."""

from __future__ import annotations

from pathlib import Path


def ends(events: list[dict]) -> dict[str, str]:
    """State by task."""
    return {event["task"]: event["state"] for event in events if event["event"] == "task"}


def contents(folder: Path) -> dict[str, bytes]:
    """The pictures anywhere in `folder`, by their paths in it."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*.png")}
