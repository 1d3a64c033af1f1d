"""If this fails, what arrives over TLS is read in another order, in part or twice, or a broken connection passes for one that ended."""

from __future__ import annotations

import ssl
from concurrent.futures import ThreadPoolExecutor

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.crypto import client_context, server_context
from scenefold.crypto.tls_reading import LUMP_BYTES_MAX
from unit.crypto.test_tls import AUTHORITY, NODE, USER

RECORD_BYTES = 16 * 1024


class Pair:
    """Two ends in memory, after their handshake; what one writes waits until it is carried over."""

    def __init__(self) -> None:
        self.to_far, to_near, self.near_out, far_out = (ssl.MemoryBIO() for _ in range(4))
        self.near = client_context(USER, AUTHORITY.certificate).wrap_bio(to_near, self.near_out, server_hostname="127.0.0.2")
        self.far = server_context(NODE, AUTHORITY.certificate).wrap_bio(self.to_far, far_out, server_side=True)
        waiting = [self.near, self.far]
        while waiting:
            for side in list(waiting):
                try:
                    side.do_handshake()
                    waiting.remove(side)
                except ssl.SSLWantReadError:
                    pass
            self.to_far.write(self.near_out.read())
            to_near.write(far_out.read())


@given(sizes=st.lists(st.integers(1, 3 * RECORD_BYTES), min_size=1, max_size=6), most=st.integers(1, 4 * RECORD_BYTES), cut=st.integers(0))
def test_all_that_is_here_is_read_in_order(sizes: list[int], most: int, cut: int) -> None:
    pair = Pair()
    sent = b"".join(bytes([index]) * size for index, size in enumerate(sizes))
    for index, size in enumerate(sizes):
        pair.near.write(bytes([index]) * size)
    wire, read = pair.near_out.read(), b""
    for part in (wire[: cut % len(wire)], wire[cut % len(wire) :]):
        pair.to_far.write(part)
        read += _all_here(pair.far, most)
    assert read == sent


def _all_here(end: ssl.SSLObject, most: int) -> bytes:
    pieces: list[bytes] = []
    try:
        while True:
            pieces.append(end.read(most))
            assert 0 < len(pieces[-1]) <= most
    except ssl.SSLWantReadError:
        # Only the last one is less than was asked for.
        assert all(len(piece) == most for piece in pieces[:-1])
    return b"".join(pieces)


def test_several_records_are_one_reading() -> None:
    pair = Pair()
    pair.near.write(bytes(4 * RECORD_BYTES))
    pair.to_far.write(pair.near_out.read())
    assert len(pair.far.read(1 << 20)) == 4 * RECORD_BYTES


def test_what_is_more_than_a_lump_comes_in_lumps() -> None:
    pair = Pair()
    sent = bytes(range(256)) * (LUMP_BYTES_MAX // 256 + 40)
    pair.near.write(sent)
    pair.to_far.write(pair.near_out.read())
    first, rest = pair.far.read(1 << 20), pair.far.read(1 << 20)
    assert (len(first), first + rest) == (LUMP_BYTES_MAX, sent)


def test_threads_read_apart() -> None:
    pairs = [Pair() for _ in range(4)]

    def read(number: int) -> None:
        for _ in range(50):
            pairs[number].near.write(bytes([number]) * RECORD_BYTES * 2)
            pairs[number].to_far.write(pairs[number].near_out.read())
            assert pairs[number].far.read(1 << 20) == bytes([number]) * RECORD_BYTES * 2

    with ThreadPoolExecutor(len(pairs)) as threads:
        assert list(threads.map(read, range(len(pairs)))) == [None] * len(pairs)


def test_what_came_before_a_forged_record_is_given_and_then_the_error_for_ever() -> None:
    pair = Pair()
    pair.near.write(b"sound")
    pair.to_far.write(pair.near_out.read())
    pair.near.write(b"forged")
    wire = bytearray(pair.near_out.read())
    wire[-1] ^= 1
    pair.to_far.write(wire)
    assert pair.far.read(100) == b"sound"
    for _ in range(2):
        with pytest.raises(ssl.SSLError) as raised:
            pair.far.read(100)
        assert not isinstance(raised.value, ssl.SSLWantReadError)


def test_an_end_is_an_end_behind_what_came_before_it() -> None:
    pair = Pair()
    pair.near.write(b"last words")
    with pytest.raises(ssl.SSLWantReadError):
        pair.near.unwrap()
    pair.to_far.write(pair.near_out.read())
    assert pair.far.read(100) == b"last words"
    assert _ended(pair) and _ended(pair)
    cut = Pair()
    cut.near.write(b"cut")
    cut.to_far.write(cut.near_out.read())
    cut.to_far.write_eof()
    assert cut.far.read(100) == b"cut"
    with pytest.raises(ssl.SSLEOFError):
        cut.far.read(100)


def _ended(pair: Pair) -> bool:
    """As `ssl` tells of an orderly end."""
    try:
        return not pair.far.read(100)
    except ssl.SSLZeroReturnError:
        return True
