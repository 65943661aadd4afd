"""The parts of benchmark.py that measure something: a list for its command line, and for what their pages say."""

from __future__ import annotations

from . import everything
from .enhancers import comparison as enhancer
from .enhancers import drift
from .enhancers import frames as select
from .observers import command as observers
from .stress import command as stress
from .studies import ablation, budget, cost, figure, pareto, plain, race, table
from .timing import batch, card, files, step, throughput, trainer
from .timing import stills as display

_STUDIES = (everything, table, pareto, budget, ablation, figure, cost, stress)
_OTHERS = (race, plain, step, trainer, card, display, files, enhancer, drift, select, batch, throughput, observers)
MEASURING = tuple(module.PART for module in (*_STUDIES, *_OTHERS))
