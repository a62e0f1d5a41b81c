"""The functions of a base model, each recorded once."""

from __future__ import annotations

from abc import ABC
from functools import cached_property

from echelon.base.matrix import BaseMatrix
from echelon.dynamics.functions import robot_function
from echelon.mechanism.mechanism import Mechanism
from echelon.program.function import Function


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

    def _function(self, name: str) -> Function:
        """A function, recorded when it is first asked for; entries and observations share the regressor's."""
        if name == "entries":
            name = "regressor"
        if name not in self._functions:
            standard = name == "standard_regressor"
            pivots = range(len(self.mechanism.parameters)) if standard else self.matrix.pivots
            self._functions[name] = robot_function("regressor" if standard else name, self.mechanism, pivots)
        return self._functions[name]
