"""Chinese remainders and rational reconstruction: what goes in comes out, and noise is not believed."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sympy.ntheory.modular import crt

from echelon.algebra.exact.field import random_prime
from echelon.algebra.exact.interpolation import combine, rational

_RNG = np.random.default_rng(5)
PRIMES = [random_prime(_RNG, 31) for _ in range(6)]


@given(st.lists(st.integers(0, 2**31 - 1), min_size=1, max_size=6))
def test_chinese_remainders_agree_with_sympy(residues: list[int]) -> None:
    primes = PRIMES[: len(residues)]
    reduced = [r % p for r, p in zip(residues, primes, strict=True)]
    assert combine(reduced, primes) == tuple(map(int, crt(primes, reduced)))


def test_no_remainders_say_nothing() -> None:
    assert combine([], []) == (0, 1)
    with pytest.raises(ValueError, match="argument 2"):
        combine([1, 2], PRIMES[:1])


@pytest.mark.parametrize("count", [1, 2, 3, 6])
@given(data=st.data())
def test_fractions_come_back(data: st.DataObject, count: int) -> None:
    bits = 31 * count - 20  # the margin of belief and a little more
    numerator_bits = data.draw(st.integers(0, bits))
    bound, denominator_bound = 1 << numerator_bits, 1 << (bits - numerator_bits)
    x = Fraction(
        data.draw(st.integers(-bound, bound)),
        data.draw(st.integers(1, denominator_bound)),
    )
    residues = [x.numerator * pow(x.denominator, -1, p) % p for p in PRIMES[:count]]
    found = rational(*combine(residues, PRIMES[:count]))
    assert found == x
    assert isinstance(found, int) == (x.denominator == 1)


@pytest.mark.parametrize("count", [1, 2, 4])
def test_noise_is_hardly_ever_believed(count: int) -> None:
    modulus = combine([0] * count, PRIMES[:count])[1]
    noise = [int.from_bytes(_RNG.bytes(20), "little") % modulus for _ in range(2000)]
    assert sum(rational(x, modulus) is not None for x in noise) <= 12


def test_a_representative_outside_the_range_is_the_same_residue() -> None:
    assert rational(PRIMES[0] + 5, PRIMES[0]) == rational(5, PRIMES[0]) == 5
    assert rational(-1, PRIMES[0]) == -1
    assert rational(3 * PRIMES[0], PRIMES[0]) == 0
