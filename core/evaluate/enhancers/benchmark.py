"""The comparison of enhancers as a command runs it: from options to image sets, tables, chart and sheets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path

from ...enhance.data.plates import SMALLEST_PLATE
from ...errors import InputError
from ...events import Reporter
from ...settings import Layer
from .contact_sheet import write_contact_sheet
from .image_sets import PLATE_TYPES, ImageSet, fresh_plates, fresh_textiles, read_photographs
from .methods import GAIN, LUT, NONE, check_labels, is_network, method_label
from .report import write_comparison
from .scores import ENHANCED_FOR
from .table import ComparisonPlan, compare_enhancers
from .tradeoff_chart import write_chart


@dataclass(frozen=True)
class EnhancerBenchmark:
    """What the command compares.

    Attributes:
        methods: names or weight files.
        photographs: name and folder of each set.
        types, severities: of the observers, every combination.
        size: longer side of the images in pixels.
        plates: for each type.
        textiles: in all.
        most_photographs: of a set; None for all.
        other_models: whether Viénot and Brettel judge too.
        trade_off: whether the trade-off is measured and drawn.
        processes: how many share the work.
    """

    methods: tuple[str, ...]
    photographs: dict[str, Path] = field(default_factory=dict)
    types: tuple[str, ...] = PLATE_TYPES
    severities: tuple[float, ...] = (0.4, 0.7, 1.0)
    size: int = 384
    plates: int = 40
    textiles: int = 20
    most_photographs: int | None = None
    other_models: bool = True
    trade_off: bool = True
    processes: int = 1

    def run(self, folder: Path, reporter: Reporter | None = None) -> str:
        """Measure and write everything into `folder`; returns the text of ``enhancer.md``.

        Raises:
            InputError: a method, a type or a folder that cannot be used.
        """
        if not self.methods:
            raise InputError("no enhancer is named", where="--enhancers", remedy="name some, e.g. none,gain,lut")
        check_labels(self.methods)
        if self.size < SMALLEST_PLATE:
            remedy = f"give at least {SMALLEST_PLATE}"
            raise InputError(f"images of {self.size} pixels are too small", where="--size", remedy=remedy)
        image_sets = self._image_sets()
        observers = tuple(Layer(cvd, severity) for severity, cvd in product(self.severities, self.types))
        plan = ComparisonPlan(self.methods, observers, self.other_models, self.trade_off)
        comparison = compare_enhancers(image_sets, plan, reporter, self.processes)
        text = write_comparison(folder, comparison, image_sets, self._candidate(), self._describe(image_sets))
        points = [point for point in comparison.trade_offs if point.image_set in self.photographs]
        if points:
            write_chart(folder, "enhancer", points, "CCPR of hard photographs against change")
        for name, observer in dict.fromkeys((shown.image_set, shown.observer) for shown in comparison.shown):
            images = [x.versions for x in comparison.shown if (x.image_set, x.observer) == (name, observer)]
            write_contact_sheet(folder / f"sheet-{name}-{observer.name}.png", images, observer, ENHANCED_FOR)
        return text

    def _image_sets(self) -> list[ImageSet]:
        sets = [
            read_photographs(name, folder, self.size, self.most_photographs)
            for name, folder in self.photographs.items()
        ]
        sets += [fresh_plates(self.plates, self.size, self.types)] if self.plates else []
        sets += [fresh_textiles(self.textiles, self.size)] if self.textiles else []
        if not sets:
            raise InputError("there are no images to compare on", where="--images", remedy="give NAME=FOLDER")
        return sets

    def _candidate(self) -> str:
        """The method of the headline: the first network, else the LUT, else the last of all."""
        compared = [name for name in self.methods if name not in (NONE, GAIN)] or [NONE]
        ranked = [name for name in compared if is_network(name)] + [name for name in compared if name == LUT]
        return method_label((ranked or compared[-1:])[0])

    def _describe(self, image_sets: Sequence[ImageSet]) -> str:
        counts = ", ".join(f"{image_set.name} ({len(image_set.images)})" for image_set in image_sets)
        return f"Images of at most {self.size} pixels: {counts}. Each method was fitted to each image alone."
