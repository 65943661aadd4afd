"""For whom a batch simulates what is seen, by the name of the layer that is made for them."""

from __future__ import annotations

from dataclasses import dataclass

from ...core.color.matrices import check_simulation
from ...core.errors import InputError
from ...core.settings import Layer


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
        try:
            layer = Layer.from_name(name)
        except ValueError:
            raise InputError(f"'{name}' is no observer", remedy="name a type and a severity, e.g. deutan-1.0") from None
        model = "brettel" if (layer.cvd, model) == ("tritan", "vienot") else model
        check_simulation(layer.cvd, layer.severity, model)
        return cls(layer.cvd, layer.severity, model)
