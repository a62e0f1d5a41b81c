"""Mechanisms with loops: whether they close, how they can move, and which coordinates the others depend on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from echelon.errors import DegenerateSampleError, InputError, ShakyPoseError, SingularPoseError
from echelon.exact.field import PrimeField, Residues
from echelon.exact.zero_dimensional import UnsolvedSystemError
from echelon.mechanism.mechanism import Mechanism
from echelon.mechanism.ratios import with_numeric_ratios
from echelon.program.tape import Program
from echelon.regressor.loops.assembled import Assembled
from echelon.regressor.loops.assembly import Assembly
from echelon.regressor.loops.coordinates import independent_coordinates
from echelon.regressor.loops.curves import CurveSampler
from echelon.regressor.loops.recorded_loops import loops_of
from echelon.regressor.steps import Recorder
from echelon.seeds import DEFAULT_SEED, random_generator

_ATTEMPTS = 2
_STANDS_STILL = 1e-3  # rad or m
_EXACTLY = (
    "Write what is meant exactly: directions and angles as expressions such as pi/3 or sqrt(2)/2, equal lengths as "
    "equal numbers"
)
_STATES = 8  # random configurations at which the mobility is counted numerically


def close(mechanism: Mechanism, wanted: Sequence[str] | None = None, *, prefer: Sequence[str] = ()) -> Mechanism:
    """A mechanism with loops, its independent coordinates chosen.

    Parameters
    ----------
    mechanism : Mechanism
        With closures.
    wanted : sequence of str, optional
        The coordinates that are to be independent, as many as there are degrees of freedom.
    prefer : sequence of str
        Otherwise, coordinates that should be, such as those with drives; the others are chosen as
        :func:`~echelon.regressor.loops.coordinates.independent_coordinates` says.

    Returns
    -------
    Mechanism

    Raises
    ------
    InputError
        If the loops cannot close or cannot move, or the wanted coordinates are too many, too few, or depend on one
        another.
    """
    if not mechanism.closures:
        if wanted:
            raise InputError("without loops all coordinates are independent; leave it out", element="independent")
        return mechanism
    mechanism = with_numeric_ratios(mechanism)
    names = list(mechanism.velocities)
    for name in wanted or ():
        if name not in names:
            raise InputError(f"there is no coordinate '{name}' (valid: {', '.join(names)})", element="independent")
    assembly = _assembly(mechanism)
    if assembly is not None and assembly.assembled is not None:
        assembly.assembled.check()
    if assembly is not None and assembly.mobility(assembly.pose[None])[0] == 0:
        raise InputError(f"the loops closed by {_closures(mechanism)} leave no motion")
    field, jacobian = _jacobian(mechanism)
    first = list(wanted) if wanted is not None else [name for name in prefer if name in names]
    chosen = independent_coordinates(
        mechanism, jacobian, field, first, None if assembly is None else assembly.free_velocities(assembly.pose)
    )
    if assembly is not None:
        _check_mobility(mechanism, chosen, assembly)
    if wanted is not None:
        _check_wanted(wanted, chosen)
        chosen = tuple(wanted)
    return replace(mechanism, independent=chosen)


def assembled(mechanism: Mechanism) -> Assembled | None:
    """What had to be moved to close the loops of a mechanism; None without loops, or if symbols have no values.

    Parameters
    ----------
    mechanism : Mechanism
    """
    assembly = _assembly(mechanism) if mechanism.closures else None
    return None if assembly is None else assembly.assembled


def _assembly(mechanism: Mechanism) -> Assembly | None:
    """Configurations in double precision; None if symbols have no values."""
    if any(symbol.value is None for symbol in mechanism.symbols.values()):
        return None
    try:
        return Assembly(mechanism)
    except InputError:  # symbols that the mechanism does not even list
        return None


def _check_mobility(mechanism: Mechanism, chosen: tuple[str, ...], assembly: Assembly) -> None:
    """Refuse loops that can move to six digits, but not with the numbers as they are."""
    q = assembly.pose[None]
    if chosen:
        moving = Assembly(replace(mechanism, independent=chosen))
        q, _, _ = moving.random_closed_states(random_generator(DEFAULT_SEED), _STATES)
        if np.ptp(q, axis=0).max() < _STANDS_STILL:
            raise InputError(_shaky(mechanism))
    mobility = int(assembly.mobility(q).min())
    if len(chosen) < mobility:
        raise InputError(_locked(mechanism, len(chosen), mobility))


def _jacobian(mechanism: Mechanism) -> tuple[PrimeField, Residues]:
    """The Jacobian of the closures at a closed pose of a random geometry."""
    program = Program()
    recorder = Recorder(mechanism, program)
    loops = loops_of(mechanism, recorder)
    assert loops is not None
    sampler, rng = CurveSampler(program, [], loops, loops.order), random_generator(DEFAULT_SEED)
    for _ in range(_ATTEMPTS):
        field = PrimeField.random(rng)
        try:
            return field, sampler.jacobian(field, rng)
        except DegenerateSampleError:
            continue
        except ShakyPoseError:
            raise InputError(_shaky(mechanism)) from None
        except (SingularPoseError, UnsolvedSystemError) as error:
            raise InputError(_unsolved(mechanism, str(error))) from None
    raise InputError(_unsolved(mechanism, "the equations have no solution at random points"))


def _shaky(mechanism: Mechanism) -> str:
    return (
        f"the loops closed by {_closures(mechanism)} can move infinitesimally, but not really.  If they are meant to "
        f"move, rounding has locked them.  {_EXACTLY}"
    )


def _unsolved(mechanism: Mechanism, reason: str) -> str:
    return (
        f"no exact closed pose was found for {_closures(mechanism)}: {reason}.  Give frames with which the loops are "
        "closed where all coordinates are zero, or at an assembly pose of multiples of 15 degrees (leave out the "
        "second frame and it is where the first one is)"
    )


def _check_wanted(wanted: Sequence[str], chosen: Sequence[str]) -> None:
    if len(wanted) < len(chosen):
        more = ", ".join(name for name in chosen if name not in wanted)
        problem = f"{_independent(len(chosen))}, not {len(wanted)}; add for example {more}"
        raise InputError(problem, element="independent")
    bound = [name for name in wanted if name not in chosen]
    if bound:
        problem = (
            f"{_independent(len(chosen))}, not {len(wanted)}; '{bound[0]}' follows from the others"
            if len(wanted) > len(chosen)
            else f"'{bound[0]}' follows from the others while the loops are closed; take for example "
            + ", ".join(name for name in chosen if name not in wanted)
        )
        raise InputError(problem, element="independent")


def _independent(count: int) -> str:
    return "1 coordinate is independent" if count == 1 else f"{count} coordinates are independent"


def _locked(mechanism: Mechanism, freedom: int, mobility: int) -> str:
    return (
        f"rounding has locked the loops closed by {_closures(mechanism)}: to six digits the mechanism has {mobility} "
        f"degrees of freedom, with the numbers as they are {freedom}.  {_EXACTLY}"
    )


def _closures(mechanism: Mechanism) -> str:
    return ", ".join(f"'{closure.name}'" for closure in mechanism.closures)
