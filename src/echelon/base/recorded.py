"""The functions of a base model, each recorded once."""

from __future__ import annotations

from abc import ABC
from functools import cached_property
from typing import TYPE_CHECKING

from echelon.base.matrix import BaseMatrix
from echelon.dynamics.functions import robot_function
from echelon.mechanism.mechanism import Mechanism
from echelon.program.function import Function

if TYPE_CHECKING:  # importing LLVM takes longer than deriving base parameters: only who computes needs it
    from echelon.dynamics.closed_states import ClosedStates


class Recorded(ABC):
    """What has a mechanism and its base matrix.

    Attributes
    ----------
    mechanism : Mechanism
    matrix : BaseMatrix
        Exact sparse B.
    """

    mechanism: Mechanism
    matrix: BaseMatrix

    @cached_property
    def _functions(self) -> dict[str, Function]:
        return {}

    def function(self, name: str) -> Function:
        """One of the model's functions in terms of base parameters, recorded when it is first asked for.

        Parameters
        ----------
        name : str
            Of :data:`echelon.dynamics.functions.ALL_FUNCTIONS`.

        Returns
        -------
        Function

        Raises
        ------
        InputError
            If there is no such function, or it is one of mechanisms with loops and there are none.
        """
        if name not in self._functions:
            self._functions[name] = robot_function(name, self.mechanism, self.matrix.pivots)
        return self._functions[name]

    @cached_property
    def _loops(self) -> ClosedStates | None:
        """What completes states; None without loops."""
        if not self.mechanism.closures:
            return None
        from echelon.dynamics.closed_states import ClosedStates

        return ClosedStates(self.mechanism)
