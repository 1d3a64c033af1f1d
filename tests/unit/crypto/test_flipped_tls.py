"""If this fails, a bit that was changed on the wire reaches whoever listens on a TLS connection."""

from __future__ import annotations

import ssl
from random import Random

import pytest

from scenefold.crypto import Authority, client_context, server_context

ADDRESS = "127.0.0.2"
AUTHORITY = Authority.create("test")
CLIENT = client_context(AUTHORITY.issue("user:ada", []), AUTHORITY.certificate)
SERVER = server_context(AUTHORITY.issue("node:2130706434", [ADDRESS]), AUTHORITY.certificate)
SECRET = b"nobody may see this"
FLIPS = 5_000
PARTS = 4


class Pair:
    """Two ends in memory after their handshake, and what is on its way from one to the other."""

    def __init__(self) -> None:
        self.to_server, self.to_client = ssl.MemoryBIO(), ssl.MemoryBIO()
        self.client = CLIENT.wrap_bio(self.to_client, self.to_server, server_hostname=ADDRESS)
        self.server = SERVER.wrap_bio(self.to_server, self.to_client, server_side=True)
        waiting = [self.client, self.server]
        while waiting:
            waiting = [side for side in waiting if not _is_done(side)]
        for source, target in ((self.client, self.server), (self.server, self.client)):
            source.write(b"hello")
            assert target.read(100) == b"hello"

    def sent(self, *, to_server: bool, data: bytes) -> tuple[bytes, ssl.SSLObject, ssl.MemoryBIO]:
        """The record of `data` as it is on the wire, who is to read it, and where it goes in."""
        source, target, wire = (self.client, self.server, self.to_server) if to_server else (self.server, self.client, self.to_client)
        source.write(data)
        return wire.read(), target, wire


def _is_done(side: ssl.SSLObject) -> bool:
    try:
        side.do_handshake()
    except ssl.SSLWantReadError:
        return False
    return True


def check_refused(target: ssl.SSLObject, wire: ssl.MemoryBIO, record: bytes, bit: int) -> None:
    """The end that gets the changed record delivers nothing, then or later, and the connection is over."""
    changed = bytearray(record)
    changed[bit // 8] ^= 1 << bit % 8
    wire.write(bytes(changed))
    wire.write_eof()
    with pytest.raises(ssl.SSLError) as caught:
        raise AssertionError(f"{target.read(100_000)!r} was delivered")
    assert not isinstance(caught.value, ssl.SSLWantReadError) and "nobody" not in str(caught.value)
    with pytest.raises(ssl.SSLError):
        raise AssertionError(f"{target.read(100_000)!r} was delivered")


def test_every_bit_of_a_small_record_is_guarded() -> None:
    length = len(Pair().sent(to_server=True, data=SECRET)[0])
    assert length == 5 + len(SECRET) + 1 + 16
    for bit in range(8 * length):
        record, target, wire = Pair().sent(to_server=True, data=SECRET)
        check_refused(target, wire, record, bit)


@pytest.mark.parametrize("part", range(PARTS))
def test_random_bits_of_random_records_in_both_directions_are_guarded(part: int) -> None:
    """Both ends of a pair get one, since the handshake is what takes the time."""
    dice = Random(part)
    for _ in range(FLIPS // PARTS // 2):
        pair = Pair()
        sent = [pair.sent(to_server=to_server, data=SECRET + dice.randbytes(dice.randrange(3_000))) for to_server in (True, False)]
        for record, target, wire in sent:
            check_refused(target, wire, record, dice.randrange(8 * len(record)))


def test_an_unchanged_record_is_delivered() -> None:
    record, target, wire = Pair().sent(to_server=True, data=SECRET)
    wire.write(record)
    assert target.read(100) == SECRET
