"""If one fails, headers of scenes of before there were purges have other bytes than were signed, or one header has two forms."""

from __future__ import annotations

from dataclasses import replace

import msgpack
import pytest

from scenefold.wire import MalformedPacket, SceneLogPublic
from scenefold.wire.scene_headers import SCENE_LOG_PUBLIC
from unit.peer.scenes_made import first_header

HEADER = first_header()
FIELDS = len(SCENE_LOG_PUBLIC.fields)


def plain_of(header: SceneLogPublic) -> list[object]:
    plain: list[object] = msgpack.unpackb(header.encode())
    return plain


def test_a_header_of_which_nothing_was_purged_is_as_it_was_before_there_was_the_field() -> None:
    assert HEADER.purged == 0
    assert len(plain_of(HEADER)) == FIELDS - 1
    assert SceneLogPublic.decode(HEADER.encode()) == HEADER


@pytest.mark.parametrize("purged", [1, 127, 1 << 40, 2**64 - 1])
def test_where_a_purge_began_comes_last_and_is_signed(purged: int) -> None:
    header = replace(HEADER, purged=purged)
    plain = plain_of(header)
    assert (len(plain), plain[-1], plain[:-1]) == (FIELDS, purged, plain_of(HEADER))
    assert SceneLogPublic.decode(header.encode()) == header
    assert header.signable() != HEADER.signable()


@pytest.mark.parametrize(
    "plain",
    [
        [*plain_of(HEADER), 0],
        [*plain_of(HEADER), None],
        [*plain_of(HEADER), 1, 1],
        plain_of(HEADER)[:-1],
    ],
    ids=["the value that is left out", "nil", "one field more", "one field less"],
)
def test_any_other_form_is_refused(plain: list[object]) -> None:
    with pytest.raises(MalformedPacket):
        SceneLogPublic.decode(msgpack.packb(plain))
