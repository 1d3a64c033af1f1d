"""`scenectl scene status`: what became of a change that nobody answered."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Self

from scenectl.errors import DONE, REFUSED, UNREACHABLE
from scenectl.names import SHOWN_CHARACTERS_MAX, SceneName
from scenectl.output import DEFAULT_PROFILE, ProfileOutput, emit
from scenectl.values import ONE_WORD, is_digits

if TYPE_CHECKING:
    from scenefold.client import Standing

_ID_DIGITS = 32


@dataclass(frozen=True)
class Request:
    """A request as an error names it: 32 hexadecimal digits, and the position that it was offered at: 4f…c2@17."""

    id: bytes
    offered_at: int

    @classmethod
    def parse(cls, text: str) -> Self:
        digits, at, position = text.strip().partition("@")
        try:
            request_id = bytes.fromhex(digits)
        except ValueError:
            request_id = b""
        if len(digits) != _ID_DIGITS or len(request_id) * 2 != _ID_DIGITS or (at and not is_digits(position)):
            what = f"a request is {_ID_DIGITS} hexadecimal digits, @ and a position, as the error names it, not"
            raise ValueError(f"{what} {text[:SHOWN_CHARACTERS_MAX]!r}")
        return cls(request_id, int(position) if at else 0)

    def __str__(self) -> str:
        return self.id.hex() + (f"@{self.offered_at}" if self.offered_at else "")


RequestOption = Annotated[Request, ONE_WORD]


def status(scene: SceneName, request: RequestOption, /, *, output: ProfileOutput = DEFAULT_PROFILE) -> int:
    """Tell what became of a change of which an error said that nobody knows. Any member of the scene may ask.

    Exit code 0: it is in the log. 4: it is not, and never will be. 3: nobody knows yet; nothing of it was begun, as far as is known.

    Example: scenectl scene status kitchen 4f0c…c2@17 --profile studio

    Parameters
    ----------
    scene
        Name of the scene.
    request
        The request, as the error names it.
    """
    from scenectl.running import connected, run

    async def ask() -> Standing:
        async with connected(output.profile) as cluster:
            return await (await cluster.scenes.open(scene)).standing(request.id, request.offered_at)

    found = run(ask)
    emit(output, {"scene": scene, "request": str(request), **found.document()}, standing_text(found))
    return DONE if found.position is not None else REFUSED if found.is_over else UNREACHABLE


def standing_text(found: Standing) -> str:
    """A sentence, with what can be done."""
    if found.position is not None:
        return f"It is in the scene's log, at position {found.position}."
    if found.is_over:
        return f"It is not in the scene's log, which is at position {found.known}, and never will be. Nothing was changed by it; it can be repeated."
    return (
        f"It is not in the scene's log, which is at position {found.known}, and those who decide know of nothing begun behind that. "
        f"It may still come, until something else is decided at position {found.known + 1}. It is tried again by repeating the same command then."
    )
