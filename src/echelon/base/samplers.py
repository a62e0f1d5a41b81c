"""The one place that decides how rows of a model are sampled: modulo primes, or at real states in ball arithmetic."""

from __future__ import annotations

from echelon.base.prime_states import PrimeStates
from echelon.base.real_states import RealStates
from echelon.dynamics import Rows


def states_of(rows: Rows) -> PrimeStates | RealStates:
    """Sampler of rows: points of prime fields where rows are rational in free variables, else real states."""
    return PrimeStates(rows) if rows.forms.rational else RealStates(rows)
