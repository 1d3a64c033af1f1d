"""What holders of copies tell a client, and when so many say alike that it counts as read (specs/17-simulation.md, Histories).

Reckoned anew from packets, whatever the client makes of it: by spec what enough holders say under one configuration counts, and a
count that the client does not take must be right as well.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from scenefold.crypto import version_of
from scenefold.simulation.history import Place, Version
from scenefold.wire import CopiesFound, Copy, CopyState, GetCopies, RecordKey

NOTHING = b""


class Counted(NamedTuple):
    """Something was told by enough holders, the first of whom was asked at moment `begin`. `version`: None for nothing.

    `is_lied`: not without those who lie about it.
    """

    place: Place
    version: Version | None
    begin: int
    is_lied: bool = False


class HeardCopies:
    """Of all clients of a run. `least_of`: how many must say alike at least by the header of a space's scene; `is_liar`: of which node
    what it says of a place is worth nothing."""

    def __init__(self, least_of: Callable[[Place], int], is_liar: Callable[[str, Place], bool] = lambda _node, _place: False) -> None:
        self._least_of = least_of
        self._is_liar = is_liar
        self._versions: dict[bytes, Version] = {}
        self._said: dict[tuple[object, ...], dict[str, int]] = {}

    def offered(self, header: bytes, version: Version) -> None:
        """Somebody has written this."""
        self._versions[version_of(header)] = version

    def heard(self, who: str, holder: str, begin: int, asked: GetCopies, answer: CopiesFound) -> list[Counted]:
        """What counts now that this holder has answered as well; what it says for the first time, and nobody wrote, is left out."""
        found: list[Counted] = []
        if asked.any_copy:
            # Of who is asked so only the bytes are wanted, and not its word.
            return found
        for key, copy in zip(asked.keys, answer.copies, strict=False):
            word = _word_of(copy)
            if word is None or (word != NOTHING and word not in self._versions):
                continue
            configuration, place = answer.holders[copy.holders], _place_of(asked, key)
            said = self._said.setdefault((who, place, configuration, word), {})
            said[holder] = begin
            is_owner = configuration.number == 0 and len(configuration.members) == 1
            needed = 1 if is_owner else max(self._least_of(place), configuration.quorum, configuration.needed - 1, 1)
            honest = [at for node, at in said.items() if not self._is_liar(node, place)]
            if len(said) >= needed:
                is_lied = len(honest) < needed
                latest = sorted(said.values() if is_lied else honest)[-needed:]
                found.append(Counted(place, self._versions.get(word), latest[0], is_lied))
        return found


def _place_of(asked: GetCopies, key: RecordKey) -> Place:
    return Place(asked.scene, key.space, key.object or key.location)


def _word_of(copy: Copy) -> bytes | None:
    match copy.state:
        case CopyState.NOTHING:
            return NOTHING
        case CopyState.DIGEST:
            return copy.digest
        case CopyState.RECORD if copy.record is not None:
            return version_of(copy.record.header)
    return None
