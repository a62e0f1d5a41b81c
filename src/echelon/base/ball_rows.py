"""Rows of recorded forms in ball arithmetic, at values of the symbols and random exact states, free or closed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol

import flint
import numpy as np

from echelon.algebra import (
    BALL_BITS,
    DEFAULT_SEED,
    BallArithmetic,
    Op,
    Program,
    StagedSchedule,
    Surd,
    ball,
    count_of,
    generator_values,
    is_angle,
    parts_of,
    random_generator,
    stated_ball,
)
from echelon.base.ball_tables import Balls, exponent
from echelon.dynamics import LinearForms
from echelon.robot import named_symbols, shown_loops, symbol_roles
from echelon.shared import DegenerateSampleError, Floats, InputError

if TYPE_CHECKING:
    from echelon.loops import ClosedBalls, Loops

MOST_UNDEFINED = 0.5
"""Share of states at which entries may be undefined, as on a pole or beyond a domain that depends on symbols."""


_SPANNING = (Op.EXP, Op.TANH)
"""Functions whose values span more than those of their arguments."""
USUAL_EXPONENT = 48
"""Binary exponent of constants up to which values stay within the usual span, without exponentials."""
USUAL_SPAN_BITS = 128
"""Binary digits between the largest and the smallest value that the usual precision allows for."""
MOST_SPAN_WORK = 2e6
"""Binary digits of span times operations: beyond, a comparison takes more than a minute."""


def stated_generators(
    generators: Iterable[str], at: Mapping[str, str]
) -> dict[str, Any]:
    """Balls of symbols, and of sines and cosines of angles, at stated values."""
    return generator_values(
        generators,
        lambda name: stated_ball(at[name]),
        lambda x, n: ((n * x).cos(), (n * x).sin()),
    )


class BallStates(Protocol):
    """Where the states of forms come from, and what is known of their symbols.

    A state is a motion through a pose; with free states each pose has one.
    """

    @property
    def values(self) -> Mapping[str, str]:
        """Exact values of all symbols as text: the stated ones, and random ones where none are stated."""

    @property
    def symbols(self) -> list[str]:
        """Symbols that the rows depend on, sorted."""

    @property
    def angles(self) -> frozenset[str]:
        """Symbols that are angles, so that coefficients hold their sines and cosines."""

    @property
    def irrational(self) -> tuple[bool, bool]:
        """Whether √2 and √3 may occur in coefficients."""

    @property
    def motions(self) -> int:
        """Motions through one pose that show about as much as motions through several."""

    @property
    def regions(self) -> int:
        """Regions of signs that states visit in turn; 1 where none are known."""

    @property
    def singular(self) -> bool:
        """Whether the mechanism has more freedoms at the assembly pose than nearby."""

    @property
    def size(self) -> int:
        """Operations that one state takes."""

    @property
    def subject(self) -> str:
        """Noun phrase for the moving mechanism, for messages."""

    @property
    def span(self) -> int:
        """Bits by which the precision must grow with the span of values."""

    def known(
        self,
        at: Sequence[Mapping[str, str]],
        first: int,
        poses: int,
        rng: Any,
        motions: int,
    ) -> list[Balls]:
        """Entries at some of a sequence of states that is drawn once: one table for each of some values of symbols."""


def states_in(forms: LinearForms) -> BallStates:
    """The states of forms: closed ones with loops, else free ones."""
    return FreeBallStates(forms) if forms.loops is None else ClosedBallStates(forms)


class ClosedBallStates:
    """Closed states of a mechanism with loops."""

    regions, span = 1, 0

    def __init__(self, forms: LinearForms) -> None:
        assert forms.loops is not None
        self.forms = forms
        self.loops = forms.loops
        self.mechanism = forms.loops.mechanism
        self.values, self.motions = self.loops.values, self.loops.motions
        self.subject = shown_loops(self.mechanism)

    @property
    def symbols(self) -> list[str]:
        """Symbols that the rows or the closing of the loops depend on, sorted."""
        constants = (
            *self.forms.schedule.constants.leaves,
            *self.loops.closing.constants.leaves,
        )
        return sorted(
            {*_symbols(self.forms.program, constants)} & named_symbols(self.mechanism)
        )

    @property
    def angles(self) -> frozenset[str]:
        """Symbols that are angles."""
        return symbol_roles(self.mechanism).angles

    @property
    def irrational(self) -> tuple[bool, bool]:
        """Whether √2 and √3 occur in the geometry."""
        return symbol_roles(self.mechanism).irrational

    @property
    def singular(self) -> bool:
        """Whether the mechanism has more freedoms at the assembly pose than nearby."""
        return self.loops.singular

    @property
    def size(self) -> int:
        """Operations that one state takes."""
        return self.loops.closing.size + self.forms.schedule.size

    def known(
        self,
        at: Sequence[Mapping[str, str]],
        first: int,
        poses: int,
        rng: Any,
        motions: int,
    ) -> list[Balls]:
        """Entries at motions through known closed poses, or those next to them at other values of the symbols."""
        closed = _closed(self.loops, at, self.loops.known_poses(first, poses))
        table = _entries(
            self.forms,
            closed.leaves(self.forms.schedule, rng, motions),
            len(at) * poses * motions,
        )
        split = table.reshape(motions, len(at), poses, *self.forms.shape)
        return [
            _table(split[:, k].reshape(-1, *self.forms.shape)) for k in range(len(at))
        ]


class FreeBallStates:
    """States of forms without loops: at random values of the inputs, in all regions of signs."""

    motions, singular, subject = 1, False, "functions"

    def __init__(self, forms: LinearForms) -> None:
        self.forms, self.points = forms, forms.points

    @property
    def values(self) -> Mapping[str, str]:
        """Exact values of all symbols as text."""
        return self.points.values

    @property
    def regions(self) -> int:
        """Regions of signs."""
        return self.points.count

    @property
    def symbols(self) -> list[str]:
        """Symbols that the rows depend on, sorted."""
        return _symbols(self.points.program, self.points.rows.leaves)

    @property
    def angles(self) -> frozenset[str]:
        """Symbols that are added to angles, and occur in no other way."""
        program, nodes = self.points.program, self.points.outputs
        inputs = {
            n: program.inputs[n].name
            for n in self.points.rows.leaves
            if n in program.inputs
        }
        return frozenset(
            name for n, name in inputs.items() if is_angle(program, nodes, n)
        )

    @cached_property
    def span(self) -> int:
        """Bits by which the precision must grow with the span of values."""
        return bits_of_span(self.forms, {}, random_generator(DEFAULT_SEED))

    @property
    def irrational(self) -> tuple[bool, bool]:
        """Whether √2 and √3 occur, or other roots that may be such."""
        return irrational_roots(self.forms)

    @property
    def size(self) -> int:
        """Operations that one state takes."""
        return self.points.rows.size

    def known(
        self, at: Sequence[Mapping[str, str]], first: int, poses: int, _: Any, __: int
    ) -> list[Balls]:
        """Entries at known states, without those at which some have no value."""
        states = self.points.known(first, poses)
        table, count = _free_entries(self.forms, states, at), count_of(states)
        return [
            _with_values(table[k * count : (k + 1) * count]) for k in range(len(at))
        ]


def _closed(
    loops: Loops, at: Sequence[Mapping[str, str]], poses: Floats
) -> ClosedBalls:
    """Closed poses in ball arithmetic next to some in doubles, at some values of the symbols."""
    from echelon.loops import closed_states  # robots without loops do without it

    return closed_states(loops, at, poses)


def irrational_roots(forms: LinearForms) -> tuple[bool, bool]:
    """Whether √2 and √3 may occur in coefficients: they do in the rows, or other roots do."""
    program = forms.program
    needed = program.needed(forms.entries.values())
    if any(program.ops[n] == Op.SQRT for n in needed):
        return True, True
    constants = [program.constants.get(n) for n in needed]
    parts = [parts_of(c) for c in constants if isinstance(c, Surd)]
    return any(p[1] or p[3] for p in parts), any(p[2] or p[3] for p in parts)


def ball_rows(
    forms: LinearForms,
    at: Mapping[str, str],
    states: int,
    rng: np.random.Generator,
    motions: int = 1,
    *,
    at_rest: bool = False,
    poses: Floats | None = None,
) -> Balls:
    """Entries of forms at fresh random states, in all regions of signs.

    With loops these are some motions, perhaps from rest, through each of some random poses, or of the given ones in
    double precision.
    """
    if forms.loops is None:
        return _with_values(_free_entries(forms, forms.points.draw(rng, states), [at]))
    poses = forms.loops.poses(rng, -(-states // motions)) if poses is None else poses
    leaves = _closed(forms.loops, [at], poses).leaves(
        forms.schedule, rng, motions, at_rest=at_rest
    )
    return _table(_entries(forms, leaves, len(poses) * motions))


def bits_of_span(
    forms: LinearForms, at: Mapping[str, str], rng: np.random.Generator
) -> int:
    """Bits by which the precision must grow with the span of the values that occur on the way to the entries.

    With as many more, no term is lost beside another one, as e^-1000 would be beside 1, and what counts as zero, which
    is below the fourth root of the precision, is smaller than all of them.

    Raises
    ------
    InputError
        If values span so much that a comparison would take minutes.
    """
    program, outputs = forms.program, list(forms.entries.values())
    if forms.loops is None:
        program, outputs = forms.points.program, forms.points.outputs
    nodes = program.needed(outputs)
    constants = [
        ball(program.constants[n])
        for n in nodes
        if program.ops[n] == Op.CONSTANT and program.constants[n]
    ]
    usual = all(abs(exponent(x)) < USUAL_EXPONENT for x in constants)
    if usual and {program.ops[n] for n in nodes}.isdisjoint(_SPANNING):
        return 0
    with flint.ctx.workprec(BALL_BITS):
        if forms.loops is None:
            schedule = forms.points.schedule(nodes)
            drawn = forms.points.draw(rng, forms.points.count)
            leaves = forms.points.leaves(schedule.leaves, drawn, [at])
            states = count_of(drawn)
        else:
            staged, states = StagedSchedule(program, nodes), 1
            leaves = _closed(forms.loops, [at], forms.loops.poses(rng, 1)).leaves(
                staged, rng
            )
            schedule = staged.moving
        values = schedule.run(BallArithmetic(), leaves, states)
    exponents = [
        exponent(x.abs_lower())
        for x in values.flat
        if x.is_finite() and not x.contains(0)
    ]
    span = max(
        0, max(exponents, default=0) - min(exponents, default=0) - USUAL_SPAN_BITS
    )
    if span * len(nodes) > MOST_SPAN_WORK:
        raise InputError(
            f"values in the model span {span} binary digits, too many to compare them"
        )
    return 4 * span


def _symbols(program: Program, leaves: Iterable[int]) -> list[str]:
    used = [program.inputs[node] for node in {*leaves} & program.inputs.keys()]
    return sorted({given.name for given in used if given.role == "symbol"})


def _free_entries(
    forms: LinearForms, states: Mapping[int, Floats], at: Sequence[Mapping[str, str]]
) -> Balls:
    """All entries at free states, (at · states, rows, columns)."""
    points, count = forms.points, len(at) * count_of(states)
    schedule = points.rows
    return _placed(
        forms,
        schedule.run(
            BallArithmetic(), points.leaves(schedule.leaves, states, at), count
        ),
    )


def _entries(forms: LinearForms, leaves: Mapping[int, Balls], states: int) -> Balls:
    """All entries at some states, (states, rows, columns)."""
    return _placed(forms, forms.schedule.moving.run(BallArithmetic(), leaves, states))


def _placed(forms: LinearForms, values: Balls) -> Balls:
    """Values of the entries, (entries, states), at their places."""
    table = np.full((values.shape[1], *forms.shape), flint.arb(0), dtype=object)
    for (row, column), value in zip(forms.entries, values, strict=True):
        table[:, row, column] = value
    return table


def _with_values(table: Balls) -> Balls:
    """Rows of those states at which all entries have values.

    Raises
    ------
    DegenerateSampleError
        If these are few.
    """
    finite = np.array(
        [all(x.is_finite() for x in state.flat) for state in table], dtype=bool
    )
    if finite.sum() < (1 - MOST_UNDEFINED) * len(table):
        raise DegenerateSampleError("entries have no values at most real points")
    return _table(table[finite])


def _table(entries: Balls) -> Balls:
    """Rows of all states, divided by powers of two so that their largest entries are alike at all speeds."""
    states, rows, columns = entries.shape
    table = entries.reshape(states * rows, columns)
    for row in table:
        largest = max((x.abs_lower() for x in row), default=flint.arb(0))
        if largest > 0:
            row /= flint.arb(2) ** exponent(largest)
    return table
