"""The functions of a base model, each recorded once."""

from __future__ import annotations

from abc import ABC
from functools import cached_property

from echelon.base.matrix import BaseMatrix
from echelon.dynamics.functions import robot_function
from echelon.errors import InputError
from echelon.mechanism.mechanism import Mechanism
from echelon.program.function import Function

_NOT_WITH_LOOPS = ("coriolis", "mass_matrix", "inverse_dynamics_derivatives", "effects")


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
            Of :data:`echelon.dynamics.functions.FUNCTIONS`.

        Returns
        -------
        Function

        Raises
        ------
        InputError
            If there is no such function.
        """
        if name not in self._functions:
            self._functions[name] = robot_function(name, self.mechanism, self.matrix.pivots)
        return self._functions[name]

    def evaluated_function(self, name: str) -> Function:
        """The same, to be evaluated at states.

        Parameters
        ----------
        name : str
            Of :data:`echelon.dynamics.functions.FUNCTIONS`.

        Raises
        ------
        InputError
            If there is no such function, or it makes no sense with loops.
        """
        if self.mechanism.closures and name in _NOT_WITH_LOOPS:
            raise InputError(f"{name} is not available with loops, where accelerations depend on one another")
        return self.function(name)
