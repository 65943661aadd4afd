"""``run.py --doctor``: what a run needs, what of it is here, and how to get the rest. Standard library only."""

from .examination import examine
from .finding import Finding, State

__all__ = ["Finding", "State", "examine"]
