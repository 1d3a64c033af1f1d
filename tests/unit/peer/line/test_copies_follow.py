"""If one fails, a piece changes hands, or a node crashes, and nobody knows any more who holds copies of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import pytest
import trio

from scenefold.base.errors import DamagedData, PeerFault, Refused, Unreachable
from scenefold.base.location import Arc, Location
from scenefold.base.placement import Layout
from scenefold.peer.copies.copies import Copies, Passing
from scenefold.peer.copies.copies_note import check_copies, decode_copies, encode_copies
from scenefold.peer.copies.telling import claim_of
from scenefold.peer.line import Side
from scenefold.peer.line.holding import Holding
from scenefold.store.holding import COPIES_KEY
from scenefold.store.layout import HOLDING
from scenefold.wire import ClaimRange, Configuration, Member, PassedSegment
from scenefold.world import DiskFailed
from scenefold.world.sim import Point
from unit.peer.line.street import House, Street, places
from unit.peer.line.test_crashes import crash_everywhere, end_of, play

LAYOUT: Layout = (Location.from_number(1 << 158), Location.from_number(1 << 159))
SAMPLES = 8
GIVER, RECEIVER, HOLDER = 0, 1, 2
STREET = {"founders": 3}


@pytest.fixture(autouse=True)
def quiet(caplog: pytest.LogCaptureFixture) -> Iterator[None]:
    """Who lives complains about who crashed."""
    with caplog.at_level("ERROR", "scenefold"):
        yield


def durable(house: House) -> Copies | None:
    note, member = house._kept(HOLDING, COPIES_KEY), house.durable_member()
    return None if note is None or member is None else decode_copies(note, member)


async def configured(house: House, holder: Member) -> list[Location]:
    """Make `holder` answer for all of a node's arc, as if it had everything; places of that arc, none if that failed."""
    while house.line is None or house.line.arc is None:  # noqa: ASYNC110 - it is a matter of a restart
        await trio.sleep(0.1)

    def configure(copies: Copies, holding: Holding) -> Copies:
        assert holding.arc is not None
        found = copies.configurations.place(LAYOUT, [(holding.arc, (holder,))], 2)
        for word in found.untold():
            found = found.confirm(word)
            for entry in word.entries:
                found = found.compare(holder, entry)
        found = found.activate(lambda _: ())
        return Copies(found, copies.custody, copies.passing, copies.unrecovered)

    spots = places(house.line.arc, SAMPLES)
    try:
        await house.line.parts.keeper.change_copies(configure)
    except (Refused, DiskFailed):
        return []  # It has crashed, so nothing was configured, or nobody was told.
    return spots


async def passing_right(street: Street) -> None:
    """The giver's arc has copies at the holder; half of it goes to the receiver. Whoever owns a place then knows of them."""
    giver, holder = street.houses[GIVER], street.houses[HOLDER].durable_member()
    assert holder is not None
    spots: list[Location] = []
    with trio.move_on_after(60.0):
        spots = await configured(giver, holder)
        await trio.sleep(11.0)
        while giver.line is None or giver.line.arc is None:  # noqa: ASYNC110 - as above
            await trio.sleep(0.1)
        try:
            await giver.line.give(Side.RIGHT, end_of(giver.line.arc, Side.RIGHT, 0.5), why="a test")
        except (Refused, Unreachable, PeerFault):
            spots = spots[:]  # What became of it the disks say.
    await street.until_whole()
    for house in street.houses:
        await house.up.wait()
        assert house.line is not None
        kept = house.line.parts.keeper
        assert durable(house) in (kept.copies, None)
        owned = [spot for spot in spots if kept.holding.owns(spot)]
        for spot in owned:
            segment = kept.copies.configurations.at(LAYOUT, spot)
            assert segment is not None, f"{house.number} does not know who has copies of what it owns"
            assert any(holder in found.members for found in segment.configurations)
        if spots:
            assert len(kept.copies.configurations.segments) == (1 if owned else 0), "nobody keeps what is another's"
        assert not kept.copies.passing


def test_who_holds_copies_passes_with_a_piece() -> None:
    play(passing_right, **STREET)


@pytest.mark.parametrize("point", list(Point))
@pytest.mark.parametrize("number", [GIVER, RECEIVER])
def test_a_crash_at_every_step(number: int, point: Point) -> None:
    assert crash_everywhere(passing_right, number, point, **STREET) >= 3


def test_a_number_that_nobody_can_have_come_to_is_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    """A liar's claim would leave no numbers to those who come after it."""
    claims: list[ClaimRange] = []

    def lying(handover: bytes, piece: Arc, _passing: object) -> ClaimRange:
        claims.append(ClaimRange(handover, piece.first, piece.last, 2**64 - 1 if len(claims) < 3 else 0))
        return claims[-1]

    async def story(street: Street) -> None:
        giver, receiver = street.houses[GIVER], street.houses[RECEIVER]
        await trio.sleep(11.0)
        assert giver.line is not None
        assert giver.line.arc is not None
        await giver.line.give(Side.RIGHT, end_of(giver.line.arc, Side.RIGHT, 0.5), why="a test")
        assert receiver.line is not None
        assert receiver.line.parts.keeper.copies.configurations.number < 10
        assert receiver.line.events["taken"] == 1

    monkeypatch.setattr("scenefold.peer.line.giving.claim_of", lying)
    play(story, **STREET)
    assert len(claims) == 4


def test_a_claim_with_a_configuration_above_its_number_is_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its receiver would write down what it could not read at its next start."""
    claims: list[ClaimRange] = []

    def lying(handover: bytes, piece: Arc, passing: Passing | None) -> ClaimRange:
        told = claim_of(handover, piece, passing)
        layout, members = (Location.from_number(7), Location.from_number(8)), (Member(7, b"i" * 16), Member(8, b"j" * 16))
        above = PassedSegment(layout, piece.first, piece.last, (Configuration(told.number + 1, members, 2),), ())
        claims.append(replace(told, segments=(above,)) if len(claims) < 3 else told)
        return claims[-1]

    async def story(street: Street) -> None:
        giver, receiver = street.houses[GIVER], street.houses[RECEIVER]
        await trio.sleep(11.0)
        assert giver.line is not None and giver.line.arc is not None and receiver.line is not None
        await giver.line.give(Side.RIGHT, end_of(giver.line.arc, Side.RIGHT, 0.5), why="a test")
        copies = receiver.line.parts.keeper.copies
        check_copies(copies)
        assert decode_copies(encode_copies(copies), copies.configurations.me) == copies
        assert receiver.line.events["taken"] == 1

    monkeypatch.setattr("scenefold.peer.line.giving.claim_of", lying)
    play(story, **STREET)
    assert len(claims) == 4


def test_a_damaged_note_about_copies_ends_the_node() -> None:
    member = Member(7, b"i" * 16)
    with pytest.raises(DamagedData, match="about copies is damaged"):
        decode_copies(b"\xc0", member)
