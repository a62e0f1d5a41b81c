"""Witnesses: changes of the standard parameters that a claimed set and the outputs disagree about.

A column f that is no pivot gives the change e_f − Σ B[p, f] e_p, which no output sees in any state; a claimed row
with a wrong coefficient at f sees it.  A change of the pivots alone that all claimed rows overlook shows what is
missing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from echelon.arrays import Floats
from echelon.base.matrix import BaseMatrix
from echelon.base.model import BaseModel
from echelon.claims.compare import Geometry, Row
from echelon.claims.result import Witness
from echelon.exact.rational import RationalFunction
from echelon.mechanism.joint import MotionKind
from echelon.regressor.loops.assembly import Assembly

_STATES = 16
_ZERO = RationalFunction(0)
_NEGLIGIBLE = 1e-12


@dataclass(frozen=True)
class WitnessSearch:
    """Where changes of parameters are tried out in numbers."""

    model: BaseModel
    matrix: BaseMatrix  # B with the representatives that the claims lead with
    rows: tuple[Row, ...]  # the claimed set
    geometry: Geometry
    seed: int  # of the example states, and of values for symbols that have none

    def unseen_by_outputs(self, column: int) -> Witness:
        """A unit of a parameter that is no pivot, with what compensates it in all outputs."""
        change = np.zeros(len(self.matrix.parameters))
        change[column] = 1.0
        change[list(self.matrix.pivots)] = -self.b[:, column]
        return self._witness(change)

    def unseen_by_claims(self, missing: int) -> Witness:
        """A unit of a pivot, with what hides it from all claimed rows."""
        pivots = list(self.matrix.pivots)
        others = [k for k in range(len(pivots)) if k != missing]
        at_pivots = self.claimed[:, pivots]
        hidden = np.linalg.lstsq(at_pivots[:, others], -at_pivots[:, missing], rcond=None)[0]
        change = np.zeros(len(self.matrix.parameters))
        change[pivots[missing]] = 1.0
        change[[pivots[k] for k in others]] = hidden
        return self._witness(change)

    @cached_property
    def assumed(self) -> dict[str, float]:
        """Values for symbols without one."""
        model = self.model.mechanism
        used = {*model.symbols, *self.matrix.symbols, *(s for r in self.rows for c in r.values() for s in c.symbols())}
        used |= {s for body in model.bodies for s in body.joint.symbols()}
        used |= {s for part in model.gravity or () for s in part.symbols()}
        rng = np.random.default_rng(self.seed)
        return {name: round(rng.uniform(0.2, 0.8), 2) for name in sorted(used) if name not in self.geometry.floats}

    @cached_property
    def b(self) -> Floats:
        """B in floats, shape (r, n)."""
        return self.matrix.floats({**self.geometry.floats, **self.assumed})

    @cached_property
    def claimed(self) -> Floats:
        """The claimed coefficients in floats, shape (claims, n)."""
        geometry = replace(self.geometry, floats={**self.geometry.floats, **self.assumed})
        values = np.zeros((len(self.rows), len(self.matrix.parameters)))
        for i, row in enumerate(self.rows):
            for column, coefficient in row.items():
                values[i, column] = geometry.roughly(coefficient)
        return values

    @cached_property
    def states(self) -> tuple[Floats, Floats, Floats]:
        """Example states q, qd, qdd, one per row."""
        return random_states(self.model, np.random.default_rng(self.seed), self.assumed)

    @cached_property
    def regressor(self) -> Floats:
        """X at the example states, shape (states, outputs, n)."""
        return self.model.standard_regressor(*self.states, symbols=self.assumed, inputs=self.measured)

    @cached_property
    def measured(self) -> dict[str, Floats]:
        """Example values of measured inputs, such as currents, by name."""
        rng = np.random.default_rng(self.seed + 1)
        names = sorted(i.name[2:-1] for i in self.model.standard_forms.program.inputs.values() if i.name[:2] == "i[")
        return {name: rng.uniform(-2.0, 2.0, _STATES).round(2) for name in names}

    def _witness(self, change: Floats) -> Witness:
        change = np.where(np.abs(change) > _NEGLIGIBLE, change, 0.0)
        outputs = self.regressor @ change
        loudest = int(np.abs(outputs).sum(axis=1).argmax())
        scale = np.abs(self.regressor).max(initial=1.0)
        felt = self.claimed @ change
        q, qd, qdd = (tuple(float(v) for v in part[loudest]) for part in self.states)
        return Witness(
            _named(self.matrix.parameters, change),
            {i + 1: float(v) for i, v in enumerate(felt) if abs(v) > _NEGLIGIBLE},
            {"q": q, "qd": qd, "qdd": qdd, **{f"i[{k}]": (float(v[loudest]),) for k, v in self.measured.items()}},
            {
                output.name: float(v) if abs(v) > _NEGLIGIBLE * scale else 0.0
                for output, v in zip(self.model.mechanism.outputs, outputs[loudest], strict=True)
            },
            self.assumed,
        )


def _named(names: Sequence[str], values: Floats) -> Mapping[str, float]:
    return {name: float(v) for name, v in zip(names, values, strict=True) if v}


def random_states(
    model: BaseModel, rng: np.random.Generator, symbols: Mapping[str, float] | None = None
) -> tuple[Floats, Floats, Floats]:
    """Random states with two decimals; quaternions have unit length, and loops are closed."""
    mechanism = model.mechanism
    if mechanism.closures:
        return Assembly(mechanism, symbols).random_closed_states(rng, _STATES)
    q = rng.uniform(-2.0, 2.0, (_STATES, len(mechanism.positions))).round(2)
    for motion in mechanism.motions:
        if motion.kind is MotionKind.BALL:
            first = mechanism.positions.index(motion.positions[0])
            q[:, first : first + 4] /= np.linalg.norm(q[:, first : first + 4], axis=1, keepdims=True)
    rates = rng.uniform(-2.0, 2.0, (2, _STATES, len(mechanism.velocities))).round(2)
    return q, rates[0], rates[1]
