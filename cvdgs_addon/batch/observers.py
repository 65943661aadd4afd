"""For whom a batch simulates what is seen, by the name of the layer that is made for them."""

from __future__ import annotations

from dataclasses import dataclass

from ...core.color.matrices import check_simulation
from ...core.errors import InputError


@dataclass(frozen=True)
class Observer:
    """A kind of colour vision and the model that describes it; see `core.color.matrices`."""

    cvd: str
    severity: float
    model: str

    @classmethod
    def from_name(cls, name: str, model: str) -> Observer:
        """The observer for whom the layer `name` is, e.g. ``deutan-1.0``; Brettel's model where `model` has none.

        Raises:
            InputError: there is no such observer.
        """
        cvd, _, severity = name.rpartition("-")
        try:
            observer = cls(cvd, float(severity), "brettel" if (cvd, model) == ("tritan", "vienot") else model)
        except ValueError:
            raise InputError(f"'{name}' is no observer", remedy="name a type and a severity, e.g. deutan-1.0") from None
        check_simulation(observer.cvd, observer.severity, observer.model)
        return observer
