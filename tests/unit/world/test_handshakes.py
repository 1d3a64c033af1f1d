"""If this failed, one address that opens many connections could keep all others out."""

from __future__ import annotations

import trio

from scenefold.world.real.handshakes import PendingHandshakes


async def test_the_pushiest_source_makes_room_its_oldest_first() -> None:
    pending = PendingHandshakes(4)
    sources = ["quiet", "pushy", "pushy", "pushy"]
    scopes = [trio.CancelScope() for _ in range(7)]
    for scope, source in zip(scopes, sources, strict=False):
        pending.admit(scope, source)
    pending.admit(scopes[4], "new")
    assert [scope.cancel_called for scope in scopes] == [False, True, False, False, False, False, False]
    pending.admit(scopes[5], "pushy")
    assert [number for number, scope in enumerate(scopes) if scope.cancel_called] == [1, 2]
    pending.leave(scopes[0])
    pending.admit(scopes[6], "new")
    assert [number for number, scope in enumerate(scopes) if scope.cancel_called] == [1, 2]
    assert len(pending) == 4
