"""``run.py --doctor``: what a run needs, what of it is here, and how to get the rest. Standard library only."""

from .checks import examine
from .interpreters import Finding, State

__all__ = ["Finding", "State", "examine"]
