"""Regions of signs on closed configurations.

Closed states cannot be moved at will, but a motion can be run at any speed: q̇ times s and q̈ times s² keep loops
closed. So random closed states, each at speeds of all orders of magnitude, show which signs occur together, however
narrow a dead zone of a speed is.  Of these regions those are kept that add something
(:mod:`echelon.program.region_search`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.program.region import SAMPLED, RegionReport, one_sided
from echelon.program.region_search import COMPLETE, IndependentRegions
from echelon.program.schedule import FloatArithmetic, Schedule
from echelon.program.surfaces import find_surfaces, monomials
from echelon.program.tape import Program

REAL_STATES = 256
_SPEEDS = 10 ** np.linspace(-6, 6, 25)
_MOST_PRODUCTS, _MOST_REGIONS = 512, 64


def closed_regions(
    program: Program, outputs: Sequence[int], signs: Sequence[int], states: Mapping[str, Floats]
) -> tuple[npt.NDArray[np.int64], RegionReport]:
    """Signs that occur together."""
    arguments = [program.lhs[node] for node in signs]
    schedule = Schedule(program, arguments)
    inputs = {node: _at_all_speeds(program.inputs[node].name, states) for node in schedule.leaves}
    count = len(next(iter(states.values()))) * len(_SPEEDS)
    table = np.sign(schedule.run(FloatArithmetic(), inputs, count)).astype(np.int8)
    found = np.unique(table[:, (table != 0).all(axis=0)], axis=1)
    row = {node: k for k, node in enumerate(arguments)}
    surfaces = find_surfaces(program, outputs)
    products = monomials(surfaces, {n: 0 for n in surfaces.nodes if n not in row}, _MOST_PRODUCTS)
    rows = None if products is None else [tuple((row[n], e) for n, e in p) for p in products]
    independent = IndependentRegions(rows)
    kept = independent.include(found, lambda _: True)[:_MOST_REGIONS]
    ended = COMPLETE if independent.complete and len(kept) == independent.rank else SAMPLED
    seen = [(node, set(found[k].tolist())) for k, node in enumerate(arguments)]
    remarks = tuple(one_sided(program, node, side.pop()) for node, side in seen if len(side) == 1)
    return found[:, kept].T.astype(np.int64), RegionReport(len(kept), ended, remarks)


def _at_all_speeds(name: str, states: Mapping[str, Floats]) -> Floats:
    power = {"qd": 1, "qdd": 2}.get(name.partition("[")[0], 0)
    scaled: Floats = (states[name][:, None] * _SPEEDS**power).ravel()
    return scaled
