"""The N-panel, tab "CVD": its sub-panels, in the order of the work."""

from __future__ import annotations

from .capture import CLASSES as CAPTURE
from .display import CVDGS_PT_display
from .results import CLASSES as RESULTS
from .run import CVDGS_PT_run
from .turntable import CVDGS_PT_turntable
from .viewer import CVDGS_MT_viewer_presets, CVDGS_PT_simulate, CVDGS_PT_viewer

CLASSES: tuple[type, ...] = (
    *CAPTURE,
    CVDGS_MT_viewer_presets,
    CVDGS_PT_viewer,
    CVDGS_PT_run,
    CVDGS_PT_display,
    CVDGS_PT_simulate,
    CVDGS_PT_turntable,
    *RESULTS,
)
"""Those that come first stand on top."""
