"""What holders of copies tell a client, and when so many have spoken that it counts as read (specs/17-simulation.md, Histories).

Reckoned anew from packets, whatever the client makes of it: by spec the newest of what enough holders say under one configuration counts,
whichever of them are heard, and a count that the client does not take must be right as well.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import combinations
from typing import NamedTuple

from scenefold.crypto import version_of
from scenefold.simulation.history import Place, Version
from scenefold.wire import Configuration, CopiesFound, Copy, CopyState, GetCopies, RecordKey

NOTHING = b""


class Shape(NamedTuple):
    """Of a space, by its scene's header."""

    copies: int
    needed: int


class Counted(NamedTuple):
    """Something was told by enough holders, the first of whom was asked at moment `begin`. `version`: None for nothing.

    `is_lied`: not without those who lie about it.
    """

    place: Place
    version: Version | None
    begin: int
    is_lied: bool = False


class _Word(NamedTuple):
    version: Version | None
    begin: int


class HeardCopies:
    """Of all clients of a run. `shape_of`: what the header of a place's scene asks for; `is_liar`: of which node what it says of a place
    is worth nothing."""

    def __init__(self, shape_of: Callable[[Place], Shape], is_liar: Callable[[str, Place], bool] = lambda _node, _place: False) -> None:
        self._shape_of = shape_of
        self._is_liar = is_liar
        self._versions: dict[bytes, Version] = {}
        self._said: dict[tuple[object, ...], dict[str, _Word]] = {}

    def offered(self, header: bytes, version: Version) -> None:
        """Somebody has written this."""
        self._versions[version_of(header)] = version

    def heard(self, who: str, holder: str, begin: int, asked: GetCopies, answer: CopiesFound) -> list[Counted]:
        """What counts now that this holder has answered as well; what it says, and nobody wrote, is left out."""
        found: list[Counted] = []
        if asked.any_copy:
            # Of who is asked so only the bytes are wanted, and not its word.
            return found
        for key, copy in zip(asked.keys, answer.copies, strict=False):
            word = _word_of(copy)
            if word is None or (word != NOTHING and word not in self._versions):
                continue
            configuration, place = answer.holders[copy.holders], _place_of(asked, key)
            said = self._said.setdefault((who, place, configuration), {})
            said[holder] = _Word(self._versions.get(word), begin)
            heard, having = self._enough(configuration, self._shape_of(place))
            others = [name for name in said if name != holder]
            for some in combinations(others, max(heard, having) - 1):
                counted = self._counted(place, {name: said[name] for name in (*some, holder)}, having)
                if counted is not None and counted not in found:
                    found.append(counted)
        return found

    @staticmethod
    def _enough(configuration: Configuration, shape: Shape) -> tuple[int, int]:
        """How many must be heard, and how many of them must have what counts."""
        if configuration.number == 0 and len(configuration.members) == 1:
            # The owner itself.
            return 1, 1
        return max(1, configuration.quorum, shape.copies - shape.needed + 1), max(1, configuration.needed - 1, shape.needed - 1)

    def _counted(self, place: Place, said: Mapping[str, _Word], having: int) -> Counted | None:
        """What these make known, whatever others say."""
        newest = max((word.version for word in said.values()), key=_order)
        if sum(word.version == newest for word in said.values()) < having:
            return None
        is_lied = any(self._is_liar(name, place) for name in said)
        return Counted(place, newest, min(word.begin for word in said.values()), is_lied)


def _order(version: Version | None) -> tuple[object, ...]:
    return () if version is None else version.order


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
