"""What is decided: bytes that only the log's judge understands (specs/25-consensus.md, Terms).

Nodes that decide a scene's log cannot read it. So a value is its digest and its bytes here (`wire.LogValue`), and a judge that the log
brings says whether it may stand, and who decides the position after it.
"""

from __future__ import annotations

from typing import Protocol

from scenefold.base.reasons import RejectReason
from scenefold.consensus.participants import Participants
from scenefold.wire import LogValue

NO_DIGEST = bytes(32)
"""In a promise of who has voted for nothing."""
Value = LogValue


class Judge(Protocol):
    """All that is decided of a log so far, as the protocol needs to know it. Immutable, and a pure function of what was decided:
    at two nodes that know the same log it MUST say the same."""

    @property
    def participants(self) -> Participants:
        """Who decides the next position."""

    def refuses(self, value: Value, *, is_decided: bool = False) -> RejectReason | None:
        """Why this value must not stand at the next position; None if it may.

        `is_decided`: a certificate shows that it does. Of its body that may be missing then which newer values hold, too.
        """

    def found(self, value: Value) -> int | None:
        """Where this value is decided, or another one that does what this one asks for (the same request, at another position)."""

    def after(self, value: Value) -> Judge:
        """The judge once this value is decided at the next position. It is asked of no value that it refuses."""
