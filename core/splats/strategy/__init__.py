"""How the set of Gaussians changes during training: strategies as swappable values. numpy only."""

from .clone_split import CloneSplitPrune
from .evidence import Evidence, ViewEvidence, ViewEvidenceSum
from .model import Refinement, Schedule, Strategy
from .multi_view import MultiViewConsistent
from .pruning import floaters, unseen
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
    "floaters",
    "unseen",
]
