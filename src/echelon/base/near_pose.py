"""Real states near the pose at which a mechanism is stated to close: rows there, in doubles and in balls."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property, partial

import flint
import numpy as np

from echelon.arrays import Floats
from echelon.base.ball_rows import Balls, ball_rows
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
# of singular values: what counts as nothing, and how far they fall to it; of about a hundred mechanisms, none falls by
# more than 2000 within its rank
_NOISE, _CLEAR_FALL = 1e-14, 1e6
# precisions of balls until one tells: rounded geometry leaves true coefficients as small as the square of its
# rounding, and states near one pose of many loops in series are hardly independent
BITS = (640, 1280, 2560)
_SURPLUS = 1.3  # of states that share poses
_OTHERS = 10  # poses at which relations are checked


class NearPose:
    """Rows at states near the pose, for some of the parameters; ``reach`` says how near, see Assembly."""

    def __init__(self, mechanism: Mechanism, rows: Rows, columns: Sequence[int], reach: float = _NEAR) -> None:
        self.mechanism, self.rows, self.columns, self._reach = mechanism, rows, list(columns), reach
        self._tables = dict[tuple[int, int, int, int], Balls | None]()  # rows in balls, as they were asked for

    @cached_property
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

    @cached_property
    def _falls(self) -> Floats:
        """How far each singular value falls to the next one."""
        singular = np.linalg.svd(self.table[0], compute_uv=False)
        return np.asarray(singular / np.maximum(np.append(singular[1:], 0.0), _NOISE * singular[0]))

    @cached_property
    def _real(self) -> tuple[Floats, Floats, Floats]:
        """Closed states near the pose: farther away a walk could pass to another mode."""
        states = _STATES + len(self.columns) // max(1, len(self.mechanism.outputs))
        return self._assembly.determined_states(random_generator(DEFAULT_SEED), states, self._reach)

    @cached_property
    def _assembly(self) -> Assembly:
        loops = self.rows.forms.loops
        return Assembly(self.mechanism, equations=loops.equations if loops else None)

    @cached_property
    def table(self) -> tuple[Floats, Floats]:
        """Rows with columns of size one, and the sizes."""
        energies, rng = self.rows.auxiliary, random_generator(DEFAULT_SEED)  # which would cost digits
        forms = virtual_power_form(self.mechanism).columns(self.columns) if energies else self.rows.forms
        names = [given.name for given in forms.program.inputs.values() if given.name.startswith("i[")]
        inputs = {name[2:-1]: rng.uniform(-1.0, 1.0, len(self._real[0])) for name in names}
        values = evaluate_floats(forms, self.mechanism, *self._real, inputs=inputs, assembly=self._assembly)
        table = values.reshape(-1, values.shape[2])
        # columns that vanish but for rounding stay small
        sizes = np.maximum(np.abs(table).max(axis=0), _SMALLEST * np.abs(table).max())
        return table / sizes, sizes

    def balls(self, wanted: int, bits: int, motions: int) -> Balls | None:
        """So many rows in ball arithmetic, and some more, of some motions at each pose; auxiliary columns first.

        None if the loops are not proved to close.
        """
        rows = self.rows.auxiliary + wanted + _STATES
        states = int(_SURPLUS * -(-rows // self.rows.forms.shape[0])) + 2 * motions
        return self._balls(states, bits, motions, DEFAULT_SEED)

    def other_balls(self, bits: int) -> Balls | None:
        """The same at a few other poses."""
        return self._balls(_OTHERS, bits, 1, DEFAULT_SEED + 1)

    def _balls(self, states: int, bits: int, motions: int, seed: int) -> Balls | None:
        key, forms = (states, bits, motions, seed), self.rows.forms
        assert forms.loops is not None
        if key not in self._tables:
            known = seed == DEFAULT_SEED  # as those of the rows in doubles
            near = replace(forms, loops=replace(forms.loops, real=partial(self._inputs, known)))
            texts = value_texts(self.mechanism, all_symbols(self.mechanism))
            try:
                with flint.ctx.workprec(bits):
                    found = ball_rows(near, texts, states, random_generator(seed), motions)
            except InputError:
                found = None
            self._tables[key] = found
        return self._tables[key]

    def _inputs(self, known: bool, rng: np.random.Generator, count: int) -> dict[str, Floats]:
        """Inputs of closed states near the pose, of known ones where these are enough."""
        known = known and len(self._real[0]) >= count
        states = self._real if known else self._assembly.random_closed_states(rng, count, self._reach)
        values = {name: np.full(count, value) for name, value in known_values(self.mechanism).items()}
        return values | state_inputs(self.mechanism, *(x[:count] for x in states))
