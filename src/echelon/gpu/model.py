"""A base model on a GPU: the entrance."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import cached_property
from typing import Any

from echelon.base.model import BaseModel
from echelon.codegen.numbers import Precision
from echelon.dynamics.closed_states import ClosedStates
from echelon.dynamics.observer import RobotObserver
from echelon.gpu.accumulate import DeviceObserver
from echelon.gpu.batches import DeviceEvaluator
from echelon.gpu.device import Array, Device
from echelon.observe.observation import Observation

Symbols = Mapping[str, float] | None
Inputs = Mapping[str, Any] | None


class Gpu:
    """Evaluates a base model on the current device of CuPy.

    Arguments are those of the base model's own methods, see :class:`echelon.base.evaluation.Evaluation`.  Arrays may be
    of NumPy, which are copied to the device, or of CuPy.  Results are CuPy arrays.  Code is compiled when a function is
    first called, and kept on disk by CuPy.

    Parameters
    ----------
    base : BaseModel
        Made by :func:`echelon.base_parameters` or :func:`echelon.load_base`.
    precision : str
        Of results and of the arithmetic, ``"double"`` or ``"single"``; :meth:`accumulate` is always double.

    Raises
    ------
    MissingExtraError
        If CuPy is not installed.
    InputError
        If there is no device that it can use.
    """

    def __init__(self, base: BaseModel, precision: str = "double") -> None:
        self.base, self.precision = base, Precision.named(precision)
        self._device = Device()
        self._evaluators: dict[str, DeviceEvaluator] = {}

    def regressor(
        self,
        q: Array,
        qd: Array,
        qdd: Array,
        symbols: Symbols = None,
        inputs: Inputs = None,
        *,
        out: Array | None = None,
    ) -> Array:
        """The base regressor X̄.

        Parameters
        ----------
        q, qd, qdd : arrays of shape (N, positions), (N, velocities), (N, velocities)
            rad, m, s.
        symbols : mapping of str to float, optional
            Values of geometry symbols, SI units.
        inputs : mapping of str to array of shape (N,), optional
            Measured inputs that effects use.
        out : CuPy array of shape (N, outputs, base parameters), optional
            Where to write, in C order.

        Returns
        -------
        CuPy array of shape (N, outputs, base parameters)

        Raises
        ------
        InputError
            If arrays do not fit, or values are missing.
        """
        return self.evaluate("regressor", {"q": q, "qd": qd, "qdd": qdd}, symbols, inputs, out=out)

    def regressor_entries(
        self, q: Array, qd: Array, qdd: Array, symbols: Symbols = None, inputs: Inputs = None
    ) -> Array:
        """The entries of X̄ that are not structurally zero, as the device makes them, without a copy.

        Parameters
        ----------
        q, qd, qdd, symbols, inputs
            As for :meth:`regressor`.

        Returns
        -------
        CuPy array of shape (N, entries)
            In Fortran order: its transpose is contiguous.  ``base.sparsity`` says where entries belong.

        Raises
        ------
        InputError
            As for :meth:`regressor`.
        """
        evaluator = self._evaluator("regressor")
        return evaluator.made.entries(evaluator.values({"q": q, "qd": qd, "qdd": qdd}, symbols, inputs)).T

    def predict(
        self,
        q: Array,
        qd: Array,
        qdd: Array,
        values: Array,
        symbols: Symbols = None,
        inputs: Inputs = None,
        *,
        out: Array | None = None,
    ) -> Array:
        """The outputs y = X̄ ζ̄, by a Newton–Euler recursion in the base parameters alone.

        Parameters
        ----------
        q, qd, qdd, symbols, inputs
            As for :meth:`regressor`.
        values : array of shape (r,)
            Base parameters, SI units.
        out : CuPy array of shape (N, outputs), optional

        Returns
        -------
        CuPy array of shape (N, outputs)
            N, N·m or the outputs' own units.
        """
        state = {"q": q, "qd": qd, "qdd": qdd, "parameters": values}
        return self.evaluate("inverse_dynamics", state, symbols, inputs, out=out)

    def evaluate(
        self,
        function: str,
        state: Mapping[str, Array],
        symbols: Symbols = None,
        inputs: Inputs = None,
        *,
        out: Array | None = None,
    ) -> Array:
        """Any function of the robot.

        Parameters
        ----------
        function : str
            ``"regressor"``, ``"inverse_dynamics"``, ``"gravity"``, ``"coriolis"``, ``"effects"``, ``"mass_matrix"`` or
            ``"inverse_dynamics_derivatives"``, whose last axis holds derivatives by positions, then by velocities.
        state : mapping of str to array
            What the function depends on: ``q``, ``qd``, ``qdd`` of shape (N, size), and ``parameters`` of shape (r,).
        symbols, inputs
            As for :meth:`regressor`.
        out : CuPy array of the result's shape, optional

        Returns
        -------
        CuPy array of shape (N, …)

        Raises
        ------
        InputError
            If there is no such function, arrays do not fit, or values are missing.
        """
        return self._evaluator(function)(state, symbols, inputs, out)

    def accumulate(
        self, log: Mapping[str, Any] | Iterable[Mapping[str, Any]], symbols: Symbols = None, *, block: int | None = None
    ) -> Observation:
        """R-factors of the observation matrix W and the measured outputs y, without building W.

        Parameters
        ----------
        log : mapping of str to array, or iterable of such
            As for :meth:`echelon.BaseModel.accumulate`.  Memory on the device does not grow with the log's length.
        symbols : mapping of str to float, optional
        block : int, optional
            Samples that are factored together; chosen by the size of the regressor if omitted.  The result depends on
            it in the last digits.

        Returns
        -------
        Observation
            In NumPy's memory; merges with those made on the processor.

        Raises
        ------
        InputError
            If arrays do not fit, or values are missing or not finite.
        """
        function, observer = self._evaluator("regressor").made.function, self._observer
        size = observer.engine.block if block is None else block
        robot = RobotObserver(self.base.mechanism, function, observer, self._loops)
        return robot.observation(self._pieces(log), symbols, size, None)

    @cached_property
    def _loops(self) -> ClosedStates | None:
        mechanism = self.base.mechanism
        return ClosedStates(mechanism) if mechanism.closures else None

    @cached_property
    def _observer(self) -> DeviceObserver:
        return DeviceObserver(self._evaluator("regressor").made.function, self._device)

    def _pieces(self, log: Mapping[str, Any] | Iterable[Mapping[str, Any]]) -> Iterator[dict[str, Any]]:
        """A log piece by piece; with loops in NumPy's memory, where states are completed."""
        fetched = self._device.fetched
        for piece in [log] if isinstance(log, Mapping) else log:
            found = {name: fetched(v) if self.base.mechanism.closures else v for name, v in piece.items()}
            if isinstance(piece.get("inputs"), Mapping):
                found["inputs"] = {name: fetched(v) for name, v in piece["inputs"].items()}
            yield found

    def _evaluator(self, name: str) -> DeviceEvaluator:
        if name not in self._evaluators:
            function, mechanism = self.base.function(name), self.base.mechanism
            self._evaluators[name] = DeviceEvaluator(self._device, mechanism, function, self.precision, self._loops)
        return self._evaluators[name]

    def __reduce__(self) -> tuple[Any, ...]:
        """Copies compile their own code, for the device of the process that they are in."""
        return type(self), (self.base, self.precision.value)

    def __repr__(self) -> str:
        return f"Gpu({self.base.mechanism.name}, {self.precision} precision)"
