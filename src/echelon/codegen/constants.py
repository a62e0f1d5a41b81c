"""Which inputs of a robot's functions are replaced by numbers: known geometry, and parameters on request."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from echelon.base.model import BaseModel
from echelon.dynamics.arguments import parameter_input
from echelon.errors import InputError, one_line
from echelon.exact.numbers import Number
from echelon.mechanism.mechanism import Mechanism, Symbol
from echelon.mechanism.symbol_values import all_symbols, symbol_values
from echelon.program.scalar import exact

FROM_FILE = "file"
"""The parameters that the robot's file states."""

_SHOWN = 6


@dataclass(frozen=True)
class Constants:
    """Numbers to put in.

    Attributes
    ----------
    numbers : mapping of str to Number
        By the name of the program's input.
    texts : mapping of str to str
        The same for people to read, where they did not give it themselves.
    values : tuple of float, optional
        Base parameters.
    stated : mapping of str to str
        Values of symbols that are not put in although they have one.
    """

    numbers: Mapping[str, Number] = field(default_factory=dict)
    texts: Mapping[str, str] = field(default_factory=dict)
    values: tuple[float, ...] | None = None
    stated: Mapping[str, str] = field(default_factory=dict)


def kept_symbols(
    mechanism: Mechanism, keep: bool | Sequence[str], given: Mapping[str, float] | None
) -> tuple[str, ...]:
    """Symbols that stay arguments although they have values.

    Raises
    ------
    InputError
        If there is no such symbol, or it is given a value, too.
    """
    valid = sorted(all_symbols(mechanism))
    kept = tuple(valid) if keep is True else tuple(keep or ())
    strange = next((name for name in kept if name not in valid), None)
    if strange is not None:
        raise InputError(f"there is no symbol '{one_line(strange)}' to keep (valid: {', '.join(valid) or 'none'})")
    both = next((name for name in given or {} if name in kept), None)
    if both is not None:
        raise InputError(f"the symbol '{one_line(both)}' is kept as an argument, so it takes no value here")
    return kept


def symbol_constants(mechanism: Mechanism, given: Mapping[str, float] | None, kept: Collection[str] = ()) -> Constants:
    """All symbols with a value, from the file or given, except those that are kept.

    Raises
    ------
    InputError
        If a given name is not a symbol of the mechanism.
    """
    overrides = symbol_values(mechanism, given or {}, given)
    stated = {name: symbol for name, symbol in mechanism.symbols.items() if symbol.value is not None}
    listed = {name: symbol.exact or repr(symbol.value) for name, symbol in stated.items()}
    stated = {name: symbol for name, symbol in stated.items() if name not in kept}
    numbers = {name: _number(symbol) for name, symbol in stated.items()}
    numbers |= {name: exact(value) for name, value in overrides.items()}
    texts = {name: listed[name] for name in stated} | {name: repr(value) for name, value in overrides.items()}
    return Constants(numbers, texts, stated={name: text for name, text in listed.items() if name in kept})


def _number(symbol: Symbol) -> Number:
    """The exact value, where it lies in the field of exact numbers, else the decimal."""
    return exact(symbol.value) if symbol.number is None else symbol.number


def parameter_constants(
    base: BaseModel, given: str | Mapping[str, float] | None, symbols: Mapping[str, float] | None
) -> Constants:
    """Values of the base parameters.

    Raises
    ------
    InputError
        If there are neither all base parameters nor all standard parameters, or a value is not finite.
    """
    if given is None:
        return Constants()
    standard: Sequence[float | None] = ()
    if isinstance(given, str):
        if given != FROM_FILE:
            raise InputError(f"parameters are 'file' or values by name, not '{one_line(given)}'")
        values, standard = base.values(symbols=symbols), base.mechanism.standard_values()
    elif len(given) == len(base.pivots) and set(given) == set(base.pivots):
        values = np.array([given[name] for name in base.pivots], dtype=float)
    else:
        _check_names(base, given)
        standard = complete = [given[name] for name in base.parameters]
        values = base.values(complete, symbols)
    numbers = {parameter_input(name): exact(float(v)) for name, v in zip(base.pivots, values, strict=True)}
    pairs = zip(base.parameters, standard, strict=True) if standard else ()
    numbers |= {parameter_input(n, standard=True): exact(float(v)) for n, v in pairs if v is not None}
    return Constants(numbers, values=tuple(map(float, values)))


def _check_names(base: BaseModel, given: Mapping[str, float]) -> None:
    strange = [name for name in given if name not in base.parameters]
    if strange:
        raise InputError(f"there are no parameters {_listed(strange)}")
    missing = [name for name in base.pivots if name not in given] or [n for n in base.parameters if n not in given]
    if missing:
        raise InputError(
            f"values are missing for {_listed(missing)}: give all {len(base.pivots)} base parameters by the names of "
            f"their representatives and nothing else, or all {len(base.parameters)} standard parameters"
        )


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return ", ".join(f"'{one_line(name)}'" for name in names[:_SHOWN]) + more
