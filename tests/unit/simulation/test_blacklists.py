"""If this fails, the judge asks for copies on nodes that their owner has forbidden meanwhile, or excuses those that it always allowed."""

from __future__ import annotations

import pytest

from scenefold.base.ids import node_id_of
from scenefold.base.prefixes import Blacklist, address_prefix
from scenefold.peer.membership.blacklist import NOTE, encode_blacklist
from scenefold.simulation.blacklists import Blacklists, blacklist_of
from scenefold.store.layout import NOTES
from scenefold.store.sealing import sealed
from unit.simulation.test_watch import Machine

OTHER, FAR = node_id_of("10.0.0.7"), node_id_of("10.0.9.7")


class Seen:
    def __init__(self) -> None:
        self.machine, self.now = Machine(0), 0.0
        self.blacklists = Blacklists({0: self.machine}, lambda: self.now)

    def says(self, *prefixes: str, at_s: float) -> None:
        self.now = at_s
        key = NOTE.encode()
        note = encode_blacklist(Blacklist(1, tuple(sorted(map(address_prefix, prefixes)))))
        self.machine.tables[NOTES][key] = sealed(NOTES, key, note)
        self.blacklists.committed(0)


def test_who_has_written_nothing_forbids_nobody() -> None:
    seen = Seen()
    seen.blacklists.committed(0)
    assert blacklist_of(seen.machine) == ()
    assert not seen.blacklists.may_forbid(0, OTHER, 60.0)


@pytest.mark.parametrize("prefix", ["10.0.0.7", "10.0.0.4/30", "0.0.0.0/0"])
def test_what_stands_there_forbids_however_long_ago_it_was_written(prefix: str) -> None:
    seen = Seen()
    seen.says(prefix, at_s=1.0)
    seen.now = 1000.0
    assert blacklist_of(seen.machine) == (address_prefix(prefix),)
    assert seen.blacklists.may_forbid(0, OTHER, 60.0)
    assert seen.blacklists.may_forbid(0, FAR, 60.0) == (prefix == "0.0.0.0/0")
    assert not seen.blacklists.may_forbid(1, OTHER, 60.0)


def test_what_was_taken_off_may_forbid_for_a_while_and_anew_when_it_comes_back() -> None:
    seen = Seen()
    seen.says("10.0.0.7", "10.0.9.0/24", at_s=1.0)
    seen.says("10.0.9.0/24", at_s=10.0)
    seen.now = 70.0
    assert seen.blacklists.may_forbid(0, OTHER, 60.0) and seen.blacklists.may_forbid(0, FAR, 60.0)
    seen.now = 70.5
    assert not seen.blacklists.may_forbid(0, OTHER, 60.0) and seen.blacklists.may_forbid(0, FAR, 60.0)
    seen.says("10.0.0.7", at_s=80.0)
    assert seen.blacklists.may_forbid(0, OTHER, 60.0)
    seen.says(at_s=90.0)
    seen.now = 150.0
    assert seen.blacklists.may_forbid(0, OTHER, 60.0) and not seen.blacklists.may_forbid(0, FAR, 60.0)


def test_a_disk_that_was_wiped_forbids_nothing_but_may_have_lately() -> None:
    seen = Seen()
    seen.says("10.0.0.7", at_s=1.0)
    seen.machine.tables[NOTES] = {}
    seen.now = 5.0
    seen.blacklists.committed(0)
    assert blacklist_of(seen.machine) == ()
    assert seen.blacklists.may_forbid(0, OTHER, 10.0)
    seen.now = 16.0
    assert not seen.blacklists.may_forbid(0, OTHER, 10.0)
