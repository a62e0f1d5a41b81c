"""Observation matrices without the matrix: the entrance.

>>> from echelon.program.tape import Program
>>> from echelon.program.function import Argument, Function
>>> program = Program()
>>> x = program.input("x")
>>> argument = Argument("x", (x.node,), ("x",), ("rad",))
>>> entries = {(0, 0): program.one.node, (0, 1): x.node}
>>> line = Function("line", program, (argument,), entries, (("force",), ("offset", "slope")))
>>> accumulate(line, {"x": [[0.0], [1.0], [2.0]], "y": [[1.0], [3.0], [5.0]]}).combined().solve().round(9)
array([1., 2.])
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Literal

import numpy.typing as npt

from echelon.errors import InputError
from echelon.machine.target import Target
from echelon.observe.engine import Engine, GramEngine, QrEngine
from echelon.observe.layout import measured
from echelon.observe.normal import NormalEquations
from echelon.observe.observation import Observation
from echelon.observe.reference import ReferenceGram, ReferenceQr
from echelon.observe.stream import BLOCK, Stream
from echelon.program.function import Function

Method = Literal["machine", "numpy"]
Data = Mapping[str, npt.ArrayLike]


class Observer:
    """A regressor ready to take samples in: compile once, use for many batches.

    Parameters
    ----------
    function : Function
        A regressor, of shape (outputs, parameters).
    outputs : str
        Name of the argument with the measured outputs, of shape (samples, outputs).
    method : "machine" or "numpy"
        Compiled kernels, or the reference implementation.
    target : Target, optional
        Processor to compile for; the one at hand if omitted.

    Examples
    --------
    See :mod:`echelon.observe.accumulate`.
    """

    def __init__(
        self, function: Function, *, outputs: str = "y", method: Method = "machine", target: Target | None = None
    ) -> None:
        if method not in ("machine", "numpy"):
            raise InputError(f"method is '{method}'; expected 'machine' or 'numpy'")
        self.function = measured(function, outputs)
        self.method, self._target = method, target
        self._engines: dict[str, Engine] = {}

    def __call__(self, data: Data | Iterable[Data], *, block: int = BLOCK, threads: int | None = None) -> Observation:
        """R-factors of [W y].

        Parameters
        ----------
        data : mapping of str to array, or iterable of such
            The regressor's arguments and the measured outputs by name, of shape (samples, size), or (size,) for uniform
            ones.  Pieces of an iterable follow one another; how samples are cut into pieces does not matter.
        block : int
            Samples in a block.  The result depends on it in the last digits, and on nothing else but the data and the
            processor's vector length.
        threads : int, optional
            At most so many; as many as there are processors if omitted.

        Returns
        -------
        Observation

        Raises
        ------
        InputError
            If arrays do not fit, or values are not finite.
        """
        stream = self._filled("qr", data, block, threads)
        return Observation.of(stream.engine.layout, stream.factors(), stream.samples)

    def normal_equations(
        self, data: Data | Iterable[Data], *, block: int = BLOCK, threads: int | None = None
    ) -> NormalEquations:
        """Gram matrices of [W y]: about twice as fast, with half the digits.

        Parameters
        ----------
        data, block, threads
            As for R-factors.

        Returns
        -------
        NormalEquations
        """
        stream = self._filled("gram", data, block, threads)
        return NormalEquations(stream.engine.layout, stream.factors(), stream.samples)

    def _filled(self, kind: str, data: Data | Iterable[Data], block: int, threads: int | None) -> Stream:
        if kind not in self._engines:
            self._engines[kind] = self._engine(kind)
        stream = Stream(self._engines[kind], block, threads)
        if isinstance(data, Mapping):
            stream.add(data, lasting=True)
        else:
            for piece in data:
                stream.add(piece)
        return stream

    def _engine(self, kind: str) -> Engine:
        if self.method == "numpy":
            return ReferenceQr(self.function) if kind == "qr" else ReferenceGram(self.function)
        make = QrEngine if kind == "qr" else GramEngine
        return make(self.function, target=self._target)

    def __getstate__(self) -> dict[str, object]:
        """Copies make their own engines when they are first called."""
        return {**vars(self), "_engines": {}}

    def __repr__(self) -> str:
        return f"Observer({self.function}, {self.method})"


def accumulate(
    function: Function, data: Data | Iterable[Data], *, block: int = BLOCK, threads: int | None = None
) -> Observation:
    """R-factors of the observation matrix and the measured outputs, without the matrix.

    Parameters
    ----------
    function : Function
        A regressor, of shape (outputs, parameters).
    data : mapping of str to array, or iterable of such
        Its arguments and the measured outputs ``"y"`` by name; see :class:`Observer`.
    block : int
        Samples in a block.
    threads : int, optional
        At most so many; as many as there are processors if omitted.

    Returns
    -------
    Observation

    Raises
    ------
    InputError
        If arrays do not fit, or values are not finite.
    """
    return Observer(function)(data, block=block, threads=threads)
