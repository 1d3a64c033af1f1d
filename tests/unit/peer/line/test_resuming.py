"""If one fails, a handover that a crash has interrupted begins anew: a large piece never gets across a network where nodes restart."""

from __future__ import annotations

from typing import Any

import pytest
import trio

from scenefold.peer.line import Side, copying
from scenefold.wire import CopyRecords
from scenefold.world.sim import run_simulated
from unit.peer.line import street as streets
from unit.peer.line.street import Asker, Street
from unit.peer.line.test_copies import attempt, filled
from unit.peer.line.test_crashes import end_of

RECORDS = 128
PIECE = RECORDS // 2
PART = 4
"""Records of one CopyRecords here, at most."""


@pytest.mark.expect_log("was reset by the peer|the connection was cut|ended")
@pytest.mark.parametrize("parts_before", [1, 5, 12])
@pytest.mark.parametrize("crashes", [0, 1], ids=["giver", "receiver"])
def test_after_a_crash_in_the_midst_of_copying_only_what_is_lacking_is_sent(
    monkeypatch: pytest.MonkeyPatch, crashes: int, parts_before: int
) -> None:
    """What was answered for is not sent again; the one part whose answer was lost may be."""
    monkeypatch.setattr(copying, "COPY_BYTES_MAX", PART * (streets.RECORD_BYTES + 300))
    sent: list[int] = []

    async def main() -> None:
        street = Street(2)

        class Watched(Asker):
            async def ask(self, member: Any, priority: Any, packet: Any, answer: Any, timeout: float) -> Any:
                reply = await super().ask(member, priority, packet, answer, timeout)
                if isinstance(packet, CopyRecords):
                    sent.append(len(packet.items))
                    if len(sent) == parts_before:
                        street.houses[crashes].crash()
                return reply

        monkeypatch.setattr(streets, "Asker", Watched)
        async with trio.open_nursery() as nursery:
            giver, _, _ = await filled(street, nursery, RECORDS)
            assert giver.arc is not None
            piece = end_of(giver.arc, Side.RIGHT, 0.5)
            # The giver's own task never learns how it ended, if it is the giver that crashes.
            nursery.start_soon(attempt, giver, piece)
            with trio.fail_after(300.0):
                while not street.houses[1].durable().owns(piece.first):  # noqa: ASYNC110 - disks tell nobody when they change
                    await trio.sleep(0.5)
            await street.until_whole()
            street.check()
            assert street.houses[0].lives + street.houses[1].lives == 3
            nursery.cancel_scope.cancel()

    run_simulated(1, main, virtual_s_max=1000.0, wall_s_max=60.0)
    assert max(sent) <= PART and len(sent) > parts_before
    assert PIECE <= sum(sent) <= PIECE + PART
