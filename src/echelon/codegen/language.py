"""A target language: patterns for expressions and statements, and templates for everything around them.

A new target is one such configuration and its templates; see :mod:`echelon.codegen.targets`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from echelon.codegen.numbers import Precision, decimal
from echelon.exact.numbers import Number
from echelon.program.operations import Op


@dataclass(frozen=True)
class Language:
    """How a language writes things.

    Attributes
    ----------
    name : str
        The target's name.
    files : mapping of str to str
        Templates by the pattern of the file's name: ``{robot}`` is the robot's identifier; with ``{function}`` there is
        one file for each function.
    comment : str
        Opens every line of documentation.
    functions : mapping of Op to str
        Patterns of functions of ``{x}``.  Here and in :attr:`number`, ``{f}`` is ``f`` in single precision and empty in
        double precision.
    number : str
        Pattern of a literal with the decimal ``{x}``.
    real : mapping of Precision to str
        Floating-point types.
    element : str
        Pattern of entry ``{index}`` of the vector ``{name}``.
    entry : str
        Pattern of the entry ``{index}`` of the result.
    separator : str, optional
        Stands between the indices of an entry of the result; None for one index into a dense row-major array.
    define, assign : str
        Patterns of the statements that give ``{name}`` the value ``{value}``, for the first time or otherwise.
    first : int
        The first index.
    zeroed : bool
        Whether the templates make results that start as zeros; otherwise zeros are assigned, or filled in if there are
        many.
    windows : bool
        Whether sines and cosines are computed several at once, from consecutive entries of q where possible.
    splits : bool
        Whether long functions are cut into parts.
    """

    name: str
    files: Mapping[str, str]
    comment: str
    functions: Mapping[Op, str]
    number: str = "{x}"
    real: Mapping[Precision, str] = field(default_factory=lambda: {p: p.value for p in Precision})
    element: str = "{name}[{index}]"
    entry: str = "result[{index}]"
    separator: str | None = None
    define: str = "{name} = {value}"
    assign: str = "{name} = {value}"
    first: int = 0
    zeroed: bool = False
    windows: bool = False
    splits: bool = False

    def literal(self, value: Number, precision: Precision) -> str:
        """A constant that is not negative."""
        return self.number.format(x=decimal(value, precision), f=precision.suffix)

    def call(self, op: Op, x: str, precision: Precision) -> str:
        """A function of an expression."""
        return self.functions[op].format(x=x, f=precision.suffix)

    def at(self, name: str, index: int) -> str:
        """An entry of a vector."""
        return self.element.format(name=name, index=index + self.first)

    def result_at(self, index: tuple[int, ...], shape: tuple[int, ...]) -> str:
        """An entry of the result."""
        if self.separator is None:
            place = 0
            for k, size in zip(index, shape, strict=True):
                place = place * size + k
            return self.entry.format(index=place + self.first)
        return self.entry.format(index=self.separator.join(str(k + self.first) for k in index))
