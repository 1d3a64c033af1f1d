"""Who may still be at the door: connections whose TLS handshake has not ended, or of newcomers, who have no certificate.

Strangers can open as many connections as they like. Their number is bounded, and when it is reached, room is made by
the source that would have the most of them with the one that comes, its oldest first: so a pushy address pushes out its own
connections, and nobody else's. Who has shown that it is expected stays until it leaves.
"""

from __future__ import annotations

import trio


class PendingHandshakes:
    """Cancel scopes of the handshakes, or of newcomers' connections, under way."""

    def __init__(self, count_max: int) -> None:
        assert count_max >= 1
        self._count_max = count_max
        self._sources: dict[str, dict[trio.CancelScope, None]] = {}
        """In the order in which they came; and of each its scopes, oldest first."""
        self._expected: dict[bytes, trio.CancelScope] = {}

    def __len__(self) -> int:
        return sum(map(len, self._sources.values())) + len(self._expected)

    def admit(self, scope: trio.CancelScope, source: str) -> None:
        """Let a newcomer in; cancels another one if the door is full, or this one if all others are expected."""
        if len(self._expected) >= self._count_max:
            scope.cancel()
            return
        is_full = len(self) >= self._count_max
        self._sources.setdefault(source, {})[scope] = None
        if is_full:
            self._make_room(source)

    def expect(self, scope: trio.CancelScope, reason: bytes) -> None:
        """It is not pushed out any more. One connection at a time for each reason, so that nobody has two places for one."""
        if reason not in self._expected and self._forget(scope):
            self._expected[reason] = scope

    def leave(self, scope: trio.CancelScope) -> None:
        self._forget(scope)
        self._expected = {reason: other for reason, other in self._expected.items() if other is not scope}

    def _forget(self, scope: trio.CancelScope) -> bool:
        """Whether it was there, and could have been pushed out."""
        source = next((source for source, scopes in self._sources.items() if scope in scopes), None)
        if source is None:
            return False
        del self._sources[source][scope]
        if not self._sources[source]:
            del self._sources[source]
        return True

    def _make_room(self, comes: str) -> None:
        """Where all have one, the source goes that has been here longest, even if it has replaced its connection ever since."""
        most = max(map(len, self._sources.values()))
        with_most = [source for source, scopes in self._sources.items() if len(scopes) == most]
        pushiest = comes if most > 1 and comes in with_most else with_most[0]
        oldest = next(iter(self._sources[pushiest]))
        self._forget(oldest)
        oldest.cancel()
