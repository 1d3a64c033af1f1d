"""What takes the place of a safeguard of scenes' logs in a mutant (mutants.py)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any


def forgetful_memory(original: Any) -> Any:
    """What a participant promises and votes for stays in memory."""

    async def write(self: Any, what: Any, before: Any, after: Any) -> None:
        from scenefold.consensus import Decide

        if isinstance(what, Decide):
            await original(self, what, before, after)

    return write


def half(_original: Any) -> Any:
    """As many as half of those who decide are enough."""
    return lambda entries: max(1, len(entries) // 2)


def half_of_participants(_original: Any) -> Any:
    return property(lambda participants: max(1, len(participants.everyone) // 2))


def unfenced(_original: Any) -> Any:
    """Nodes take edits in whatever mode the scene is, and of before any change of it."""
    return lambda _self, _header: None


def deaf_to_borrowers(_original: Any) -> Any:
    """Nobody who is asked for consent minds what it has lent."""
    return lambda _self, _value: None


def stale_roster(original: Any) -> Any:
    """Who decides stays as it was when this node began with the log."""

    def after(self: Any, value: Any) -> Any:
        return replace(original(self, value), participants=self.participants)

    return after
