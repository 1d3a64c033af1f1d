"""If this fails, somebody keeps or gets a scene's keys who must not, or an owner's word does not count."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field, replace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenefold.base.errors import DamagedData, LocalFault, Refused
from scenefold.base.ids import KeyId, NodeId, SpaceId
from scenefold.base.limits import COPIES_MAX
from scenefold.base.location import FIRST
from scenefold.base.reasons import RejectReason
from scenefold.client import births
from scenefold.client.births import born, born_with, first_header, first_private, first_records, kept_keys
from scenefold.client.copies import BY_DEFAULT, Copies
from scenefold.client.sealing import Draft, Opened
from scenefold.client.wishes import Wish
from scenefold.crypto import HEADER_DOMAIN, InvalidSignature, SigningKey
from scenefold.peer.records.verification import KnownScene
from scenefold.peer.scene_log.headers import checked_header
from scenefold.scene.log import (
    Decider,
    EpochKeys,
    OpenedLog,
    SceneKeys,
    SceneLog,
    check_granter,
    check_log,
    decided,
    follow,
    keys_after,
    keys_in,
    keys_with_log,
    open_private,
    own_lockbox,
)
from scenefold.wire import Batch, KeyEntry, KeyEpoch, LogEntry, Revoke, Role, SceneLogPublic
from unit.scene.log.members import MAKER, grant, secrets_of

KEEPER_KEY = SigningKey(b"f" * 32)
ORIGIN = Decider(NodeId(7), KEEPER_KEY.public.raw)
MAKER_NUMBER = 200


@dataclass
class Story:
    """A scene from its birth on; `keys`: of an owner. `private`: its log, sealed."""

    copies: Copies = BY_DEFAULT
    counter: Any = field(default_factory=lambda: itertools.count(1))

    def __post_init__(self) -> None:
        self.kept = kept = born("kitchen", MAKER, secrets_of(MAKER_NUMBER).signing, ORIGIN, self.token, self.copies)
        self.keys = self.first_keys = kept_keys(kept, secrets_of(MAKER_NUMBER).sealing)
        header = first_header(kept, self.keys, MAKER, ORIGIN)
        assert header is not None
        self.header = decided(header, KEEPER_KEY)
        self.private = first_private(self.keys, MAKER, ORIGIN)
        self.known: KnownScene = checked_header(self.header, None)
        records = first_records(self.keys, MAKER, ORIGIN)
        self.log = OpenedLog(SceneLog.of(one.decoded() for one in records), records)

    def token(self, count: int) -> bytes:
        return next(self.counter).to_bytes(8, "big").rjust(count, b"\x5a")[-count:]

    @property
    def state(self) -> SceneLog:
        return self.log.state

    def do(self, entry: LogEntry, keys: SceneKeys | None = None) -> None:
        """By an owner; it is decided, nodes are told, and believe it."""
        record = self.state.next_record(entry, self.token(16), ORIGIN.node)
        followed = follow(self.header, self.log, record, keys or self.keys, secrets_of(MAKER_NUMBER).signing, self.token).sealed()
        self.header, self.log, self.keys, self.private = decided(followed.header, KEEPER_KEY), followed.log, followed.keys, followed.private
        self.known = checked_header(self.header, self.known)

    def key_epoch(self) -> KeyEpoch:
        epoch = self.state.grants.key_epoch
        return KeyEpoch(epoch + 1, self.keys.epochs[epoch])

    def revoke(self, number: int) -> None:
        self.do(Batch((Revoke(secrets_of(number).signing.key_id), self.key_epoch())))

    def given(self, number: int) -> SceneKeys | None:
        """What the newest header alone gives a member."""
        found = own_lockbox(self.header, secrets_of(number).sealing)
        if found is None:
            return None
        assert found[1].granter == MAKER.name
        check_granter(*found, self.header.genesis, secrets_of(MAKER_NUMBER).signing.public)
        with pytest.raises(InvalidSignature):
            check_granter(*found, self.header.genesis, secrets_of(1).signing.public)
        return keys_in(found[1], self.header.genesis)

    def read(self, keys: SceneKeys) -> SceneKeys:
        """Open the log with these keys; gives them with the former ones."""
        check_log(self.header, self.private)
        opened = open_private(
            self.private,
            genesis=self.header.genesis,
            position=self.header.position,
            symmetric_key=keys.epochs.newest,
            header_key=keys.header_key,
            header_keyed_at=self.header.succession[-1].position if self.header.succession else 1,
        )
        assert opened.state == self.state
        return keys_with_log(keys, opened.state)


def test_no_nonce_serves_two_first_logs_of_a_scene() -> None:
    """The genesis covers no names: whoever resumes a creation under another one has the same key, and seals something else."""
    story = Story()
    again, other = (first_private(story.keys, maker, ORIGIN) for maker in (MAKER, replace(MAKER, name="user:ada")))
    assert again == story.private
    assert first_header(story.kept, story.keys, replace(MAKER, name="user:ada"), ORIGIN) is not None, "else nobody would seal it"
    assert _nonce(other) != _nonce(again)


@pytest.mark.parametrize("copies", [BY_DEFAULT, Copies(1, 1), Copies(COPIES_MAX, 3)])
def test_a_creation_is_resumed_by_a_version_that_would_give_new_scenes_other_copies(
    copies: Copies, monkeypatch: pytest.MonkeyPatch
) -> None:
    story = Story(copies)
    header = first_header(story.kept, story.keys, MAKER, ORIGIN)
    assert born_with(story.keys, MAKER, ORIGIN) == copies
    monkeypatch.setattr(births, "BY_DEFAULT", Copies(5, 4))
    assert header is not None and first_header(story.kept, story.keys, MAKER, ORIGIN) == header
    assert first_private(story.keys, MAKER, ORIGIN) == story.private


def _nonce(sealed: bytes) -> bytes:
    return sealed[6:18]


ACTS = st.lists(st.tuples(st.sampled_from(["grant", "revoke", "rotate"]), st.integers(1, 5), st.sampled_from(list(Role))), max_size=10)


@settings(max_examples=40, deadline=None)
@given(ACTS)
def test_who_may_use_a_scene_has_its_keys_and_nobody_else(acts: list[tuple[str, int, Role]]) -> None:
    story, roles = Story(), {MAKER_NUMBER: Role.OWNER}
    held: dict[int, set[bytes]] = {number: set() for number in (*range(1, 6), MAKER_NUMBER)}
    for act, number, role in acts:
        before = story.state
        try:
            if act == "grant":
                story.do(grant(number, role))
                assert number not in roles or roles[number] < role
                roles[number] = role
            elif act == "revoke":
                story.revoke(number)
                del roles[number]
            else:
                story.do(story.key_epoch())
        except Refused:
            assert story.state is before
            assert (act == "revoke" and number not in roles) or (act == "grant" and role <= roles.get(number, 0))
            continue
        newest = story.keys.epochs.newest
        for member, had in held.items():
            given_keys = story.given(member)
            assert (given_keys is not None) == (member in roles)
            if given_keys is None:
                assert newest not in had, "whoever was revoked has no key of what comes after"
                continue
            assert (given_keys.role, given_keys.epochs.newest, given_keys.name) == (roles[member], newest, "kitchen")
            assert (given_keys.header_seed is not None) == (roles[member] is Role.OWNER)
            everything = story.read(given_keys)
            assert dict(everything.epochs) == dict(story.keys.epochs)
            had |= set(everything.epochs.values())
            # From the first header key on, or from any later one, the newest is found.
            followed = keys_after(story.header, replace(story.first_keys, role=Role.READER), secrets_of(member).sealing)
            assert followed.header_key == story.keys.header_key
            assert dict(followed.epochs) == dict(story.keys.epochs), "without the log, too"
        grants = story.state.grants
        assert {m.name: m.role for m in grants.members} == {f"user:m{n}" if n != MAKER_NUMBER else MAKER.name: r for n, r in roles.items()}
        writing = {term.key for term in story.header.writers if term.from_position <= story.header.position <= term.until_position}
        assert writing == {secrets_of(n).signing.key_id for n, r in roles.items() if r >= Role.WRITER}
        assert sum(key is not None for key in map(story.known.keys.get, writing)) == len(writing)


def test_a_revoked_owner_signs_nothing_that_counts() -> None:
    story = Story()
    story.do(grant(1, Role.OWNER))
    former = story.given(1)
    assert former is not None and former.header_seed is not None
    before = story.header, story.log
    story.revoke(1)
    assert story.header.write_floor == story.header.position == 3
    # Nor if the node that decides is on his side.
    forged = follow(
        *before, before[1].state.next_record(grant(9, Role.OWNER), bytes(16), ORIGIN.node), former, secrets_of(1).signing, story.token
    ).sealed()
    older = decided(forged.header, KEEPER_KEY)
    for header in (older, _signed(replace(older, position=9), former), _signed(replace(story.header, position=4), former)):
        with pytest.raises(Refused) as refused:
            checked_header(header, story.known)
        assert refused.value.reason in (RejectReason.NOT_AUTHORISED, RejectReason.POSITION_TAKEN, RejectReason.SIGNATURE_INVALID)
        with pytest.raises(DamagedData):
            keys_after(header, story.keys, secrets_of(MAKER_NUMBER).sealing)
    # He can make a key follow the old one, but not the new one.
    heir = SigningKey(bytes(31) + b"\x63")
    taken = follow(
        *before, before[1].state.next_record(KeyEpoch(1, bytes(24)), bytes(16), ORIGIN.node), former, secrets_of(1).signing, story.token
    ).sealed()
    from scenefold.scene.log import succeeded

    step = succeeded(SigningKey(former.header_seed), heir.public, story.header.genesis, 4)
    for steps in ((step,), (*story.header.succession, step)):
        keys = (KeyEntry(1, heir.public.raw), *story.header.keys)
        usurped = replace(taken.header, position=4, write_floor=4, succession=steps, public_key=heir.key_id, keys=keys)
        usurped = decided(replace(usurped, signature=heir.sign(HEADER_DOMAIN, usurped.signable())), KEEPER_KEY)
        with pytest.raises(Refused) as refused:
            checked_header(usurped, story.known)
        assert refused.value.reason is RejectReason.NOT_AUTHORISED
        with pytest.raises(DamagedData):
            keys_after(usurped, story.keys, None)


def _signed(header: SceneLogPublic, keys: SceneKeys) -> SceneLogPublic:
    assert keys.header_seed is not None
    return decided(replace(header, signature=SigningKey(keys.header_seed).sign(HEADER_DOMAIN, header.signable())), KEEPER_KEY)


def test_an_older_header_is_behind_and_no_crime() -> None:
    story = Story()
    story.do(grant(1, Role.OWNER))
    older = story.header
    story.revoke(1)
    with pytest.raises(Refused) as refused:
        checked_header(older, story.known)
    assert refused.value.reason is RejectReason.POSITION_BEHIND


def test_readers_and_writers_sign_no_log() -> None:
    story = Story()
    for number, role in ((1, Role.READER), (2, Role.WRITER)):
        story.do(grant(number, role))
        keys = story.given(number)
        assert keys is not None
        with pytest.raises(LocalFault, match="do not sign"):
            story.do(story.key_epoch(), keys)


@pytest.mark.parametrize(
    ("entries", "what"),
    [
        ([grant(1, name="")], "needs a name"),
        ([grant(1), grant(1)], "already"),
        ([grant(1, Role.OWNER), grant(1, Role.WRITER)], "already"),
        ([grant(1), grant(2, name="user:m1")], "other keys"),
        ([grant(1), grant(1, name="user:other")], "another member has"),
        ([grant(1), grant(2, sealing=grant(1).sealing)], "another member has"),
        ([grant(1, signing=KeyEntry(1, b"\x02" * 384))], "keys of user:m1"),
        ([grant(1, sealing=KeyEntry(7, bytes(32)))], "keys of user:m1"),
        ([Revoke(KeyId(5))], "no member"),
        ([grant(1), Revoke(secrets_of(1).signing.key_id)], "keeps the scene's key"),
        ([Batch((Revoke(secrets_of(MAKER_NUMBER).signing.key_id), KeyEpoch(1, bytes(24))))], "at least one owner"),
        ([KeyEpoch(2, bytes(24))], "does not follow"),
        ([KeyEpoch(0, bytes(24))], "does not follow"),
        ([Batch((KeyEpoch(1, bytes(24)), KeyEpoch(2, bytes(24))))], "does not follow"),
    ],
)
def test_entries_that_do_not_fit_are_refused(entries: list[LogEntry], what: str) -> None:
    story = Story()
    for entry in entries[:-1]:
        story.do(entry)
    with pytest.raises(Refused, match=what):
        story.do(entries[-1])


def test_a_role_is_lowered_by_taking_it_and_granting_less() -> None:
    story = Story()
    story.do(grant(1, Role.WRITER))
    key = secrets_of(1).signing.key_id
    story.do(Batch((Revoke(key), grant(1, Role.READER), story.key_epoch())))
    assert story.state.grants.named("user:m1").role is Role.READER
    assert [(term.from_position, term.until_position) for term in story.header.writers if term.key == key] == [(2, 2)]
    keys = story.given(1)
    assert keys is not None and keys.role is Role.READER


def test_no_key_shows_in_what_is_printed() -> None:
    keys = replace(Story().keys, epochs=EpochKeys({0: b"secretsecretsecretsecret", 4: bytes(24)}))
    assert "secret" not in repr(keys) and "header_seed" not in repr(keys)
    assert keys.epochs.newest_epoch == 4
    printed = [
        KeyEpoch(1, b"secret" * 4),
        Draft(SpaceId(1), FIRST, b"secret", None, 1, bytes(12)),
        Opened(b"secret", 1, bytes(32)),
        Wish(SpaceId(1), FIRST, b"secret"),
    ]
    assert "secret" not in repr(printed)
    assert EpochKeys.of_rows(keys.epochs.rows()) == keys.epochs
