"""If this fails, a space that is moved and scaled all its life makes its scene slower with every step, or two readers fold a log to two places."""

from __future__ import annotations

from fractions import Fraction

from hypothesis import given
from hypothesis import strategies as st

from scenefold.scene.log.affine import Affine
from scenefold.scene.log.dyadic import BITS_MAX, Dyadic

FLOATS = st.floats(allow_nan=False, allow_infinity=False)
LONG = st.builds(
    Dyadic, st.integers(-(2 ** (BITS_MAX - 1)), 2 ** (BITS_MAX - 1)).map(lambda number: 2 * number + 1), st.integers(-9000, 2000)
)


def exact(number: Dyadic) -> Fraction:
    return Fraction(number.numerator) * Fraction(2) ** number.exponent


def nearest(value: Fraction) -> Fraction:
    """The nearest number of BITS_MAX bits, ties to even, by another way than the code's."""
    if not value:
        return value
    exponent = abs(value.numerator).bit_length() - value.denominator.bit_length() - BITS_MAX
    while abs(value) >= Fraction(2) ** (exponent + BITS_MAX):
        exponent += 1
    return round(value / Fraction(2) ** exponent) * Fraction(2) ** exponent


@given(st.one_of(LONG, FLOATS.map(Dyadic.of)), st.one_of(LONG, FLOATS.map(Dyadic.of)))
def test_sums_and_products_are_the_nearest_numbers_of_so_many_bits(a: Dyadic, b: Dyadic) -> None:
    for found, right in ((a.plus(b), exact(a) + exact(b)), (a.times(b), exact(a) * exact(b))):
        assert exact(found) == nearest(right)
        assert found.numerator.bit_length() <= BITS_MAX
        assert found.numerator % 2 or found == Dyadic(0, 0)


def test_a_tie_goes_to_the_even_number() -> None:
    one, lowest, half = Dyadic(1, 0), Dyadic(1, 1 - BITS_MAX), Dyadic(1, -BITS_MAX)
    assert one.plus(half) == one
    assert one.plus(lowest).plus(half) == one.plus(lowest).plus(lowest)
    assert Dyadic(-1, 0).plus(Dyadic(-1, -BITS_MAX)) == Dyadic(-1, 0)


@given(st.lists(FLOATS, min_size=1, max_size=20), FLOATS)
def test_translations_alone_are_exact_whatever_they_are(steps: list[float], start: float) -> None:
    here = Dyadic.of(start)
    for step in steps:
        here = here.plus(Dyadic.of(step))
    assert exact(here) == Fraction(start) + sum(map(Fraction, steps))


@given(st.lists(st.tuples(st.one_of(st.just(1.0), st.floats(0.01, 100.0)), st.tuples(FLOATS, FLOATS)), max_size=20), st.integers(0, 200))
def test_many_steps_at_once_are_the_same_as_one_by_one(steps: list[tuple[float, tuple[float, float]]], scales: int) -> None:
    """Also where numbers are cut to so many bits, which depends on the order of what is done to them."""
    every = [*[(1.0 / 3.0, (0.0, 0.0))] * scales, *((factor, (0.0, 0.0) if factor != 1.0 else offset) for factor, offset in steps)]
    here = Affine.identity(2)
    for factor, offset in every:
        here = here.scaled(factor) if factor != 1.0 else here.translated(offset)
    at_once = Affine.identity(2).carried_on(every)
    assert (at_once, at_once.exact) == (here, here.exact)
    assert Affine.identity(2).carried_on(()) == Affine.identity(2)


def test_ten_thousand_scales_are_no_longer_than_a_hundred() -> None:
    transform = Affine.identity(3).translated((0.1, 0.2, 0.3))
    for step in range(10_000):
        transform = transform.scaled(1.1 if step % 2 else 1 / 1.1)
    assert all(part.numerator.bit_length() <= BITS_MAX for part in transform.exact)
    assert transform.translated((1e15,) * 3).translated((-1e15,) * 3) == transform
    assert transform.scaled(2.0**-40).scaled(2.0**40) == transform
