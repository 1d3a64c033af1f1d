"""A request for a change of a scene's log, as errors name it: so it is asked after, and repeated, in any process (specs/16-scene-log.md, Doubt)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self, TypeAlias

from scenefold.base.errors import Unreachable

_ID_DIGITS = 32
_POSITION_DIGITS_MAX = 9
_SHOWN_CHARACTERS_MAX = 80


@dataclass(frozen=True, slots=True)
class Request:
    """Its id, and the highest position of the log that it was offered at; 0: that is not known. As text: 4f…c2@17.

    `InDoubt.request`, given as `again` to the call that raised it, in any process, makes the very same change at most once: if it is in the
    log by now, the call returns as if it had put it there. LocalFault if the log has another change under the request; Refused (2) if so
    much was decided since that the log does not know it any more.
    """

    id: bytes
    offered_at: int = 0

    @classmethod
    def parse(cls, text: str) -> Self:
        """Of 32 hexadecimal digits, and mostly @ and a position; ValueError for anything else."""
        digits, at, position = text.strip().partition("@")
        try:
            request_id = bytes.fromhex(digits)
        except ValueError:
            request_id = b""
        is_position = position.isascii() and position.isdigit() and len(position) <= _POSITION_DIGITS_MAX
        if len(digits) != _ID_DIGITS or len(request_id) * 2 != _ID_DIGITS or (at and not is_position):
            what = f"a request is {_ID_DIGITS} hexadecimal digits, @ and a position, as the error names it, not"
            raise ValueError(f"{what} {text[:_SHOWN_CHARACTERS_MAX]!r}")
        return cls(request_id, int(position) if at else 0)

    def __str__(self) -> str:
        return self.id.hex() + (f"@{self.offered_at}" if self.offered_at else "")


class InDoubt(Unreachable):
    """A change of a scene's log that may have happened, and nobody knows. Made again with `again=error.request` it happens once at most."""

    def __init__(self, what: str, *, where: str, remedy: str, request: Request) -> None:
        super().__init__(what, where=where, remedy=remedy)
        self.request = request


class Change:
    """One change of a scene's log, for whoever wants to know what becomes of it however its call ends: a call that is cancelled raises nothing of its own.

    Given as `again` it is a new change. Given so once more, after whatever came of it, it is the very same one, which happens once at most.
    """

    def __init__(self, request: Request | None = None) -> None:
        """`request`: of a change that was made before, perhaps in another process."""
        self.request = request
        """None: nothing of it has left, or it was refused, so it has not happened, and never will."""
        self.position: int | None = None
        """Where it is in the log, once that is known."""

    @property
    def is_in_doubt(self) -> bool:
        """It may have happened, and nobody knows."""
        return self.request is not None and self.position is None

    def stands(self, request_id: bytes, position: int) -> None:
        """It is in the log."""
        self.request, self.position = Request(request_id, position), position


Again: TypeAlias = Request | Change | None
"""As calls that make a change take it: a `Request` is that of a change that was made before; None is a new change."""


def change_of(again: Again) -> Change:
    """The change itself, whatever is known of it."""
    return again if isinstance(again, Change) else Change(again)


def request_in(again: Again) -> Request | None:
    """By which it was made before; None: it is new."""
    return change_of(again).request


def how_to_find_out(name: str, request: Request) -> str:
    """What to do about a change of a scene of which nobody knows."""
    return f"`scenectl scene status {name} {request}` tells what became of it: see, before you repeat it"
