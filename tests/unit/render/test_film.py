"""If this fails, an image depends on the order in which its passes came, or a foreign film corrupts ours."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenefold.base.errors import PeerFault
from scenefold.render import film as film_module
from scenefold.render.film import Film
from scenefold.render.film_kernels import add_limbs
from scenefold.render.generate_kernels import scattering_stride
from scenefold.render.pass_sums import PassSums

words = st.integers(-(2**63), 2**63 - 1)
naturals = st.integers(0, 2**62)


def limbs_of(values: list[int]) -> tuple[Any, Any]:
    """128-bit numbers as kernels have them, [n, 3] with two columns unused."""
    high, low = np.zeros((len(values), 3), np.int64), np.zeros((len(values), 3), np.uint64)
    high[:, 0], low[:, 0] = [value >> 64 for value in values], [value & (2**64 - 1) for value in values]
    return high, low


def number_of(high: Any, low: Any, row: int) -> int:
    return (int(high[row, 0]) << 64) + int(low[row, 0])


@given(st.lists(st.tuples(st.integers(-(2**126), 2**126 - 1), st.integers(-(2**126), 2**126 - 1)), min_size=1, max_size=8))
def test_two_limbs_add_like_whole_numbers(pairs: list[tuple[int, int]]) -> None:
    high, low = limbs_of([a for a, _ in pairs])
    add_limbs(high, low, *limbs_of([b for _, b in pairs]))
    assert [number_of(high, low, row) for row in range(len(pairs))] == [a + b for a, b in pairs]


def sums(paths: int, seed: int, largest: int = 2**40) -> PassSums:
    """A pass with something in it."""
    random = np.random.default_rng(seed)
    made = PassSums.zeros(paths)
    made.radiance[:] = random.integers(0, largest, made.radiance.shape) * (random.random((paths, 1)) < 0.7)
    made.aovs[:] = random.integers(-(2**24), 2**24, made.aovs.shape)
    made.aovs[:, 7] = random.random(paths) < 0.8
    made.aovs[made.aovs[:, 7] == 0] = 0
    return made


@settings(max_examples=50)
@given(st.lists(naturals, min_size=1, max_size=12), st.integers(1, 5))
def test_sums_and_squares_are_those_of_whole_numbers(values: list[int], pixels: int) -> None:
    passed = PassSums.zeros(len(values))
    passed.radiance[:, 0] = values
    film, stride = Film(pixels, 1), scattering_stride(pixels)
    film.add(passed, 0, stride)
    total, squares, counts = [0] * pixels, [0] * pixels, [0] * pixels
    for path, value in enumerate(values):
        pixel = path % pixels * stride % pixels
        total[pixel] += value
        real = float(value) / 2**32
        squares[pixel] += int(min(real * real * 65536 + 0.5, 9e18))
        counts[pixel] += 1
    assert [number_of(film._high, film._low, pixel) for pixel in range(pixels)] == total
    assert [number_of(film._square_high, film._square_low, pixel) for pixel in range(pixels)] == squares
    assert film.samples.ravel().tolist() == counts
    beauty = film.layers(1.0)["beauty"][0, :, 0]
    assert beauty == pytest.approx([value / 2**32 / max(count, 1) for value, count in zip(total, counts, strict=True)], rel=1e-6)


def same(left: Film, right: Film) -> bool:
    return b"".join(left.parts()) == b"".join(right.parts())


@settings(max_examples=20, deadline=None)
@given(st.permutations(range(6)), st.integers(0, 6))
def test_order_of_passes_and_of_films_is_no_matter(order: list[int], cut: int) -> None:
    """Some nodes close some passes, and films are merged: all the same."""
    stride, size = scattering_stride(70), 35
    straight = Film(10, 7)
    for number in range(6):
        straight.add(sums(size, number), number * size, stride)
    first, second = Film(10, 7), Film(10, 7)
    for place, number in enumerate(order):
        (first if place < cut else second).add(sums(size, number), number * size, stride)
    for index, part in enumerate(second.parts()):
        first.merge_part(index, part)
    assert same(first, straight)
    assert first.layers(3.0)["beauty"].tobytes() == straight.layers(3.0)["beauty"].tobytes()
    assert first.samples.tolist() == np.full((7, 10), 3).tolist()


def test_films_travel_in_several_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(film_module, "PART_PIXELS", 16)
    full, copy = Film(10, 7), Film(10, 7)
    full.add(sums(70, 1, 2**62), 0, scattering_stride(70))
    parts = list(full.parts())
    assert len(parts) == full.part_count == 5
    for index in (3, 0, 4, 1, 2):
        copy.merge_part(index, parts[index])
    assert same(copy, full)


@pytest.mark.parametrize("index", [-1, 1, 2**31])
def test_parts_that_are_not_there_are_refused(index: int) -> None:
    film = Film(4, 4)
    part = next(film.parts())
    with pytest.raises(PeerFault):
        film.merge_part(index, part)


def test_parts_of_another_size_are_refused_and_leave_no_trace() -> None:
    film, part = Film(4, 4), next(Film(4, 4).parts())
    for payload in (b"", part[:-1], part + b"\0", next(Film(4, 5).parts())):
        with pytest.raises(PeerFault, match="size"):
            film.merge_part(0, payload)
    assert same(film, Film(4, 4))


def test_layers_and_variance() -> None:
    film = Film(2, 1)
    passed = PassSums.zeros(8)
    stride = scattering_stride(2)
    values = [[1.0, 3.0, 2.0, 2.0], [0.0, 4.0, 0.0, 4.0]]
    for path in range(8):
        pixel = path % 2 * stride % 2
        passed.radiance[path] = int(values[pixel][path // 2] * 2**32)
        if pixel == 0:
            passed.aovs[path] = [2**23, 0, 0, 0, 2**24, 0, 2**22, 1]
    film.add(passed, 0, stride)
    layers = film.layers(10.0)
    assert layers["beauty"][0, :, 1].tolist() == [2.0, 2.0]
    assert layers["albedo"][0, 0].tolist() == [0.5, 0.0, 0.0]
    assert layers["normal"][0, 0].tolist() == [0.0, 1.0, 0.0]
    assert layers["depth"][0].tolist() == [2.5, np.inf]
    expected = [np.var(row) / 3 for row in values]
    assert film.variance()[0, :, 2] == pytest.approx(expected, rel=1e-4)


# Sums of one pass on their way ---------------------------------------------------------------------------


def test_sums_of_a_pass_round_trip_and_add_up() -> None:
    ours, theirs, both = sums(300, 1), sums(300, 2), sums(300, 1)
    ours.counters[:], theirs.counters[:] = (1, 2, 3), (10, 20, 30)
    both.add(theirs)
    ours.add_bytes(theirs.to_bytes())
    assert np.array_equal(ours.radiance, both.radiance)
    assert np.array_equal(ours.aovs, both.aovs)
    assert ours.counters.tolist() == [11, 22, 33]
    empty = PassSums.zeros(300)
    assert len(empty.to_bytes()) == 8 + 24
    empty.add_bytes(PassSums.zeros(300).to_bytes())
    assert not empty.radiance.any()


def test_the_largest_pass_fits_its_numbers() -> None:
    full = PassSums.zeros(65_536)
    full.radiance[-1], full.aovs[-1, 7] = 5, 1
    copy = PassSums.zeros(65_536)
    copy.add_bytes(full.to_bytes())
    assert copy.radiance[-1].tolist() == [5, 5, 5]
    assert copy.aovs[-1, 7] == 1


def packed(lit: list[int], seen: list[int], tail: bytes = b"") -> bytes:
    rows = bytes(24 * len(lit)) + bytes(32 * len(seen))
    numbers = b"".join(number.to_bytes(2, "little") for number in [*lit, *seen])
    return struct.pack("<II3q", len(lit), len(seen), 7, 7, 7) + numbers + rows + tail


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"\xff" * 31,
        packed([0], [1])[:-1],
        packed([0], [1], b"\0"),
        packed([300], []),
        packed([], [65_535]),
        packed([5, 5], []),
        packed([], [7, 3]),
        struct.pack("<II3q", 2**32 - 1, 2**32 - 1, 0, 0, 0),
    ],
    ids=["empty", "cut head", "short", "long", "lit outside", "seen outside", "twice", "falling", "boasting"],
)
def test_ill_formed_sums_are_refused_and_leave_no_trace(payload: bytes) -> None:
    mine = sums(300, 1)
    before = mine.to_bytes()
    with pytest.raises(PeerFault):
        mine.add_bytes(payload)
    assert mine.to_bytes() == before
