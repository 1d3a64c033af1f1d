"""Who may still be at the door: connections whose TLS handshake has not ended, or of newcomers, who have no certificate.

Strangers can open as many connections as they like. Their number is bounded, and when it is reached, room is made by
the source that has the most of them, its oldest first: so one pushy address never keeps out another one.
"""

from __future__ import annotations

from collections import Counter, OrderedDict

import trio


class PendingHandshakes:
    """Cancel scopes of the handshakes, or of newcomers' connections, under way, in the order of arrival."""

    def __init__(self, count_max: int) -> None:
        assert count_max >= 1
        self._count_max = count_max
        self._scopes: OrderedDict[trio.CancelScope, str] = OrderedDict()

    def __len__(self) -> int:
        return len(self._scopes)

    def admit(self, scope: trio.CancelScope, source: str) -> None:
        """Let a newcomer in; cancels another one if the door is full."""
        if len(self._scopes) >= self._count_max:
            self._make_room()
        self._scopes[scope] = source

    def leave(self, scope: trio.CancelScope) -> None:
        self._scopes.pop(scope, None)

    def _make_room(self) -> None:
        pushiest, _ = Counter(self._scopes.values()).most_common(1)[0]
        oldest = next(scope for scope, source in self._scopes.items() if source == pushiest)
        del self._scopes[oldest]
        oldest.cancel()
