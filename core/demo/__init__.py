"""The embedded demo capture: 40 photographs of a textile showroom with exact cameras, sparse points and depth maps.

`scripts/make_showroom.py` made it; the folder's README says how.
"""

from __future__ import annotations

from pathlib import Path

SHOWROOM: Path = Path(__file__).resolve().parent / "showroom"
"""The capture folder (transforms.json, images/, points.ply, depth/)."""
