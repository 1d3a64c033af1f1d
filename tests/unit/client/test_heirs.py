"""If one fails, readers wait for who cannot say yet what a dead node owned, or ask others for ever."""

from __future__ import annotations

from scenefold.base.ids import NodeId
from scenefold.client.heirs import KEPT_MAX, SPEAKS, Heirs

HEIR, OTHER = NodeId(1), NodeId(2)
GONE = frozenset({NodeId(9)})


def test_who_inherited_nothing_is_asked_alone() -> None:
    assert not Heirs().may_be_mute(HEIR, frozenset())


def test_an_heir_is_asked_alone_once_it_was_sooner_so_often_in_a_row() -> None:
    heirs = Heirs()
    for _ in range(SPEAKS - 1):
        heirs.was_sooner(HEIR, GONE)
    assert heirs.may_be_mute(HEIR, GONE)
    heirs.was_sooner(HEIR, GONE)
    assert not heirs.may_be_mute(HEIR, GONE)
    assert heirs.may_be_mute(OTHER, GONE) and heirs.may_be_mute(HEIR, GONE | {OTHER}), "that says nothing of others"
    heirs.was_late(HEIR, GONE)
    assert heirs.may_be_mute(HEIR, GONE), "one part of it may be whole before another"


def test_what_is_remembered_is_bounded_and_the_oldest_goes_first() -> None:
    heirs = Heirs()
    for number in range(2, 2 + KEPT_MAX):
        for _ in range(SPEAKS):
            heirs.was_sooner(HEIR, {NodeId(number)})
    assert not heirs.may_be_mute(HEIR, {NodeId(2)})
    heirs.was_late(OTHER, GONE)
    assert heirs.may_be_mute(HEIR, {NodeId(2)}) and not heirs.may_be_mute(HEIR, {NodeId(3)})
