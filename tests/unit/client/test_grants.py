"""If this fails, somebody who was granted a scene cannot use it, or somebody who was not can; or a rotation breaks a reader."""

from __future__ import annotations

import datetime
from dataclasses import replace
from pathlib import Path

import pytest
from trio.testing import MockClock

from scenefold.base.errors import DamagedData, LocalFault, Refused
from scenefold.base.ids import address_of
from scenefold.base.location import FIRST, Location
from scenefold.base.reasons import RejectReason
from scenefold.client.scene import Scene
from scenefold.client.scenes import Scenes
from scenefold.crypto import RSA3072, Card, MemberSecrets, SealingKey, SigningKey
from scenefold.scene.layout import GEOMETRY
from scenefold.wire import Role
from scenefold.world.keyring import Keyring
from unit.client.fake_nodes import ORIGIN, FakeNodes
from unit.scene.log.members import secrets_of

OWNER, ADA, BEN = (secrets_of(number) for number in (1, 2, 3))
NAMES = {1: "user:owner", 2: "user:ada", 3: "user:ben"}
PLACES = [Location.from_number(number << 140) for number in range(1, 9)]


def card_of(number: int) -> Card:
    """A card as a verified certificate gives it."""
    day = datetime.datetime(2026, 1, 1, tzinfo=datetime.UTC)
    return Card(NAMES[number], (), secrets_of(number).public(), 1, day, day, b"")


class Studio:
    """One cluster and its users, each with a keyring of his own."""

    def __init__(self, folder: Path) -> None:
        self.nodes = FakeNodes()
        self.folder = folder

    def scenes(self, number: int, secrets: MemberSecrets | None = None, known: Known | None = None) -> Scenes:
        keyring = Keyring(self.folder / NAMES[number].partition(":")[2])
        calls = self.nodes.calls()
        return Scenes(calls, keyring, secrets or secrets_of(number), ORIGIN, NAMES[number], card_of=known)

    async def kitchen(self, number: int) -> Scene:
        return await self.scenes(number).open("kitchen")


@pytest.fixture
def studio(tmp_path: Path) -> Studio:
    return Studio(tmp_path)


async def test_a_granted_scene_is_listed_opened_and_read_by_its_name(autojump_clock: MockClock, studio: Studio) -> None:
    scene = await studio.scenes(1).create("kitchen")
    await scene.space(GEOMETRY).put(FIRST, b"a chair")
    assert [listing.name for listing in await studio.scenes(2).list()] == [None]
    with pytest.raises(LocalFault, match="no scene 'kitchen'"):
        await studio.kitchen(2)
    access = await scene.grant(card_of(2), Role.READER)
    assert [(member.name, member.role) for member in access.members] == [("user:owner", Role.OWNER), ("user:ada", Role.READER)]
    assert [listing.name for listing in await studio.scenes(2).list()] == ["kitchen"]
    reader = await studio.kitchen(2)
    assert await reader.space(GEOMETRY).get(FIRST) == b"a chair"
    assert [space.name for space in await reader.spaces()][:2] == ["meta", "geometry"]
    assert await reader.members() == access
    assert (await studio.scenes(2).open("kitchen")).genesis == scene.genesis, "from then on by the keyring"
    with pytest.raises(LocalFault, match="no scene 'kitchen'"):
        await studio.kitchen(3)


async def test_a_grant_that_few_nodes_have_heard_of_is_found_before_it_is_said_that_there_is_none(
    autojump_clock: MockClock, tmp_path: Path
) -> None:
    studio = Studio(tmp_path)
    studio.nodes = FakeNodes(tuple(f"127.0.0.{number}" for number in range(2, 14)))
    scene = await studio.scenes(1).create("kitchen")
    await scene.grant(card_of(2), Role.READER)
    studio.nodes.deaf = set(studio.nodes.addresses) - {studio.nodes.addresses[7]}
    studio.nodes.away = {studio.nodes.addresses[3]}
    assert (await studio.kitchen(2)).genesis == scene.genesis
    with pytest.raises(LocalFault, match="no scene 'kitchen'"):
        await studio.kitchen(3)


async def test_what_was_made_here_is_listed_though_only_the_node_where_it_began_knows_of_it(
    autojump_clock: MockClock, studio: Studio
) -> None:
    await studio.scenes(1).create("kitchen")
    studio.nodes.deaf = set(studio.nodes.addresses) - {address_of(ORIGIN.node)}
    assert [listing.name for listing in await studio.scenes(1).list()] == ["kitchen"]
    assert [listing.name for listing in await studio.scenes(2).list()] == [None]


@pytest.mark.expect_log(r"its header is not believed")
async def test_a_forged_header_does_not_stand_before_the_scenes_own(autojump_clock: MockClock, studio: Studio) -> None:
    scene = await studio.scenes(1).create("kitchen")
    (number,) = studio.nodes.headers
    good = studio.nodes.headers[number]
    liar = studio.nodes.addresses[2]
    studio.nodes.shown[liar] = replace(good, position=good.position + 1000)
    assert [header for header in await studio.scenes(1).headers() if header.genesis == scene.genesis] == [good]
    studio.nodes.shown[liar] = good.decided_by(None)
    assert [header for header in await studio.scenes(1).headers() if header.genesis == scene.genesis] == [good]


async def test_a_reader_writes_nothing_and_changes_nothing(autojump_clock: MockClock, studio: Studio) -> None:
    scene = await studio.scenes(1).create("kitchen")
    await scene.grant(card_of(2), Role.READER)
    reader = await studio.kitchen(2)
    with pytest.raises(LocalFault, match="reading only"):
        await reader.space(GEOMETRY).put(FIRST, b"mine")
    for change in (reader.grant(card_of(3), Role.READER), reader.revoke("user:owner"), reader.rotate_key(), reader.create_space("hall")):
        with pytest.raises(LocalFault, match="only an owner"):
            await change


async def test_what_a_reader_signs_all_the_same_neither_nodes_nor_clients_take(autojump_clock: MockClock, studio: Studio) -> None:
    scene = await studio.scenes(1).create("kitchen")
    await scene.grant(card_of(2), Role.READER)
    reader = await studio.kitchen(2)
    reader.access.check_writer = lambda: None  # type: ignore[method-assign]
    with pytest.raises(Refused) as refused:
        await reader.space(GEOMETRY).put(FIRST, b"mine")
    assert refused.value.reason is RejectReason.NOT_AUTHORISED
    studio.nodes.helpers = set(studio.nodes.addresses)
    await reader.space(GEOMETRY).put(FIRST, b"mine")
    with pytest.raises(DamagedData, match="no writer"):
        await scene.space(GEOMETRY).get(FIRST)


async def test_a_role_may_rise(autojump_clock: MockClock, studio: Studio) -> None:
    scene = await studio.scenes(1).create("kitchen")
    await scene.grant(card_of(2), Role.READER)
    ada = await studio.kitchen(2)
    await scene.grant(card_of(2), Role.WRITER)
    await ada.space(GEOMETRY).put(FIRST, b"ada was here")
    assert await scene.space(GEOMETRY).get(FIRST) == b"ada was here", "the owner's header was older than her right to write"
    with pytest.raises(LocalFault, match="only an owner"):
        await ada.grant(card_of(3), Role.READER)
    await scene.grant(card_of(2), Role.OWNER)
    await ada.grant(card_of(3), Role.WRITER)
    await (await studio.kitchen(3)).space(GEOMETRY).put(PLACES[0], b"ben, too")
    assert await scene.space(GEOMETRY).get(PLACES[0]) == b"ben, too"
    with pytest.raises(LocalFault, match="already"):
        await scene.grant(card_of(2), Role.READER)


async def test_a_rotation_is_no_matter_to_those_who_have_the_scene_open(autojump_clock: MockClock, studio: Studio) -> None:
    scene = await studio.scenes(1).create("kitchen")
    await scene.grant(card_of(2), Role.WRITER)
    await scene.grant(card_of(3), Role.READER)
    ada, ben = await studio.kitchen(2), await studio.kitchen(3)
    await scene.space(GEOMETRY).put(PLACES[0], b"0")
    for epoch in (1, 2, 3):
        assert (await scene.rotate_key()).key_epoch == epoch
        await ada.space(GEOMETRY).put(PLACES[epoch], b"%d" % epoch)
        assert ada.access.identity.key_epoch == epoch
    everything = [b"0", b"1", b"2", b"3"]
    for reader in (scene, ada, ben, await studio.kitchen(3), await studio.kitchen(1)):
        assert await reader.space(GEOMETRY).get_many(PLACES[:4]) == everything


async def test_what_lies_under_former_keys_is_read_where_the_log_is_lost(autojump_clock: MockClock, studio: Studio) -> None:
    scene = await studio.scenes(1).create("kitchen")
    for epoch in range(3):
        await scene.space(GEOMETRY).put(PLACES[epoch], b"%d" % epoch)
        await scene.rotate_key()
    await scene.grant(card_of(2), Role.READER)
    studio.nodes.logs.clear()
    ada = await studio.kitchen(2)
    assert await ada.space(GEOMETRY).get_many(PLACES[:3]) == [b"0", b"1", b"2"]


async def test_whoever_was_revoked_keeps_what_he_had_and_no_more(autojump_clock: MockClock, studio: Studio) -> None:
    scene = await studio.scenes(1).create("kitchen")
    await scene.grant(card_of(2), Role.WRITER)
    await scene.grant(card_of(3), Role.READER)
    ada, ben = await studio.kitchen(2), await studio.kitchen(3)
    await ada.space(GEOMETRY).put(PLACES[0], b"before")
    access = await scene.revoke("user:ada")
    assert ([member.name for member in access.members], access.key_epoch) == (["user:owner", "user:ben"], 1)
    with pytest.raises(Refused, match="your access to this scene was revoked"):
        await ada.space(GEOMETRY).put(PLACES[1], b"after")
    await scene.space(GEOMETRY).put(PLACES[1], b"secret")
    for reader in (ada, await studio.kitchen(2)):
        assert await reader.space(GEOMETRY).get(PLACES[0]) == b"before"
        with pytest.raises(Refused, match="not sealed to you") as refused:
            await reader.space(GEOMETRY).get(PLACES[1])
        assert refused.value.reason is RejectReason.KEY_REVOKED
        with pytest.raises(Refused, match="not sealed to you"):
            await reader.spaces()
    assert await ben.space(GEOMETRY).get_many(PLACES[:2]) == [b"before", b"secret"], "what ada wrote as a writer stays hers"
    with pytest.raises(LocalFault, match="user:ada has no access"):
        await scene.revoke("user:ada")
    with pytest.raises(LocalFault, match="at least one owner"):
        await scene.revoke("user:owner")
    await scene.grant(card_of(2), Role.READER)
    assert await ada.space(GEOMETRY).get(PLACES[1]) == b"secret", "granted again"


async def test_a_revocation_that_is_only_tried_says_what_it_would_leave_and_changes_nothing(
    autojump_clock: MockClock, studio: Studio
) -> None:
    scene = await studio.scenes(1).create("kitchen")
    await scene.grant(card_of(2), Role.WRITER)
    before = studio.nodes.headers[scene.id]
    planned = await scene.revoke("user:ada", dry_run=True)
    assert ([member.name for member in planned.members], planned.key_epoch) == (["user:owner"], 1)
    with pytest.raises(LocalFault, match="user:ben has no access"):
        await scene.revoke("user:ben", dry_run=True)
    with pytest.raises(LocalFault, match="at least one owner"):
        await scene.revoke("user:owner", dry_run=True)
    ada = await studio.kitchen(2)
    with pytest.raises(LocalFault, match="only an owner"):
        await ada.revoke("user:owner", dry_run=True)
    await ada.space(GEOMETRY).put(PLACES[0], b"still")
    assert studio.nodes.headers[scene.id] == before
    assert await scene.revoke("user:ada") == planned


async def test_what_a_former_writer_signs_all_the_same_is_refused(autojump_clock: MockClock, studio: Studio) -> None:
    scene = await studio.scenes(1).create("kitchen")
    await scene.grant(card_of(2), Role.WRITER)
    ada = await studio.kitchen(2)
    await scene.revoke("user:ada")
    ada.access.check_writer = lambda: None  # type: ignore[method-assign]
    ada.access.log = None
    with pytest.raises(Refused) as refused:
        await ada.space(GEOMETRY).put(FIRST, b"late")
    assert refused.value.reason in (RejectReason.MODE_FORBIDS, RejectReason.KEY_REVOKED)
    # A node that is with him stores it under a position that is none of his any more.
    ada.access.identity = ada.access.identity.with_header(next(iter(studio.nodes.headers.values())))
    object.__setattr__(ada.access.identity, "key_epoch", 0)
    (header,) = studio.nodes.headers.values()
    studio.nodes.headers.clear()
    await ada.space(GEOMETRY).put(FIRST, b"late")
    studio.nodes.headers[header.scene] = header
    with pytest.raises(DamagedData, match="no writer of the scene at position"):
        await scene.space(GEOMETRY).get(FIRST)


async def test_a_former_owner_decides_nothing(autojump_clock: MockClock, studio: Studio) -> None:
    scene = await studio.scenes(1).create("kitchen")
    await scene.grant(card_of(2), Role.OWNER)
    ada = await studio.kitchen(2)
    await ada.rotate_key()
    await scene.revoke("user:ada")
    with pytest.raises(Refused, match="not sealed to you"):
        await ada.rotate_key()
    with pytest.raises(LocalFault, match="only an owner"):
        await (await studio.kitchen(2)).grant(card_of(3), Role.READER)
    await scene.grant(card_of(3), Role.OWNER)
    await (await studio.kitchen(3)).revoke("user:owner")
    assert len(next(iter(studio.nodes.headers.values())).succession) == 2
    fresh = await studio.kitchen(3)
    assert [member.name for member in (await fresh.members()).members] == ["user:ben"]
    last = max(space.id for space in await fresh.spaces())
    assert (await fresh.create_space("hall")).id == last + 1


async def test_two_scenes_of_one_name_are_told_apart_by_their_ids(autojump_clock: MockClock, studio: Studio) -> None:
    for number in (1, 2):
        scene = await studio.scenes(number).create("kitchen")
        await scene.grant(card_of(3), Role.READER)
    with pytest.raises(LocalFault, match="several scenes 'kitchen'"):
        await studio.kitchen(3)
    name = f"{scene.id:08x}"
    assert (await studio.scenes(3).open(name)).genesis == scene.genesis


@pytest.mark.expect_log(r"(its header|what it holds for us) is not believed")
async def test_a_lockbox_in_a_forged_header_opens_nothing(autojump_clock: MockClock, studio: Studio) -> None:
    scene = await studio.scenes(1).create("kitchen")
    await scene.grant(card_of(2), Role.READER)
    studio.nodes.headers[scene.id] = replace(studio.nodes.headers[scene.id], write_floor=9)
    assert await studio.scenes(2).list() == []
    with pytest.raises(LocalFault, match="no scene 'kitchen'"):
        await studio.kitchen(2)


class Known:
    """Cards as the cluster shows them."""

    def __init__(self, *numbers: int) -> None:
        self._cards = {NAMES[number]: card_of(number) for number in numbers}

    async def __call__(self, name: str) -> Card:
        if name not in self._cards:
            raise LocalFault(f"{name} is no member")
        return self._cards[name]


async def test_a_scene_is_believed_if_a_user_of_the_cluster_granted_it(autojump_clock: MockClock, studio: Studio) -> None:
    scene = await studio.scenes(1).create("kitchen")
    await scene.grant(card_of(2), Role.READER)
    known = studio.scenes(2, known=Known(1))
    assert [(listing.name, listing.granted_by) for listing in await known.list()] == [("kitchen", "user:owner")]
    assert (await known.open("kitchen")).genesis == scene.genesis
    assert [listing.granted_by for listing in await known.list()] == [None], "from now on it is ours"


@pytest.mark.expect_log(r"what it holds for us is not believed")
@pytest.mark.parametrize("forger", ["node:7", "user:ben", "user:nobody"])
async def test_a_scene_that_somebody_made_up_is_not_believed(autojump_clock: MockClock, studio: Studio, forger: str) -> None:
    """By a node that is known as such, in another user's name, in nobody's: its keys are sealed rightly, and it could read all that is written."""
    keyring = Keyring(studio.folder / "forger")
    forging = Scenes(studio.nodes.calls(), keyring, secrets_of(9), ORIGIN, forger)
    scene = await forging.create("kitchen")
    await scene.grant(card_of(2), Role.WRITER)
    known = Known(1, 3)
    known._cards["node:7"] = Card("node:7", (), secrets_of(9).public(), 1, card_of(1).not_before, card_of(1).not_after, b"")
    ada = studio.scenes(2, known=known)
    assert [listing.name for listing in await ada.list()] == [None]
    with pytest.raises(LocalFault, match="no scene 'kitchen'"):
        await ada.open("kitchen")
    assert (await ada.open_or_create("kitchen")).genesis != scene.genesis


async def test_what_is_imported_goes_into_no_scene_that_somebody_was_quicker_to_name(autojump_clock: MockClock, studio: Studio) -> None:
    scene = await studio.scenes(1).create("kitchen")
    await scene.grant(card_of(2), Role.WRITER)
    ada = studio.scenes(2)
    with pytest.raises(LocalFault, match="was granted to you") as fault:
        await ada.open_or_create("kitchen")
    assert "user:owner" in fault.value.where and f"{scene.id:08x}" in fault.value.where
    assert not studio.scenes(2)._keyring.names()
    await ada.open("kitchen")
    assert (await ada.open_or_create("kitchen")).genesis == scene.genesis, "once she has said that she means it"


async def test_a_name_that_looks_like_an_id_does_not_hide_the_scene_of_that_id(autojump_clock: MockClock, studio: Studio) -> None:
    scene = await studio.scenes(1).create("kitchen")
    await scene.grant(card_of(2), Role.WRITER)
    other = await studio.scenes(3).create(f"{scene.id:08x}")
    await other.grant(card_of(2), Role.WRITER)
    assert (await studio.scenes(2).open(f"{scene.id:08x}")).genesis == scene.genesis


async def test_a_node_owns_no_scene(autojump_clock: MockClock, studio: Studio) -> None:
    scene = await studio.scenes(1).create("kitchen")
    card = Card("node:7", (), secrets_of(9).public(), 1, card_of(1).not_before, card_of(1).not_after, b"")
    with pytest.raises(LocalFault, match="only users"):
        await scene.grant(card, Role.OWNER)
    await scene.grant(card, Role.READER)


async def test_keys_of_the_other_suite_work_alike(autojump_clock: MockClock, studio: Studio) -> None:
    rsa = MemberSecrets(SigningKey.generate(RSA3072), SealingKey.generate(RSA3072))
    scene = await studio.scenes(1).create("kitchen")
    card = Card("user:ada", (), rsa.public(), 1, card_of(1).not_before, card_of(1).not_after, b"")
    await scene.grant(card, Role.OWNER)
    ada = await studio.scenes(2, rsa, known=Known(1)).open("kitchen")
    await ada.space(GEOMETRY).put(FIRST, b"signed by RSA")
    assert await scene.space(GEOMETRY).get(FIRST) == b"signed by RSA"
    await ada.grant(card_of(3), Role.READER)
    await ada.rotate_key()
    known = Known(1)
    known._cards["user:ada"] = card
    assert [listing.granted_by for listing in await studio.scenes(3, known=known).list()] == ["user:ada"]
    await ada.reencrypt()
    await scene.revoke("user:ada")
    assert await (await studio.kitchen(3)).space(GEOMETRY).get(FIRST) == b"signed by RSA"
