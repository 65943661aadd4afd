"""Other densification strategies than the product's, to compare it with: those of the field."""

from .clone_split import CloneSplitPrune
from .relocation import Relocation

__all__ = ["CloneSplitPrune", "Relocation"]
