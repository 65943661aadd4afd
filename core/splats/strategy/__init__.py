"""How the set of Gaussians changes during training: strategies as swappable values. numpy only."""

from .clone_split import CloneSplitPrune
from .model import Evidence, Refinement, Schedule, Strategy, ViewEvidence
from .multi_view import MultiViewConsistent

__all__ = [
    "CloneSplitPrune",
    "Evidence",
    "MultiViewConsistent",
    "Refinement",
    "Schedule",
    "Strategy",
    "ViewEvidence",
]
