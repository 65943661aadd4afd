"""How the set of Gaussians changes during training: densification strategies as swappable values. numpy only."""

from .clone_split import CloneSplitPrune
from .model import Evidence, Refinement, Schedule, Strategy, ViewEvidence, ViewEvidenceSum
from .multi_view import MultiViewConsistent
from .relocation import Relocation

__all__ = [
    "CloneSplitPrune",
    "Evidence",
    "MultiViewConsistent",
    "Refinement",
    "Relocation",
    "Schedule",
    "Strategy",
    "ViewEvidence",
    "ViewEvidenceSum",
]
