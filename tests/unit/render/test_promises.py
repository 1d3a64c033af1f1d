"""If this fails, renders that each fit into a node's memory end it together, or one is turned away though there is room."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.errors import LocalFault, Refused
from scenefold.base.reasons import RejectReason
from scenefold.render.pool.promises import MIB, Account, Promises


def taken(account: Account, name: str, mib: int) -> bool:
    try:
        account.take(name, mib * MIB, "a cell", "render it with more nodes")
    except (LocalFault, Refused):
        return False
    return True


def test_what_is_more_than_a_node_may_use_is_refused_for_good() -> None:
    account = Promises(10 * MIB).account()
    with pytest.raises(LocalFault, match=r"a cell takes some 11 MiB of each node's memory; this one may use 10 MiB: ") as caught:
        account.take("cell", 11 * MIB, "a cell", "render it with more nodes")
    assert caught.value.remedy == "render it with more nodes, or give the nodes more memory"
    assert taken(account, "image", 4)
    with pytest.raises(LocalFault, match=r"may use 10 MiB, and this render has 4 of them"):
        account.take("cell", 7 * MIB, "a cell", "render it with more nodes")
    assert taken(account, "cell", 6)


def test_what_others_have_is_waited_for() -> None:
    promises = Promises(10 * MIB)
    one, other = promises.account(), promises.account()
    assert taken(one, "cell", 6)
    with pytest.raises(Refused, match="other renders have 6 of them") as caught:
        other.take("cell", 5 * MIB, "a cell", "render it with more nodes")
    assert caught.value.reason is RejectReason.BUSY and "try again once they are done" in caught.value.remedy
    one.close()
    assert taken(other, "cell", 10)


def test_a_name_has_what_it_got_last() -> None:
    promises = Promises(10 * MIB)
    account = promises.account()
    assert taken(account, "cell", 6) and taken(account, "cell", 9)
    assert not taken(account, "cell", 11) and account.held == 9 * MIB
    account.give_back("cell")
    account.give_back("cell")
    assert promises.held == 0


def test_room_is_made_only_where_that_helps() -> None:
    idle = [3, 3]
    made: list[Account] = []

    def make_room() -> bool:
        if not idle:
            return False
        idle.pop()
        made.pop().close()
        return True

    promises = Promises(10 * MIB, make_room)
    for mib in idle:
        made.append(promises.account())
        assert taken(made[-1], "image", mib)
    account = promises.account()
    assert not taken(account, "cell", 11) and len(idle) == 2, "nothing that is let go would do"
    assert taken(account, "cell", 5) and len(idle) == 1
    assert not taken(promises.account(), "cell", 6) and not idle


@given(st.lists(st.tuples(st.integers(0, 3), st.sampled_from("ab"), st.integers(0, 12)), max_size=30))
def test_never_more_is_promised_than_there_is(steps: list[tuple[int, str, int]]) -> None:
    promises = Promises(20 * MIB)
    accounts = [promises.account() for _ in range(3)]
    for which, name, mib in steps:
        if which == 3:
            accounts[mib % 3].close()
            accounts[mib % 3] = promises.account()
        else:
            before = promises.held - accounts[which].held
            if not taken(accounts[which], name, mib):
                assert before + accounts[which].held + mib * MIB > promises.most
        assert promises.held <= promises.most
