"""Mechanisms with loops: how they can move, and which coordinates the others depend on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from echelon.errors import DegenerateSampleError, EchelonError, InputError
from echelon.exact.elimination import rank
from echelon.exact.field import PrimeField, Residues
from echelon.mechanism.mechanism import Mechanism
from echelon.program.tape import Program
from echelon.regressor.closures import loops_of
from echelon.regressor.curves import CurveSampler
from echelon.regressor.lifting import choose
from echelon.regressor.steps import Recorder

_SEED = 2015
_ATTEMPTS = 8


def close(mechanism: Mechanism, wanted: Sequence[str] | None = None, *, prefer: Sequence[str] = ()) -> Mechanism:
    """A mechanism with loops, its independent coordinates chosen.

    Parameters
    ----------
    mechanism : Mechanism
        With closures.
    wanted : sequence of str, optional
        The coordinates that are to be independent, as many as there are degrees of freedom.
    prefer : sequence of str
        Otherwise, coordinates that should be, such as those with drives; then those nearer to the base.

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
    field, jacobian = _jacobian(mechanism)
    names = list(mechanism.velocities)
    freedom = len(names) - rank(jacobian, field)
    if freedom == 0:
        raise InputError(_locked(mechanism))
    for name in wanted or ():
        if name not in names:
            raise InputError(f"there is no coordinate '{name}' (valid: {', '.join(names)})", element="independent")
    first = list(wanted) if wanted is not None else [name for name in prefer if name in names]
    choice = choose(jacobian, field, [names.index(name) for name in first])
    chosen = tuple(names[k] for k in choice.independent)
    if wanted is not None:
        _check_wanted(wanted, chosen)
        chosen = tuple(wanted)
    return replace(mechanism, independent=chosen)


def _jacobian(mechanism: Mechanism) -> tuple[PrimeField, Residues]:
    """The Jacobian of the closures at a closed pose of a random geometry."""
    program = Program()
    recorder = Recorder(mechanism, program)
    loops = loops_of(mechanism, recorder)
    assert loops is not None
    sampler, rng = CurveSampler(program, [], loops), np.random.default_rng(_SEED)
    for _ in range(_ATTEMPTS):
        field = PrimeField.random(rng)
        try:
            return field, sampler.jacobian(field, rng)
        except DegenerateSampleError:
            continue
    raise EchelonError("every random point is singular; please report this model")


def _check_wanted(wanted: Sequence[str], chosen: Sequence[str]) -> None:
    if len(wanted) < len(chosen):
        more = ", ".join(name for name in chosen if name not in wanted)
        problem = f"{len(chosen)} coordinates are independent, not {len(wanted)}; add for example {more}"
        raise InputError(problem, element="independent")
    bound = [name for name in wanted if name not in chosen]
    if bound:
        problem = (
            f"{len(chosen)} coordinates are independent, not {len(wanted)}; '{bound[0]}' follows from the others"
            if len(wanted) > len(chosen)
            else f"'{bound[0]}' follows from the others while the loops are closed; take for example "
            + ", ".join(name for name in chosen if name not in wanted)
        )
        raise InputError(problem, element="independent")


def _locked(mechanism: Mechanism) -> str:
    names = ", ".join(f"'{closure.name}'" for closure in mechanism.closures)
    return f"the loops closed by {names} leave no motion"
