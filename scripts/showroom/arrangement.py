"""Which fabric hangs, lies and is rolled up where, in each showroom. Standard library only."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Arrangement:
    """Fabric names (see `collection.Fabrics`) by place, from left to right as the cameras see it, piles from below.

    Attributes:
        drapes: the two opaque cloths on the rail.
        cushions: (fabric, piping) of the three that lean on the block and the small one before them.
        piles: the two piles of folded cloths on the block.
        rolls: three rolls on the floor, two on them, one on top.
        throw: over the plinth's front.
        cube: over the cube.
    """

    drapes: tuple[str, str] = ("tartan", "stripe")
    cushions: tuple[tuple[str, str], ...] = (
        ("jacquard", "cream"),
        ("green", "orange"),
        ("stripe", "cream"),
        ("tartan", "green"),
    )
    piles: tuple[tuple[str, ...], tuple[str, ...]] = (
        ("pink", "herringbone", "cream", "tartan"),
        ("stripe", "green", "basket"),
    )
    rolls: tuple[str, ...] = ("green", "tartan", "pink", "orange", "blue", "herringbone")
    throw: str = "basket"
    cube: str = "herringbone"


ARRANGEMENTS = {
    "deutan": Arrangement(),
    "protan": Arrangement(
        drapes=("stripe", "jacquard"),
        cushions=(("tartan", "cream"), ("orange", "green"), ("herringbone", "cream"), ("basket", "orange")),
        piles=(("blue", "stripe", "tartan"), ("green", "cream", "jacquard", "pink")),
        rolls=("orange", "stripe", "blue", "pink", "green", "tartan"),
        throw="herringbone",
        cube="tartan",
    ),
    "tritan": Arrangement(
        drapes=("jacquard", "tartan"),
        cushions=(("stripe", "cream"), ("pink", "blue"), ("tartan", "cream"), ("herringbone", "pink")),
        piles=(("green", "tartan", "orange", "cream"), ("jacquard", "blue", "stripe")),
        rolls=("blue", "herringbone", "green", "pink", "stripe", "orange"),
        throw="tartan",
        cube="basket",
    ),
}
"""The arrangement of each of `settings.VARIANTS`."""
