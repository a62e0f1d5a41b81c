"""Random real points: which signs can occur together, and where logarithms and roots are real.

A sign is constant on a region of the real inputs, and not every combination of signs is a region: sign(x), sign(y) and
sign(x + y) have six of eight.  So signs are taken from random real points of the domain.  Floating point decides
nothing but on which side of a surface a random point lies.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from echelon.errors import InputError
from echelon.program.operations import Op
from echelon.program.schedule import FloatArithmetic, Schedule
from echelon.program.tape import Program

Floats = npt.NDArray[np.float64]

_ROUNDS = 200
_PATIENCE = 8
_SPREAD = 1.5
_CANDIDATES = 8


class RealPoints:
    """Random real points where a program's outputs are real.

    Parameters
    ----------
    program : Program
    outputs : sequence of int
    """

    def __init__(self, program: Program, outputs: Sequence[int]) -> None:
        ops, lhs = program.ops, program.lhs
        needed = program.needed(outputs)
        self.program = program
        self._inputs = [n for n in needed if ops[n] == Op.INPUT]
        self._positive = {lhs[n] for n in needed if ops[n] in (Op.LOG, Op.SQRT)}
        signs = {lhs[n] for n in needed if ops[n] == Op.SIGN}
        self._nonzero = self._positive | signs
        self.watched = sorted(self._nonzero | set(self._inputs))
        self._sign_rows = [row for row, node in enumerate(self.watched) if node in signs]
        self._schedule = Schedule(program, self.watched)

    def draw(self, rng: np.random.Generator, samples: int) -> dict[int, Floats]:
        """Values of the inputs and of the arguments of signs, logarithms and roots.

        Constants of the model are positive and the same at all samples.  Regions take turns, so that small ones are not
        missed.

        Returns
        -------
        dict of int to array of shape (samples,)

        Raises
        ------
        InputError
            If no real point is found.
        """
        found: list[Floats] = []
        count, constants = 0, self._constants(rng)
        for attempt in range(_ROUNDS):
            table = self._try(rng, max(64, _CANDIDATES * samples), constants)
            found.append(table)
            count += table.shape[1]
            if count >= samples:
                chosen = self._by_turns(np.concatenate(found, axis=1), samples)
                return dict(zip(self.watched, chosen, strict=True))
            if not count and attempt % _PATIENCE == _PATIENCE - 1:
                constants = self._constants(rng)
        raise InputError("no real point was found at which all logarithms and square roots of the model are real")

    def _by_turns(self, table: Floats, samples: int) -> Floats:
        """So many points, from every region in turn."""
        if not self._sign_rows:
            return table[:, :samples]
        _, region = np.unique(table[self._sign_rows] > 0, axis=1, return_inverse=True)
        region = region.reshape(-1)
        by_region = np.argsort(region, kind="stable")
        starts = np.searchsorted(region[by_region], np.arange(region.max() + 1))
        turn = np.empty(len(region), dtype=np.intp)
        turn[by_region] = np.arange(len(region)) - starts[region[by_region]]
        return table[:, np.argsort(turn, kind="stable")[:samples]]

    def _constants(self, rng: np.random.Generator) -> Mapping[int, float]:
        symbols = [n for n in self._inputs if self.program.inputs[n].role == "symbol"]
        return {n: float(np.exp(_SPREAD * rng.standard_normal())) for n in symbols}

    def _try(self, rng: np.random.Generator, samples: int, constants: Mapping[int, float]) -> Floats:
        """Those of some random points that lie in the domain: array of shape (watched, points)."""
        values = {}
        for node in self._inputs:
            magnitude = np.exp(_SPREAD * rng.standard_normal(samples))
            random = magnitude * rng.choice([-1.0, 1.0], samples)
            values[node] = np.full(samples, constants[node]) if node in constants else random
        with np.errstate(all="ignore"):
            table = self._schedule.run(FloatArithmetic(), values, samples)
        good = np.isfinite(table).all(axis=0)
        for row, node in enumerate(self.watched):
            if node in self._positive:
                good &= table[row] > 0
            elif node in self._nonzero:
                good &= table[row] != 0
        return np.asarray(table[:, good], dtype=np.float64)
