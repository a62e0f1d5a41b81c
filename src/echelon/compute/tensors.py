"""Functions of a robot on arrays of JAX or PyTorch: for batches on any device, and for automatic differentiation.

The recorded program is replayed on the caller's arrays, operation by operation, so that the library sees nothing but
its own elementwise functions: whatever transforms these (jit, vmap, grad, compile) transforms the robot's functions.
What depends on numbers alone is computed once, in double precision, and enters as plain numbers, which change no type.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import reduce
from importlib import import_module
from typing import Any

import numpy as np

from echelon.algebra import FUNCTIONS, FloatArithmetic, Function, Op, operands
from echelon.shared import InputError

_OPERATORS: Mapping[Op, Callable[..., Any]] = {
    Op.ADD: operator.add,
    Op.SUB: operator.sub,
    Op.MUL: operator.mul,
    Op.DIV: operator.truediv,
    Op.NEG: operator.neg,
}
_NAMES = {op: op.name.lower() for op in FUNCTIONS} | {Op.ATAN: "arctan"}
"""Names of functions that JAX and PyTorch share."""


@dataclass(frozen=True)
class TensorLibrary:
    """A library of arrays, by names, so that it can be sent to other processes."""

    name: str  # "jax.numpy" or "torch"
    converts: str  # name of the function that makes arrays, with a dtype, and keeps derivatives

    @property
    def module(self) -> Any:
        """The library's functions."""
        return import_module(self.name)

    @property
    def convert(self) -> Callable[..., Any]:
        """Makes an array."""
        made: Callable[..., Any] = getattr(self.module, self.converts)
        return made


@dataclass(frozen=True, eq=False)  # compilers of functions need a hash
class TensorFunction:
    """A function of a robot on a library's arrays.

    Arguments have shape (..., size) with any leading axes, which are broadcast; the result has these axes, and then
    its own.  The type is the common one of the arguments.

    Attributes
    ----------
    function : Function
        What is computed; ``function.arguments`` says what each argument holds.
    library : TensorLibrary
    stated : mapping of str to sequence of float
        Values of arguments that may be left out.
    """

    function: Function
    library: TensorLibrary
    stated: Mapping[str, Any]

    def __call__(self, *arrays: Any, **named: Any) -> Any:
        """Evaluate; arguments by place, in the order of ``function.arguments``, or by name."""
        columns = self._columns(self._given(arrays, named))
        xp, function = self.library.module, self.function
        tensors = [x for x in columns.values() if not isinstance(x, float)]
        shape = np.broadcast_shapes(*(x.shape for x in tensors))
        blank = xp.zeros_like(xp.broadcast_to(tensors[0], shape))
        values = self._evaluated(columns)
        # a result that is a number everywhere has the axes of the samples, too
        entries = {
            index: xp.broadcast_to(blank + values[node], shape)
            for index, node in function.entries.items()
        }
        flat = [entries.get(index, blank) for index in np.ndindex(function.shape)]
        # there is something to stack even if the result has no entries
        stacked = xp.stack([blank, *flat], -1)[..., 1:]
        return stacked.reshape((*shape, *function.shape))

    def _given(
        self, arrays: tuple[Any, ...], named: Mapping[str, Any]
    ) -> dict[str, Any]:
        """Arguments by name."""
        names = [argument.name for argument in self.function.arguments]
        places = [name for name in names if name not in self.stated]
        given = {**dict(zip(places, arrays, strict=False)), **named}
        expected = f"{self.function.name}({', '.join(places)})"
        if len(arrays) > len(places) or not set(named) <= set(names):
            raise InputError(f"too many arguments, or others than {expected} has")
        missing = [name for name in places if name not in given]
        if missing:
            raise InputError(f"{missing[0]} is missing: expected {expected}")
        return {**self.stated, **given}

    def _columns(self, given: Mapping[str, Any]) -> dict[int, Any]:
        """Entries of the arguments along their last axis, by node; those that are stated are numbers."""
        convert, columns = self.library.convert, dict[int, Any]()
        # a product with a number makes whole numbers floating-point ones
        arrays = {
            name: 1.0 * convert(value)
            for name, value in given.items()
            if value is not self.stated.get(name)
        }
        if not arrays:
            raise InputError(f"{self.function.name} is called without any array")
        types = [array.dtype for array in arrays.values()]
        common = reduce(self.library.module.promote_types, types)
        for argument in self.function.arguments:
            if argument.name not in arrays:
                columns |= zip(argument.nodes, given[argument.name], strict=True)
                continue
            array = convert(arrays[argument.name], dtype=common)
            if not array.shape or array.shape[-1] != len(argument):
                raise InputError(
                    f"{argument.name} has shape {tuple(array.shape)}; expected (..., {len(argument)}): "
                    f"{', '.join(argument.labels)}"
                )
            columns |= {node: array[..., k] for k, node in enumerate(argument.nodes)}
        return columns

    def _evaluated(self, columns: dict[int, Any]) -> dict[int, Any]:
        """The value of every node: a number where it depends on numbers alone."""
        program, values = self.function.program, dict(columns)
        module, numbers = self.library.module, FloatArithmetic()
        for node in self.function.needed:
            if node in values:
                continue
            op = Op(program.ops[node])
            inner = [values[n] for n in operands(program, node)]
            if op is Op.CONSTANT:
                values[node] = float(program.constants[node])
            elif all(isinstance(x, float) for x in inner):
                compute = numbers.unary if len(inner) == 1 else numbers.binary
                values[node] = float(compute(op, *map(np.asarray, inner)))
            else:
                apply = _OPERATORS.get(op) or getattr(module, _NAMES[op])
                values[node] = apply(*inner)
        return values


@dataclass(frozen=True)
class TensorFunctions:
    """All functions of a robot on a library's arrays, each as an attribute: ``functions.gravity(q, parameters)``.

    Attributes
    ----------
    make : callable
        The function of a name, refused where the robot has none.
    names : tuple of str
        Names of functions.
    """

    make: Callable[[str], TensorFunction]
    names: tuple[str, ...]

    def __getattr__(self, name: str) -> TensorFunction:
        # copies are asked for attributes before they have any
        if name not in vars(self).get("names", ()):
            raise AttributeError(
                f"there is no function '{name}' (valid: {', '.join(vars(self).get('names', ()))})"
            )
        made = vars(self)[name] = self.make(name)
        return made

    def __dir__(self) -> list[str]:
        return list(self.names)
