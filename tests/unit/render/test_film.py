"""If this fails, an image depends on the order in which its passes came, or a foreign film corrupts ours."""

from __future__ import annotations

import hashlib
import struct
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenefold.base.errors import PeerFault
from scenefold.render import film as film_module
from scenefold.render.developing import develop
from scenefold.render.film import Film
from scenefold.render.film_kernels import add_rows_of_film
from scenefold.render.generate_kernels import scattering_stride
from scenefold.render.layers import BESIDE, USUAL, Pixels
from scenefold.render.pass_sums import PassSums, packed_bytes
from scenefold.render.sum_columns import ALL_AOVS, FULL, HIT, MATERIAL, OBJECT, PLAIN, SumColumns

naturals = st.integers(0, 2**62)
columns = pytest.mark.parametrize("columns", [PLAIN, FULL, SumColumns(3, 13), SumColumns(9, 8)], ids=["plain", "full", "features", "parts"])
BOX = (np.array([-1.0, 0.0, 2.0]), np.array([2.0, 4.0, 14.0]))
"""Its diagonal is 13."""


def number_of(high: Any, low: Any) -> int:
    return (int(high) << 64) + int(low)


def sums(paths: int, seed: int, largest: int = 2**40, kinds: SumColumns = PLAIN) -> PassSums:
    """A pass with something in it."""
    random = np.random.default_rng(seed)
    made = PassSums.zeros(paths, kinds)
    made.radiance[:] = random.integers(0, largest, made.radiance.shape) * (random.random((paths, 1)) < 0.7)
    made.aovs[:] = random.integers(-(2**24), 2**24, made.aovs.shape)
    made.aovs[:, OBJECT:] = random.integers(0, 9, made.aovs[:, OBJECT:].shape)
    made.aovs[:, HIT] = random.random(paths) < 0.8
    made.aovs[made.aovs[:, HIT] == 0] = 0
    return made


def layers_of(film: Film) -> dict[str, Pixels]:
    """All that this film can give."""
    return develop(film, BESIDE if film.rows.columns == FULL else (*USUAL, "samples", "variance"), BOX)


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
        squares[pixel] += int(min(real * real, 2.0**48) * 2**32 + 0.5)
        counts[pixel] += 1
    rows, order = film.rows, [row * stride % pixels for row in range(pixels)]
    assert [number_of(rows.high[row, 0], rows.low[row, 0]) for row in range(pixels)] == [total[pixel] for pixel in order]
    assert [number_of(rows.square_high[row, 0], rows.square_low[row, 0]) for row in range(pixels)] == [squares[pixel] for pixel in order]
    layers = layers_of(film)
    assert layers["samples"].ravel().tolist() == counts
    beauty = layers["beauty"][0, :, 0]
    assert beauty == pytest.approx([value / 2**32 / max(count, 1) for value, count in zip(total, counts, strict=True)], rel=1e-6)


@given(st.lists(st.integers(-(2**63), 2**63 - 1), min_size=1, max_size=8), st.integers(0, 8))
def test_limbs_carry_and_borrow_like_whole_numbers(values: list[int], cut: int) -> None:
    """Paths of a single pixel, and then films of it: carries are of both kinds."""
    film, other = Film(1, 1), Film(1, 1)
    for number, value in enumerate(values):
        passed = PassSums.zeros(1)
        passed.radiance[0] = value, 0, -(value // 2)
        (film if number < cut else other).add(passed, number, 1)
    film.merge_part(0, next(other.parts()))
    rows = film.rows
    assert number_of(rows.high[0, 0], rows.low[0, 0]) == sum(values)
    assert number_of(rows.high[0, 2], rows.low[0, 2]) == -sum(value // 2 for value in values)


def same(left: Film, right: Film) -> bool:
    return b"".join(left.parts()) == b"".join(right.parts())


@columns
@settings(max_examples=20, deadline=None)
@given(order=st.permutations(range(6)), cut=st.integers(0, 6))
def test_order_of_passes_and_of_films_is_no_matter(columns: SumColumns, order: list[int], cut: int) -> None:
    """Some nodes close some passes, and films are merged: all the same."""
    stride, size = scattering_stride(70), 35
    straight = Film(10, 7, columns)
    for number in range(6):
        straight.add(sums(size, number, kinds=columns), number * size, stride)
    first, second = Film(10, 7, columns), Film(10, 7, columns)
    for place, number in enumerate(order):
        (first if place < cut else second).add(sums(size, number, kinds=columns), number * size, stride)
    for index, part in enumerate(second.parts()):
        first.merge_part(index, part)
    assert same(first, straight)
    layers, expected = layers_of(first), layers_of(straight)
    assert {name: layer.tobytes() for name, layer in layers.items()} == {name: layer.tobytes() for name, layer in expected.items()}
    assert layers["samples"].tolist() == np.full((7, 10), 3).tolist()


def mixed(count: int, salt: int) -> Any:
    """uint64[count] that look like chance, and are the same for every version of everything."""
    words = (np.arange(count, dtype=np.uint64) + np.uint64(salt)) * np.uint64(0x9E3779B97F4A7C15)
    words = (words ^ (words >> np.uint64(29))) * np.uint64(0xBF58476D1CE4E5B9)
    return words ^ (words >> np.uint64(32))


def test_an_image_has_the_bits_that_it_always_had() -> None:
    """Whatever becomes of a film's memory: forty passes over 207 pixels, radiance up to 2^61, features of both signs."""
    film, paths = Film(23, 9), 1000
    for number in range(40):
        salt, passed = number * 100_003, PassSums.zeros(paths)
        passed.radiance[:] = (mixed(3 * paths, salt) >> np.uint64(3)).astype(np.int64).reshape(-1, 3)
        passed.radiance[mixed(paths, salt + 7) % np.uint64(3) == 0] = 0
        passed.aovs[:] = (mixed(8 * paths, salt + 1) >> np.uint64(34)).astype(np.int64).reshape(-1, 8) - 2**29
        passed.aovs[:, HIT] = mixed(paths, salt + 2) % np.uint64(4) != 0
        passed.aovs[passed.aovs[:, HIT] == 0] = 0
        film.add(passed, number * paths, scattering_stride(207))
    layers = develop(film, USUAL, (np.zeros(3), np.array([7.25, 0.0, 0.0])))
    usual = b"".join(layers[name].tobytes() for name in ("beauty", *USUAL))
    assert hashlib.sha256(usual).hexdigest() == "7d41838811d8f4dabfcc86a900df12edae07c3aa9ddc332f2bfd6d21df01918c"


@columns
def test_films_travel_in_several_parts(columns: SumColumns, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(film_module, "PART_BYTES", 16 * film_module.row_bytes(columns) + 5)
    full, copy = Film(10, 7, columns), Film(10, 7, columns)
    full.add(sums(70, 1, 2**62, columns), 0, scattering_stride(70))
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
    for payload in (b"", part[:-1], part + b"\0", next(Film(4, 5).parts()), next(Film(4, 4, FULL).parts())):
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
    layers = layers_of(film)
    assert layers["beauty"][0, :, 1].tolist() == [2.0, 2.0]
    assert layers["albedo"][0, 0].tolist() == [0.5, 0.0, 0.0]
    assert layers["normal"][0, 0].tolist() == [0.0, 1.0, 0.0]
    assert layers["depth"][0].tolist() == [3.25, np.inf]
    assert (layers["beauty"].dtype, layers["samples"].dtype) == (np.float32, np.uint32)
    expected = [np.var(row) / 3 for row in values]
    assert layers["variance"][0, :, 2] == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("light", [1e-4, 0.01, 1.0, 1e5])
def test_the_variance_of_dim_and_of_bright_light_is_found(light: float) -> None:
    passed, values = PassSums.zeros(64), light * np.random.default_rng(1).uniform(0.5, 1.5, 64)
    passed.radiance[:, 0] = np.round(values * 2**32)
    film = Film(1, 1)
    film.add(passed, 0, 1)
    assert layers_of(film)["variance"][0, 0, 0] == pytest.approx(np.var(values) / 63, rel=1e-2)


@pytest.mark.parametrize("light", [2.0**21, 2.0**22, 2.0**24 - 1])
def test_a_single_bright_dot_is_no_quiet_pixel(light: float) -> None:
    passed = PassSums.zeros(64)
    passed.radiance[7, 0] = round(light * 2**32)
    film = Film(1, 1)
    film.add(passed, 0, 1)
    values = np.zeros(64)
    values[7] = light
    assert layers_of(film)["variance"][0, 0, 0] == pytest.approx(np.var(values) / 63, rel=0.03)


def test_squares_that_do_not_fit_stay_at_the_most_in_any_order() -> None:
    bright = PassSums.zeros(60_000)
    bright.radiance[:, 0] = (2**24 - 1) << 32
    first, second, third = Film(1, 1), Film(1, 1), Film(1, 1)
    for film, times in ((first, 1), (second, 2), (third, 1)):
        for number in range(times):
            film.add(bright, number * 60_000, 1)
    assert first.rows.square_high[0, 0] == second.rows.square_high[0, 0] == 2**31 - 1
    first.rows.words[:] = second.rows.words
    add_rows_of_film(first.rows.words, first.rows.halves, third.rows.words, third.rows.halves, 3, False)
    assert first.rows.square_high[0, 0] == 2**31 - 1 and first.rows.square_low[0, 0] == 2**64 - 1
    assert layers_of(second)["variance"][0, 0, 0] >= 0.0


def test_light_in_parts_adds_up_to_the_beauty_of_light_in_one() -> None:
    parts, whole = sums(700, 5, 2**61, FULL), PassSums.zeros(700)
    whole.radiance[:] = parts.radiance.reshape(-1, 3, 3).sum(axis=1)
    in_parts, in_one, stride = Film(10, 7, FULL), Film(10, 7), scattering_stride(70)
    in_parts.add(parts, 0, stride)
    in_one.add(whole, 0, stride)
    layers, expected = layers_of(in_parts), layers_of(in_one)
    assert layers["beauty"].tobytes() == expected["beauty"].tobytes()
    assert layers["variance"].tobytes() == expected["variance"].tobytes()
    assert layers["emission"] + layers["direct"] + layers["indirect"] == pytest.approx(layers["beauty"], rel=1e-6)


def test_a_pixel_shows_what_its_first_sample_that_hit_has_hit() -> None:
    """Whichever pass is closed first: here the passes are single samples of one pixel, 0 missing everything."""
    found = {1: (7, 3), 2: (0, 0), 3: (5, 1)}
    for order in ((0, 1, 2, 3), (3, 2, 1, 0), (2, 0, 3, 1)):
        film, other = Film(1, 1, FULL), Film(1, 1, FULL)
        for sample in order:
            passed = PassSums.zeros(1, FULL)
            if sample in found:
                passed.aovs[0, HIT], passed.aovs[0, [OBJECT, MATERIAL]] = 1, found[sample]
                passed.aovs[0, 8:11] = 2**23, 0, 2**24
            (film if sample % 2 else other).add(passed, sample, 1)
        nothing = layers_of(Film(1, 1, FULL))
        film.merge_part(0, next(other.parts()))
        layers = layers_of(film)
        assert (int(layers["object_id"][0, 0]), int(layers["material_id"][0, 0])) == (8, 4), "numbers from 1 on"
        assert layers["position"][0, 0].tolist() == [0.5, 0.0, 14.0]
        assert (int(nothing["object_id"][0, 0]), int(nothing["material_id"][0, 0])) == (0, 0)
        assert np.isinf(nothing["position"]).all()


# Sums of one pass on their way ---------------------------------------------------------------------------


@columns
def test_sums_of_a_pass_round_trip_and_add_up(columns: SumColumns) -> None:
    ours, theirs, both = sums(300, 1, kinds=columns), sums(300, 2, kinds=columns), sums(300, 1, kinds=columns)
    # A path has one first hit, on one node.
    theirs.aovs[ours.aovs[:, HIT] != 0] = 0
    ours.counters[:], theirs.counters[:] = (1, 2, 3), (10, 20, 30)
    both.add(theirs)
    ours.add_bytes(theirs.to_bytes())
    assert np.array_equal(ours.radiance, both.radiance)
    assert np.array_equal(ours.aovs, both.aovs)
    assert ours.counters.tolist() == [11, 22, 33]
    empty = PassSums.zeros(300, columns)
    assert len(empty.to_bytes()) == packed_bytes(columns, 0, 0) == 8 + 24
    empty.add_bytes(PassSums.zeros(300, columns).to_bytes())
    assert not empty.radiance.any()


def test_the_largest_pass_fits_its_numbers() -> None:
    full = PassSums.zeros(65_536, FULL)
    full.radiance[:], full.aovs[:, HIT] = 5, 1
    copy = PassSums.zeros(65_536, FULL)
    payload = full.to_bytes()
    assert len(payload) == packed_bytes(FULL, 65_536, 65_536)
    copy.add_bytes(payload)
    assert copy.radiance[-1].tolist() == [5] * 9
    assert copy.aovs[-1].tolist() == [0] * HIT + [1] + [0] * (ALL_AOVS - HIT - 1)


def packed(lit: list[int], seen: list[int], tail: bytes = b"") -> bytes:
    rows = bytes(24 * len(lit)) + bytes(28 * len(seen))
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
