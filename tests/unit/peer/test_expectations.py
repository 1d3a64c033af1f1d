"""If this fails, a node stores a write over something that its writer did not expect there, whoever offers it, and how often."""

from __future__ import annotations

import random
from dataclasses import replace

import pytest

from scenefold.base.location import Location
from scenefold.base.reasons import RejectReason
from scenefold.crypto import EXPECTS_ANYTHING, EXPECTS_NOTHING, RecordHeader, version_key
from scenefold.wire import AcceptData, GetMany, GetManyReply, ProposeData, PutItem, PutMany, PutManyReply, RecordKey, RejectData
from unit.peer.data_nodes import LEFT, SCENE, Neighbours, Node, item, managed_item, with_nodes
from unit.peer.scenes_made import SPACE

SEEDS = range(12)
STEPS = 60
PLACES = 3
OBJECT = bytes(15) + b"\x01"
NOWHERE = b"\x01" * 32


async def put(node: Node, offered: PutItem, *, alone: bool) -> int:
    """By packet 10 or by 32: the reason, or 0."""
    if alone:
        fields = offered.scene, offered.space, offered.location, offered.signature, offered.header, offered.ciphertext
        reply = await node.ask(ProposeData(*fields))
        assert isinstance(reply, AcceptData | RejectData)
        return 0 if isinstance(reply, AcceptData) else reply.reason
    reply = await node.ask(PutMany((offered,)))
    assert isinstance(reply, PutManyReply)
    return reply.outcomes[0].reason


async def there(node: Node, key: RecordKey) -> RecordHeader | None:
    reply = await node.ask(GetMany(SCENE.scene, 1, (key,)))
    assert isinstance(reply, GetManyReply)
    (found,) = reply.records
    return None if found is None else RecordHeader.decode(found.header)


def allows(new: RecordHeader, present: RecordHeader | None) -> bool:
    """As the specification says."""
    if new == present:
        return True
    wanted = {EXPECTS_ANYTHING, EXPECTS_NOTHING if present is None else present.digest}
    return new.expects in wanted and (present is None or version_key(new) > version_key(present))


@pytest.mark.parametrize("seed", SEEDS)
def test_a_node_stores_nothing_over_what_the_header_does_not_expect(seed: int) -> None:
    """What was offered before is offered again, by anybody, and with what it expects cut out or exchanged."""
    dice = random.Random(seed)

    def made(number: int, seq: int, expects: bytes) -> PutItem:
        return managed_item(OBJECT, seq=seq, expects=expects) if number == PLACES else item(number, seq=seq, expects=expects)

    async def test(_: Neighbours, node: Node) -> None:
        offered: list[tuple[int, PutItem]] = []
        refused = 0
        for step in range(STEPS):
            number = dice.randint(0, PLACES)
            place = Location.from_number(number)
            key = RecordKey(SPACE, place, OBJECT) if number == PLACES else RecordKey(SPACE, place)
            present = await there(node, key)
            if offered and dice.random() < 0.5:
                again, new = dice.choice(offered)
                if again != number:
                    continue
            else:
                digests = [EXPECTS_ANYTHING, EXPECTS_NOTHING, NOWHERE, present.digest if present else NOWHERE]
                new = made(number, step + 1 - dice.randrange(5) % (step + 1), dice.choice(digests))
                offered.append((number, new))
            header = RecordHeader.decode(new.header)
            other = dice.choice([EXPECTS_ANYTHING, EXPECTS_NOTHING, present.digest if present else NOWHERE])
            if other != header.expects:
                bent = replace(new, header=header._replace(expects=other).encode())
                assert await put(node, bent, alone=dice.random() < 0.5) == RejectReason.SIGNATURE_INVALID
            reason = await put(node, new, alone=dice.random() < 0.5)
            assert reason == (0 if allows(header, present) else RejectReason.STALE_VERSION)
            assert await there(node, key) == (header if reason == 0 else present)
            refused += reason != 0
        assert refused

    with_nodes(test, LEFT)
