"""Units of logged quantities: texts such as ``deg/s`` or ``kgf·cm`` as factors to SI units.

A small grammar of prefixes, products, quotients and powers over a short list of units says more than a table of all
spellings could, and finds a wrong dimension as well as a wrong name.  Factors are exact fractions (of π, where an
angle is one) until the last step, so a factor is the float nearest to the true one.  An angle counts as a dimension of
its own: degrees must not pass for metres.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Final

from echelon.shared import InputError, nearest_of

Dimension = tuple[int, int, int, int, int]  # powers of kg, m, s, A and rad

_PI: Final = Fraction("3.14159265358979323846264338327950288419716939937510")
_G: Final = Fraction("9.80665")
_POUND: Final = Fraction("0.45359237")

_NONE: Final[Dimension] = (0, 0, 0, 0, 0)
_MASS: Final[Dimension] = (1, 0, 0, 0, 0)
_LENGTH: Final[Dimension] = (0, 1, 0, 0, 0)
_TIME: Final[Dimension] = (0, 0, 1, 0, 0)
_FORCE: Final[Dimension] = (1, 1, -2, 0, 0)
_ANGLE: Final[Dimension] = (0, 0, 0, 0, 1)
_SPIN: Final[Dimension] = (0, 0, -1, 0, 1)
_PREFIXES: Final = {"n": -9, "u": -6, "m": -3, "c": -2, "d": -1, "k": 3, "M": 6}
_QUANTITIES: Final = {
    "rad": ("an angle", "rad deg ° rev mrad grad arcmin arcsec"),
    "rad/s": ("an angular velocity", "rad/s deg/s rpm rev/s mrad/s"),
    "rad/s²": ("an angular acceleration", "rad/s² deg/s² rev/s²"),
    "m": ("a length", "m mm cm um in ft"),
    "m/s": ("a velocity", "m/s mm/s cm/s m/min in/s"),
    "m/s²": ("an acceleration", "m/s² mm/s² cm/s²"),
    "N·m": ("a torque", "N·m mN·m N·mm N·cm kN·m kgf·cm kgf·m lbf·in lbf·ft ozf·in"),
    "N": ("a force", "N mN kN kgf gf lbf ozf"),
    "A": ("a current", "A mA"),
    "V": ("a voltage", "V mV"),
    "s": ("a time", "s ms us ns min"),
    "1": ("a pure number", "1 %"),
}
"""Quantities by their SI unit: what they are called, and units that are valid for them."""

_SAME: Final = str.maketrans("⁰¹²³⁴⁻µμ⋅∙×", "01234-uu···")
_TOKEN: Final = re.compile(
    r"([A-Za-z°%]+|1)(?:(?:\^|\*\*)?([-+]?\d+))?|(\*|·|/|\.|-| )"
)
_COUNTS: Final = re.compile(
    "counts?|ticks?|pulses?|inc|increments|lsb|steps", re.IGNORECASE
)


@dataclass(frozen=True)
class _Unit:
    factor: Fraction
    dimension: Dimension
    prefixes: bool = False


_FACTORS: Final[dict[Dimension, dict[str, Fraction | int]]] = {
    _NONE: {"1": 1, "%": Fraction(1, 100)},
    _ANGLE: {
        "rad": 1,
        "deg degree degrees °": _PI / 180,
        "arcmin": _PI / 10800,
        "arcsec": _PI / 648000,
        "grad gon": _PI / 200,
        "rev turn turns": 2 * _PI,
    },
    _SPIN: {"rpm": 2 * _PI / 60, "rps": 2 * _PI},
    _LENGTH: {"m": 1, "in inch": Fraction("0.0254"), "ft": Fraction("0.3048")},
    _TIME: {"s sec secs second seconds": 1, "min": 60, "h": 3600, "day": 86400},
    (0, 0, -1, 0, 0): {"Hz": 1},
    _MASS: {"g": Fraction(1, 1000), "lb": _POUND},
    _FORCE: {"N": 1, "gf": _G / 1000, "lbf": _G * _POUND, "ozf": _G * _POUND / 16},
    (0, 0, 0, 1, 0): {"A": 1},
    (1, 2, -3, -1, 0): {"V": 1},
    (1, 2, -3, 0, 0): {"W": 1},
    (1, 2, -2, 0, 0): {"J": 1},
}
_PREFIXED: Final = frozenset(
    ["rad", "m", "s", "sec", "Hz", "g", "N", "gf", "A", "V", "W", "J"]
)
_UNITS: Final = {
    name: _Unit(Fraction(size), dimension, name in _PREFIXED)
    for dimension, sizes in _FACTORS.items()
    for names, size in sizes.items()
    for name in names.split()
}


def factor(unit: str, quantity: str | Sequence[str] | None) -> float:
    """Factor from a unit to the SI unit of a quantity, or of one of several; None stands for any quantity.

    Units have prefixes, products (``N·m``, ``N*m``, ``N m``, ``Nm``), quotients (``mm/s``; from left to right) and
    powers (``s²``, ``s^2``, ``s**2``, ``s2``); an empty text is the SI unit.
    """
    wanted = (
        None
        if quantity is None
        else (quantity,)
        if isinstance(quantity, str)
        else tuple(quantity)
    )
    if not unit.strip() or (wanted is not None and unit in wanted):
        return 1.0
    found = _parsed(unit, wanted or tuple(_QUANTITIES))
    if wanted is None:
        return float(found.factor)
    if all(_parsed(si, (si,)).dimension != found.dimension for si in wanted):
        of = next(
            (
                name
                for si, (name, _) in _QUANTITIES.items()
                if _parsed(si, (si,)).dimension == found.dimension
            ),
            "",
        )
        asked = " or ".join(_QUANTITIES.get(si, (si,))[0] for si in wanted)
        what = f"is the unit of {of}" if of else "is a unit of something else"
        if of == "a current" and "N·m" in wanted:
            valid = "leave out  unit,  and give the torque per ampere at the joint as  scale"
            raise InputError(f"'{unit}' {what}, not of {asked}: {valid}")
        raise InputError(
            f"'{unit}' {what}, not of {asked} (valid: {', '.join(_valid(wanted))})"
        )
    return float(found.factor)


def fits(unit: str, quantity: str | Sequence[str] | None) -> bool:
    """Whether a text, if there is any, is a unit of a quantity, or of one of several; None stands for any quantity."""
    try:
        return factor(unit, quantity) > 0
    except InputError:
        return False


def _valid(wanted: Sequence[str]) -> list[str]:
    return list(
        dict.fromkeys(
            text for si in wanted for text in _QUANTITIES.get(si, ("", si))[1].split()
        )
    )


def _parsed(text: str, wanted: Sequence[str]) -> _Unit:
    total, dimension, sign, place, ended = Fraction(1), [0] * 5, 1, 0, False
    plain = re.sub(
        r"\s*([*·/])\s*", r"\1", text.strip().translate(_SAME).replace("**", "^")
    )
    while place < len(plain):
        token = _TOKEN.match(plain, place)
        if token is None:
            raise _unknown(text, wanted)
        place = token.end()
        name, power, operator = token.groups()
        ended = not operator
        if operator:
            sign = -1 if operator == "/" else 1
            continue
        unit, exponent = _named(name, text, wanted), sign * int(power or 1)
        total *= unit.factor**exponent
        dimension = [
            d + exponent * u for d, u in zip(dimension, unit.dimension, strict=True)
        ]
        sign = 1
    if not ended:
        raise _unknown(text, wanted)
    kg, m, s, a, rad = dimension
    return _Unit(total, (kg, m, s, a, rad))


def _named(name: str, text: str, wanted: Sequence[str]) -> _Unit:
    """One unit, with a prefix or not; or several that are written together, as few as will do."""
    for parts in range(1, 4):
        found = {unit.factor: unit for unit in _joined(name, parts)}
        if len(found) > 1:
            raise InputError(
                f"'{text}' is ambiguous; write products with a dot, as in N·m"
            )
        if found:
            return next(iter(found.values()))
    raise _unknown(text, wanted)


def _joined(name: str, parts: int) -> Iterator[_Unit]:
    if parts == 1:
        unit = _single(name)
        if unit is not None:
            yield unit
        return
    for cut in range(1, len(name)):
        first = _single(name[:cut])
        if first is not None:
            for rest in _joined(name[cut:], parts - 1):
                kg, m, s, a, rad = (
                    x + y for x, y in zip(first.dimension, rest.dimension, strict=True)
                )
                yield _Unit(first.factor * rest.factor, (kg, m, s, a, rad))


def _single(name: str) -> _Unit | None:
    # long names in capitals are a habit (RPM, DEG); of short ones the case tells milli from mega
    known = _UNITS.get(name) or (_UNITS.get(name.lower()) if len(name) > 2 else None)
    if known is not None:
        return known
    base = _UNITS.get(name[1:])
    if base is None or not base.prefixes or name[0] not in _PREFIXES:
        return None
    return _Unit(base.factor * Fraction(10) ** _PREFIXES[name[0]], base.dimension)


def _unknown(text: str, wanted: Sequence[str]) -> InputError:
    if _COUNTS.fullmatch(text.strip()):
        return InputError(
            f"'{text}' is not a unit of fixed size: leave the unit out and state the size of a count as scale, "
            "such as 2*pi/4096 for 4096 counts per turn"
        )
    return InputError(f"'{text}' is not a unit{nearest_of(text, _valid(wanted))}")
