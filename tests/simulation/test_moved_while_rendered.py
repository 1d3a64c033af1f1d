"""If this fails, what passes between nodes while a scene is rendered comes changed, or lets an edit of before in again (design scenarios 29 and 35)."""

from __future__ import annotations

import trio

from scenefold.base.location import Arc, Location
from scenefold.base.reasons import RejectReason
from scenefold.client.modes import set_mode
from scenefold.crypto import Record, RecordPlace
from scenefold.peer import NodeContext
from scenefold.peer.line import Side
from scenefold.peer.timing import T_LEASE_S, T_WAIT_S
from scenefold.wire import PutItem, PutMany, PutManyReply, SceneMode, SetMode
from simulation.assembly import Assembly, assembled
from simulation.test_client_participants import Court, held
from simulation.test_editing import got, place
from simulation.test_modes import acting, modes


def as_offered(record: Record) -> PutItem:
    """As its author sent it."""
    header = record.header
    return PutItem(header.scene, header.space, header.location, record.signature, record.header_bytes, record.ciphertext)


def contexts(court: Court) -> list[NodeContext]:
    return [node.context for node in court.cluster.nodes.values() if node.context is not None]


def test_35_a_piece_that_moves_while_the_scene_is_rendered_brings_all_and_takes_no_edit_of_before() -> None:
    async def main(court: Court) -> None:
        await court.create(0, 1, 2)
        where = (await court.hall.info()).locations_of([place(1)])[0]
        spot = RecordPlace(court.scene.id, court.hall.id, where)
        replayed: list[PutItem] = []
        for payload in (b"a chair", b"a table"):
            await court.hall.put(where, payload)
            found = [record for one in contexts(court) if (record := (await one.store.get_many([spot]))[0]) is not None]
            replayed.append(as_offered(found[0]))
        assert (await set_mode(court.scene.access, SceneMode.RENDER)).is_active
        owner = next(one for one in contexts(court) if one.line.owns(where))
        arc = owner.line.arc
        assert arc is not None
        # The part with the record goes to a neighbour that is there.
        side = Side.LEFT if arc.first.number else Side.RIGHT
        middle = Location.from_number(where.number)
        piece = Arc(arc.first, middle) if side is Side.LEFT else Arc(middle, arc.last)
        await owner.line.give(side, piece, why="a test")
        after = next(one for one in contexts(court) if one.line.owns(where))
        assert after.me != owner.me and (await after.store.get_many([spot]))[0] is not None
        assert await got(court, place(1)) == b"a table"
        reply = await after.handlers.handle(PutMany(tuple(replayed)), "user:c")
        assert isinstance(reply, PutManyReply)
        assert [outcome.reason for outcome in reply.outcomes] == [RejectReason.MODE_FORBIDS] * 2
        assert await got(court, place(1)) == b"a table"

    held(3, main)


def test_29_who_was_removed_just_before_a_switch_is_waited_for() -> None:
    """It has a lease, and hears of neither: that all who are left have voted for the switch is no reason to act by it sooner."""

    async def main(them: Assembly) -> None:
        await them.create(0, 1, 2, 3)
        assert await acting(them, 0, 1, 2, 3) == [SceneMode.EDIT] * 4
        # What might have happened before their start is over.
        await trio.sleep(T_WAIT_S)
        gone, left = modes(them, 3), (0, 1, 2)
        them.cluster.net.partition([them.node(slot).address for slot in left], [them.node(3).address])
        cut_at = trio.current_time()
        await them.commits(0, them.removed(3))
        position = await them.commits(0, SetMode(SceneMode.RENDER))
        await them.everybody_at(position, *left)

        def may_still_edit() -> bool:
            return gone.standing.acts_in(them.of(3).world.clock.now()) is SceneMode.EDIT

        assert may_still_edit(), "else there is nothing to wait for"
        while may_still_edit():
            assert not any(modes(them, slot).is_active for slot in left)
            await trio.sleep(0.05)
        assert trio.current_time() - cut_at <= T_LEASE_S
        await them.until(lambda: all(modes(them, slot).is_active for slot in left), T_WAIT_S)
        assert await acting(them, *left) == [SceneMode.RENDER] * 3

    assembled(4, main)
