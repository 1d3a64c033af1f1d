"""If this fails, a client believes a log that the cluster did not decide, or forgets a revocation that it has seen."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.errors import DamagedData, LocalFault, PeerFault
from scenefold.base.reasons import RejectReason
from scenefold.crypto import SigningKey
from scenefold.peer.cluster_log.registry import Registry
from scenefold.wire import LogEntry, Member, RevokeNode, SignedRecord
from scenefold.wire.enrol_entries import Invite, RenewCard, RevokeUser
from scenefold.world.log_file import LOG_FILE, LogFile
from scenefold.world.log_view import NO_INCARNATION, LogView
from unit.peer.logs_made import LOG_KEY, add, found, key_of, member, node, record, remove, signed
from unit.peer.members_made import NEWCOMERS, NOW, card_for, enrolled, invitation_key
from unit.world.test_roll import YEAR

KEY = LOG_KEY.public
ADA, NODE = "user:ada", f"node:{node(1)}"


def invited(number: int, name: str, who: int) -> tuple[LogEntry, LogEntry]:
    key = invitation_key(number).public.raw
    return Invite(key, name, False, int(NOW.timestamp()) + 3600, "user:owner"), enrolled(number, card_for(name, who))


ENTRIES: tuple[LogEntry, ...] = (
    found(3),
    add(0),
    add(1),
    *invited(1, ADA, 0),
    RenewCard(card_for(ADA, 0, since=YEAR).der),
    *invited(2, "user:bob", 1)[:1],
    RevokeUser(ADA, NEWCOMERS[0].signing.key_id),
    RevokeNode(node(1), key_of(1).public.key_id),
    remove(1),
    *invited(3, ADA, 2),
)


def records(entries: tuple[LogEntry, ...] = ENTRIES, key: SigningKey = LOG_KEY) -> list[SignedRecord]:
    registry, made = Registry(), []
    for entry in entries:
        one = record(registry, entry)
        registry = registry.apply(one)
        made.append(signed(one, key))
    return made


RECORDS = records()


@given(st.lists(st.integers(0, len(RECORDS)), max_size=6))
def test_it_is_what_a_node_makes_of_the_same_log_in_however_many_parts(cuts: list[int]) -> None:
    view, registry = LogView(), Registry()
    for end in (*sorted(cuts), len(RECORDS)):
        view, fresh = view.after(RECORDS[:end], KEY)
        assert fresh == RECORDS[view.position - len(fresh) : end]
    registry = registry.extended(one.decoded() for one in RECORDS)
    assert (view.position, view.head, view.roll) == (registry.position, registry.head, registry.roll)
    assert view.revoked_at == {(ADA, NEWCOMERS[0].signing.key_id): 8, (NODE, key_of(1).public.key_id): 9}
    assert view.keys_of(node(0)) is not None and view.keys_of(node(1)) is None
    refusal = view.refusal_of(NODE, key_of(1).public.key_id)
    assert refusal is not None and refusal.reason is RejectReason.KEY_REVOKED and "position 9" in str(refusal)
    assert view.refusal_of(ADA, NEWCOMERS[2].signing.key_id) is None, "ada is back under other keys"
    assert [card.name for card in view.cards([])] == [ADA]


def test_the_line_and_its_members_are_those_that_a_node_knows_after_each_record() -> None:
    view, registry = LogView(), Registry()
    for entry in (
        found(3),
        add(1),
        add(0),
        add(3, left_of=1),
        remove(1),
        add(2),
        add(4, left_of=0),
        remove(3),
        add(1, left_of=4, life=1),
        add(3, left_of=2, life=1),
    ):
        one = record(registry, entry)
        registry = registry.apply(one)
        view, _ = view.after([signed(one)], KEY)
        assert (view.order, view.members) == (registry.order, registry.members)
        for number in range(5):
            registered = registry.current(node(number))
            standing = Member(node(number), NO_INCARNATION if registered is None else registered.incarnation)
            assert view.on_line(node(number)) == (standing if node(number) in registry.order else None)
    assert [(gone.member, gone.position, gone.by) for gone in view.removals] == [
        (member(1), 5, node(0)),
        (member(3), 8, node(0)),
    ]
    assert [(gone.member, gone.reason, gone.position) for gone in view.removals] == [
        (known.member, known.reason, known.position) for known in registry.removed.values()
    ]


def test_whoever_shows_it_nobody_leaves_out_changes_or_adds_a_record() -> None:
    before, _ = LogView().after(RECORDS[:6], KEY)
    forged = records((*ENTRIES[:7], *invited(5, "user:eve", 1)), SigningKey(bytes(32)))
    for shown in (
        RECORDS[7:],
        [RECORDS[6], RECORDS[8]],
        [replace(RECORDS[6], signature=bytes(64))],
        [replace(RECORDS[6], record=RECORDS[6].record[:-1] + b"\x00")],
        forged[6:],
        records((*ENTRIES[:2], *invited(5, "user:eve", 1), add(1), *ENTRIES[3:6]))[6:],
    ):
        with pytest.raises((DamagedData, PeerFault)):
            before.after(shown, KEY)
    assert before.after(RECORDS[:3], KEY) == (before, []), "an older log takes nothing back"


def test_what_was_seen_is_seen_by_the_next_client_of_the_profile(tmp_path: Path) -> None:
    file = LogFile(tmp_path)
    assert file.load() == (LogView(), [])
    file.save(RECORDS[:9])
    LogFile(tmp_path).save(RECORDS[:4])
    view, kept = LogFile(tmp_path).load()
    assert kept == RECORDS[:9] and view == LogView().after(RECORDS[:9], KEY)[0]
    file.save(RECORDS)
    assert file.load()[1] == RECORDS


@pytest.mark.parametrize("spoil", [lambda data: data[:-1], lambda data: data + b"x", lambda data: b"x" + data, lambda _: b""])
def test_a_damaged_file_says_what_to_do(tmp_path: Path, spoil: object) -> None:
    LogFile(tmp_path).save(RECORDS)
    path = tmp_path / LOG_FILE
    path.write_bytes(spoil(path.read_bytes()))  # type: ignore[operator]
    with pytest.raises(LocalFault, match=r"damaged.*remove this file") as caught:
        LogFile(tmp_path).load()
    assert caught.value.where == str(path)


def test_no_flipped_bit_of_a_kept_record_is_overlooked(tmp_path: Path) -> None:
    LogFile(tmp_path).save(RECORDS[:9])
    path = tmp_path / LOG_FILE
    whole = path.read_bytes()
    for at in range(len(whole)):
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :])
        with pytest.raises(LocalFault):
            LogFile(tmp_path).load()
