"""A request for a change of a scene's log, as errors name it: so it is asked after, and repeated, in any process (specs/16-scene-log.md, Doubt)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

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
