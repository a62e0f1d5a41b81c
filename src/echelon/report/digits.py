"""Numbers as a reader wants them: as many digits as the uncertainty leaves meaningful, and no more.

The uncertainty gets two significant digits and the value ends at the same decimal place (GUM, 7.2.6), so that no
printed digit suggests knowledge that is not there.
"""

from __future__ import annotations

from math import floor, isfinite, isinf, isnan, log10

_NARROW = "\N{NARROW NO-BREAK SPACE}"
_LARGEST, _SMALLEST = 6, -4  # decimal exponents that are still written out
_SUPERSCRIPTS = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")
_MISSING = "–"


def significant(value: float, digits: int = 4) -> str:
    """A number with the given number of significant digits.

    >>> significant(0.123456), significant(-12345.6), significant(3.2e-9, 2), significant(float("inf"))
    ('0.1235', '−12346', '3.2×10⁻⁹', '∞')
    """
    special = _special(value)
    if special is not None:
        return special
    exponent = _exponent(value, digits)
    if exponent > _LARGEST or exponent < _SMALLEST:
        return _scientific(value, exponent, digits - 1)
    return _signed(f"{value:.{max(digits - 1 - exponent, 0)}f}")


def with_uncertainty(value: float, std: float) -> tuple[str, str]:
    """A value and its standard deviation, both ending at the second significant digit of the latter.

    >>> with_uncertainty(1.23456789, 0.00123), with_uncertainty(5123.4, 120.0), with_uncertainty(0.3, 0.0)
    (('1.2346', '0.0012'), ('5120', '120'), ('0.3000', '0'))
    """
    if _special(value) is not None or not isfinite(std) or std <= 0:
        return significant(value), significant(std, 2)
    place = 1 - _exponent(std, 2)  # decimals that remain; negative for tens and hundreds
    exponent = max(_exponent(value, 17) if value else -place, 1 - place)
    if exponent > _LARGEST or exponent < _SMALLEST:
        decimals = max(exponent + place, 0)
        return _scientific(value, exponent, decimals), _scientific(std, exponent, decimals)
    decimals = max(place, 0)
    return tuple(_signed(f"{round(number, place):.{decimals}f}") for number in (value, std))  # type: ignore[return-value]


def to_place(value: float, std: float) -> str:
    """A number that ends where a value with this standard deviation ends, such as an end of its interval."""
    return with_uncertainty(value, std)[0]


def percent(value: float, digits: int = 2) -> str:
    """A number of per cent, without the sign; large ones are only said to be large.

    >>> percent(0.5123), percent(12.3), percent(4321.0)
    ('0.51', '12', '> 999')
    """
    return f">{_NARROW}999".replace(_NARROW, " ") if value > 999 and not isinf(value) else significant(value, digits)


def share(value: float) -> str:
    """A coefficient of determination or another number near 1: all nines, and two digits beyond them.

    >>> share(0.998731), share(0.91), share(-3.2), share(1.0)
    ('0.9987', '0.910', '−3.20', '1.000')
    """
    special = _special(value)
    if special is not None:
        return special
    gap = abs(1 - value)
    decimals = 3 if gap >= 0.01 or gap == 0 else min(1 - floor(log10(gap)), 8)
    return _signed(f"{value:.{2 if value < 0 else decimals}f}")


def _special(value: float) -> str | None:
    """Text of what has no digits."""
    if isnan(value):
        return _MISSING
    if isinf(value):
        return "∞" if value > 0 else "−∞"
    return "0" if value == 0 else None


def _exponent(value: float, digits: int) -> int:
    """Decimal exponent after rounding to the given number of digits."""
    return int(f"{value:.{digits - 1}e}".partition("e")[2])


def _scientific(value: float, exponent: int, decimals: int) -> str:
    # scaled in text, because 10.0**exponent overflows where the value does not
    scaled = float(f"{value:.16e}".partition("e")[0]) * 10.0 ** (_exponent(value, 17) - exponent) if value else 0.0
    return f"{_signed(f'{scaled:.{decimals}f}')}×10{str(exponent).translate(_SUPERSCRIPTS)}"


def _signed(text: str) -> str:
    """With a true minus sign, and no sign before zero."""
    if not text.startswith("-"):
        return text
    return f"−{text[1:]}" if text.strip("-0.") else text[1:]
