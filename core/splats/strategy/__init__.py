"""How the set of Gaussians changes during training: densification strategies as a swappable value. numpy only."""

from .model import Evidence, Refinement, Schedule, Strategy, ViewEvidence, ViewEvidenceSum
from .multi_view import MultiViewConsistent

__all__ = [
    "Evidence",
    "MultiViewConsistent",
    "Refinement",
    "Schedule",
    "Strategy",
    "ViewEvidence",
    "ViewEvidenceSum",
]
