"""If this failed, a few addresses that open many connections could keep all others out."""

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


async def test_addresses_that_fill_the_door_together_push_out_themselves_and_not_who_comes() -> None:
    pending = PendingHandshakes(8)
    crowd = [trio.CancelScope() for _ in range(8)]
    for number, scope in enumerate(crowd):
        pending.admit(scope, f"silent {number % 7}")
    honest = trio.CancelScope()
    pending.admit(honest, "honest")
    assert [scope.cancel_called for scope in crowd] == [True] + 7 * [False], "the oldest of who had two"
    for round_ in range(50):
        again = trio.CancelScope()
        pending.admit(again, f"silent {round_ % 7}")
    assert not honest.cancel_called, "each of the others replaces its own"
    assert len(pending) == 8


async def test_where_all_have_one_place_who_came_last_has_the_longest_time() -> None:
    pending = PendingHandshakes(3)
    for source in ("a", "b", "c"):
        pending.admit(trio.CancelScope(), source)
    honest = trio.CancelScope()
    pending.admit(honest, "honest")
    for source in ("b", "c", "b", "c", "d", "e"):
        assert not honest.cancel_called
        pending.admit(trio.CancelScope(), source)
    assert not honest.cancel_called, "b and c have replaced their own, and were pushed out by d and e all the same"
    pending.admit(trio.CancelScope(), "f")
    assert honest.cancel_called


async def test_who_is_expected_is_pushed_out_by_nobody_once_for_each_reason() -> None:
    pending = PendingHandshakes(3)
    first, second, third = (trio.CancelScope() for _ in range(3))
    for scope in (first, second, third):
        pending.admit(scope, "one")
    pending.expect(first, b"token a")
    pending.expect(second, b"token a")
    pending.admit(trio.CancelScope(), "other")
    assert [scope.cancel_called for scope in (first, second, third)] == [False, True, False]
    pending.expect(second, b"token b")
    pending.expect(third, b"token b")
    assert len(pending) == 3
    last = trio.CancelScope()
    pending.admit(last, "other")
    pending.expect(last, b"token c")
    late = trio.CancelScope()
    pending.admit(late, "new")
    assert late.cancel_called and not last.cancel_called and len(pending) == 3, "all others are expected"
    pending.leave(first)
    pending.expect(trio.CancelScope(), b"token a")
    pending.admit(trio.CancelScope(), "new")
    assert not last.cancel_called and not third.cancel_called and len(pending) == 3
