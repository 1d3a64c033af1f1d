"""If this fails, `cluster status` keeps quiet about somebody who signs for others, or cries wolf over a node that was revoked."""

from __future__ import annotations

from dataclasses import replace

import pytest
import trio
import trio.testing

from scenefold.wire import PingBroadcast
from unit.peer.village import node_at, village
from unit.peer.voices import Voice


@pytest.mark.expect_log("is dropped: ")
async def test_a_status_that_its_node_did_not_sign_is_told_of_with_who_told_it(autojump_clock: trio.testing.MockClock) -> None:
    async with village(3) as them:
        await them.start(0)
        forged = replace(them.of(1).own.signed(), signature=bytes(64))
        await Voice(them, node_at(2)).say(PingBroadcast((them.of(2).own.signed(), forged)), node_at(0))
        await trio.sleep(5.0)
        (sign,) = them.of(0).gossip.signs.documents(trio.current_time())
        assert (sign["kind"], sign["count"], sign["source"]) == ("forged", 1, "127.0.0.4")
        assert sign["ago_s"] == pytest.approx(5.0, abs=1.0)
