"""Which assembly mode the mechanism's own pose is in: relations must hold in real states near it.

Doubles tell where it is clear.  Where it is not, since the pose is nearly singular or modes nearly meet there, closed
states in ball arithmetic do: there the relations of a mode hold to a hundred digits, or they do not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import flint
import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.base.ball_rows import ball_rows
from echelon.base.ball_tables import combinations_of, vanishes
from echelon.base.modes import Mode
from echelon.errors import InputError
from echelon.exact.field import DEFAULT_SEED, random_generator
from echelon.mechanism.mechanism import Mechanism
from echelon.mechanism.stated import all_symbols, known_values, value_texts
from echelon.regressor.evaluate import evaluate_floats
from echelon.regressor.linear_forms import Rows, virtual_power_form
from echelon.regressor.loops.assembly import Assembly
from echelon.regressor.loops.recorded_loops import state_inputs

_STATES, _NEAR = 20, 0.2
_SMALLEST = 1e-4  # of columns, about the largest one: rounding keeps those that vanish far below
_HOLDS, _FAILS = 1e-8, 1e-4  # what relations miss by in doubles where they surely hold, and where they surely do not
_INDEPENDENT = 1e-7  # smallest singular value of columns that surely are
# of singular values: what counts as nothing, and how far they fall to it; of about a hundred mechanisms, none falls by
# more than 2000 within its rank
_NOISE, _CLEAR_FALL = 1e-14, 1e6
_SAME_MARK = 1e-3  # coefficients that are simple rational numbers lie farther apart
# precisions of balls until one tells: rounded geometry leaves true coefficients as small as the square of its
# rounding, and states near one pose of many loops in series are hardly independent
BITS = (640, 1280, 2560)
_SURPLUS = 1.3  # of states that share poses


class OwnPose:
    """Real states near the pose at which a mechanism is stated to close, in the columns that modes were found with.

    ``moved`` says that modes were found with frames moved by rounding, which gives relations coefficients of that size.
    """

    def __init__(self, mechanism: Mechanism, rows: Rows, columns: Sequence[int], moved: bool = False) -> None:
        self.mechanism, self._rows, self._columns, self._moved = mechanism, rows, list(columns), moved
        self._tables = dict[tuple[int, int, int], npt.NDArray[Any] | None]()  # rows in balls, as they were asked for

    def mode(self, modes: Sequence[Mode]) -> Mode | None:
        """The one of some modes that the pose is in; None if it is in none of them, as far as can be told."""
        if self._moved:  # which may have broken what is special
            modes = [mode for mode in modes if not self.shows_less(len(self._columns) - len(mode.dependence))]
        verdicts = [self._clear(mode) for mode in modes]
        if verdicts.count(True) == 1 and None not in verdicts:
            return modes[verdicts.index(True)]
        if self._moved:  # rounding of frames may change which columns are representatives, but not how many
            possible = (m for m, verdict in zip(modes, verdicts, strict=True) if verdict is not False)
            alike = [m for m in possible if self._shows(len(self._columns) - len(m.dependence))]
            if len(alike) == 1:
                return alike[0]
        return next((m for m, v in zip(modes, verdicts, strict=True) if v is not False and self._holds(m)), None)

    def likely(self, modes: Sequence[Mode]) -> Mode | None:
        """The first of some modes whose relations hold there, perhaps beside others."""
        return next((mode for mode in modes if self._clear(mode) is not False), None)

    @property
    def is_singular(self) -> bool:
        """Whether more motions are possible at the pose itself than near it, so that modes may meet there."""
        at_pose, near = (self._assembly.mobility(q) for q in (self._assembly.pose[None], self._real[0]))
        return bool(at_pose[0] > near.min())

    @property
    def free_velocities(self) -> Floats:
        """Orthonormal velocities that keep the loops closed in a state near the pose, (velocities, freedoms)."""
        return self._assembly.free_velocities(self._real[0][0])

    def shows_less(self, rank: int) -> bool:
        """Whether doubles clearly show a lower rank, as where rounding has broken what is special about a geometry."""
        falls = self._falls[:rank]
        return bool(falls.max() > _CLEAR_FALL and falls.argmax() + 1 < rank)

    def _shows(self, rank: int) -> bool:
        """Whether doubles clearly show a rank."""
        return bool(self._falls.max() > _CLEAR_FALL and self._falls.argmax() + 1 == rank)

    @cached_property
    def _falls(self) -> Floats:
        """How far each singular value falls to the next one."""
        singular = np.linalg.svd(self._table[0], compute_uv=False)
        return np.asarray(singular / np.maximum(np.append(singular[1:], 0.0), _NOISE * singular[0]))

    # -- doubles ---------------------------------------------------------------------------------------------------

    @cached_property
    def _real(self) -> tuple[Floats, Floats, Floats]:
        """Closed states near the pose: farther away a walk could pass to another mode."""
        states = _STATES + len(self._columns) // max(1, len(self.mechanism.outputs))
        return self._assembly.determined_states(random_generator(DEFAULT_SEED), states, _NEAR)

    @cached_property
    def _assembly(self) -> Assembly:
        loops = self._rows.forms.loops
        return Assembly(self.mechanism, equations=loops.equations if loops else None)

    @cached_property
    def _table(self) -> tuple[Floats, Floats]:
        """Rows with columns of size one, and the sizes."""
        energies, rng = self._rows.auxiliary, random_generator(DEFAULT_SEED)  # which would cost digits
        forms = virtual_power_form(self.mechanism).columns(self._columns) if energies else self._rows.forms
        names = [given.name for given in forms.program.inputs.values() if given.name.startswith("i[")]
        inputs = {name[2:-1]: rng.uniform(-1.0, 1.0, len(self._real[0])) for name in names}
        values = evaluate_floats(forms, self.mechanism, *self._real, inputs=inputs, assembly=self._assembly)
        table = values.reshape(-1, values.shape[2])
        # columns that vanish but for rounding stay small
        sizes = np.maximum(np.abs(table).max(axis=0), _SMALLEST * np.abs(table).max())
        return table / sizes, sizes

    def _clear(self, mode: Mode) -> bool | None:
        """Whether a mode surely holds; None if doubles do not tell."""
        table, sizes = self._table
        pivots, others = _split(mode, table.shape[1])
        orthogonal, triangle = np.linalg.qr(table[:, pivots])
        if np.linalg.svd(triangle, compute_uv=False).min(initial=1.0) < _INDEPENDENT:
            return None
        solution = np.linalg.solve(triangle, orthogonal.T @ table[:, others])
        missed = np.abs(table[:, others] - table[:, pivots] @ solution).max(initial=0.0)
        if missed > _HOLDS:
            return False if missed > _FAILS else None
        scaled = solution * sizes[others] / sizes[pivots][:, None]
        return all(
            _same(scaled[pivots.index(source), others.index(column)], float(mark))
            for (column, source), mark in (mode.marks or {}).items()
        )

    # -- balls -----------------------------------------------------------------------------------------------------

    def balls(self, wanted: int, bits: int, motions: int) -> npt.NDArray[Any] | None:
        """So many rows in ball arithmetic, and some more, of some motions at each pose; auxiliary columns first.

        None if the loops are not proved to close; redundant constraints that miss by rounding are not.
        """
        forms = self._rows.forms
        assert forms.loops is not None
        rows = self._rows.auxiliary + wanted + _STATES
        states = int(_SURPLUS * -(-rows // forms.shape[0])) + 2 * motions
        if (states, bits, motions) not in self._tables:
            near = replace(forms, loops=replace(forms.loops, real=self._inputs))
            texts = value_texts(self.mechanism, all_symbols(self.mechanism))
            try:
                with flint.ctx.workprec(bits):
                    found = ball_rows(near, texts, states, random_generator(DEFAULT_SEED), motions)
            except InputError:
                found = None
            self._tables[states, bits, motions] = found
        return self._tables[states, bits, motions]

    def _inputs(self, rng: np.random.Generator, count: int) -> dict[str, Floats]:
        """Inputs of closed states near the pose, those of the rows in doubles where these are enough."""
        known = len(self._real[0]) >= count
        states = self._real if known else self._assembly.random_closed_states(rng, count, _NEAR)
        values = {name: np.full(count, value) for name, value in known_values(self.mechanism).items()}
        return values | state_inputs(self.mechanism, *(x[:count] for x in states))

    def _holds(self, mode: Mode) -> bool:
        """Whether the representatives of a mode are independent there, and its relations and no others hold."""
        rank = len(self._columns) - len(mode.dependence)
        # with few more rows than the rank, relations are not told from rounding; as many as there are columns always do
        enough = len(self._columns)
        # several motions at a pose show as much as several poses, unless much changes along few ways
        several = max(2, len(self.mechanism.independent_velocities))
        trials = [(min(2 * rank, enough), BITS[0], several), (enough, BITS[0], several), (enough, BITS[0], 1)]
        for wanted, bits, motions in (*trials, *((enough, bits, several) for bits in BITS[1:])):
            table = self.balls(wanted, bits, motions)
            if table is None:  # there is no exact pose of the stated frames
                return self._moved
            with flint.ctx.workprec(bits):
                verdict = self._holds_in_balls(mode, table, bits)
            if verdict is not None:
                return verdict
        return False

    def _holds_in_balls(self, mode: Mode, table: npt.NDArray[Any], bits: int) -> bool | None:
        """The same to some precision; None if it does not tell."""
        auxiliary = self._rows.auxiliary
        pivots, others = _split(mode, len(self._columns))
        kept = [*range(auxiliary), *(auxiliary + k for k in pivots)]
        found = combinations_of(table, kept, [auxiliary + k for k in others])
        if found is None:
            return None
        solution, missed = found
        zero = [vanishes(x, bits) for x in missed.flat]
        if not all(zero):
            return None if False not in zero else False
        for k, column in enumerate(others):
            vanish = {pivots[i - auxiliary]: vanishes(solution[i, k], bits) for i in range(auxiliary, len(kept))}
            if None in vanish.values():
                return None
            if not self._moved and {p for p, zero in vanish.items() if not zero} != set(mode.dependence[column]):
                return False
        return all(
            _same(float(solution[auxiliary + pivots.index(source), others.index(column)].mid()), float(mark))
            for (column, source), mark in (mode.marks or {}).items()
        )


def _split(mode: Mode, columns: int) -> tuple[list[int], list[int]]:
    """The columns that are representatives in a mode, and the others."""
    return [k for k in range(columns) if k not in mode.dependence], list(mode.dependence)


def _same(value: float, mark: float) -> bool:
    return abs(value - mark) < _SAME_MARK * max(1.0, abs(mark))
