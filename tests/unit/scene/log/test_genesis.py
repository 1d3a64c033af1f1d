"""If this fails, who knows nothing of a scene but its name believes a header that its owners never signed."""

from __future__ import annotations

from dataclasses import replace

import pytest

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.client.gifts import gifts_in
from scenefold.crypto import HEADER_DOMAIN, SigningKey
from scenefold.peer.scene_log.headers import checked_header
from scenefold.scene.head import SceneHead, check_head
from scenefold.scene.log import FOR_EVER, decided, lockbox_for, proven_header_key, succeeded
from scenefold.wire import KeyEntry, Role, SceneLogPublic, SceneMode, WriterEntry
from unit.scene.log.members import MAKER, grant, secrets_of
from unit.scene.log.test_grants import KEEPER_KEY, MAKER_NUMBER, Story

EVIL = SigningKey(b"e" * 32)


def grown() -> Story:
    """A scene whose header key has changed, twice."""
    story = Story()
    for number in (5, 6):
        story.do(grant(number, Role.OWNER))
        story.revoke(number)
    return story


def usurped(header: SceneLogPublic, **changes: object) -> SceneLogPublic:
    """What a node that holds a header makes of it with a key of its own."""
    mine = KeyEntry(1, EVIL.public.raw)
    changes = {"public_key": EVIL.key_id, "keys": (mine,), "writers": (WriterEntry(EVIL.key_id, 0, FOR_EVER),), "lockboxes": (), **changes}
    forged = replace(header, **changes)  # type: ignore[arg-type]
    return decided(replace(forged, signature=EVIL.sign(HEADER_DOMAIN, forged.signable())), KEEPER_KEY)


def test_every_later_header_leads_back_to_the_genesis() -> None:
    story = grown()
    assert checked_header(story.header, None).public == story.header
    assert proven_header_key(story.header) == story.keys.header_key != story.first_keys.header_key
    assert story.header.first_key == story.first_keys.header_key.raw


def test_a_header_that_is_met_first_is_believed_only_if_it_leads_back_to_the_genesis() -> None:
    story = grown()
    header = story.header
    heirs = (succeeded(EVIL, EVIL.public, header.genesis, 2),)
    forged = [
        usurped(header, position=2**64 - 1, succession=()),
        usurped(header, succession=heirs),
        usurped(header, succession=(), first_key=EVIL.public.raw),
        usurped(header, succession=(), first_key=EVIL.public.raw, birth=bytes(32)),
        usurped(header, position=1, succession=()),
        usurped(header, position=1, succession=(), first_key=EVIL.public.raw),
        usurped(header, succession=(), origin=NodeId(99)),
        _by_the_owner(story, origin=NodeId(99)),
        _by_the_owner(story, origin_key=EVIL.public.raw),
        decided(_by_the_owner(story, origin_key=EVIL.public.raw), EVIL),
        _by_the_owner(story, succession=header.succession[1:]),
        _by_the_owner(story, birth=bytes(32)),
    ]
    for one in forged:
        with pytest.raises(Refused) as refused:
            checked_header(one, None)
        assert refused.value.reason is RejectReason.ILL_FORMED
        with pytest.raises(DamagedData):
            proven_header_key(one)


def _by_the_owner(story: Story, **changes: object) -> SceneLogPublic:
    header = replace(story.header, **changes)  # type: ignore[arg-type]
    seed = story.keys.header_seed
    assert seed is not None
    return decided(replace(header, signature=SigningKey(seed).sign(HEADER_DOMAIN, header.signable())), KEEPER_KEY)


@pytest.mark.expect_log("is not believed")
def test_nobody_grants_a_scene_under_the_name_of_another() -> None:
    story = grown()
    victim = secrets_of(9)
    keys = replace(story.keys, header_key=EVIL.public, header_seed=EVIL.seed)
    story.do(grant(9, Role.OWNER))
    member = next(one for one in story.state.grants.members if one.recipient == victim.sealing.public.key_id)
    lockbox = lockbox_for(member, keys, story.header.key_epoch, MAKER.name, secrets_of(MAKER_NUMBER).signing, story.token)
    assert len(gifts_in([story.header], victim.sealing)) == 1
    assert gifts_in([usurped(story.header, lockboxes=(lockbox,), succession=())], victim.sealing) == []


def test_no_node_renders_by_a_header_of_before_what_the_client_held() -> None:
    story = Story()
    story.do(grant(5, Role.OWNER))
    before = story.header
    story.revoke(5)
    head = SceneHead(story.header.position, story.keys.header_key.raw)
    check_head(story.header, story.header.genesis, head)
    story.do(grant(6, Role.OWNER))
    story.revoke(6)
    check_head(story.header, story.header.genesis, head)
    check_head(before, before.genesis, SceneHead(before.position, before.first_key))
    with pytest.raises(Refused) as refused:
        check_head(before, before.genesis, head)
    assert refused.value.reason is RejectReason.NOT_READY
    with pytest.raises(DamagedData):
        check_head(replace(before, position=9), before.genesis, head)
    with pytest.raises(DamagedData, match="another scene"):
        check_head(before, bytes(32), head)
    with pytest.raises(Refused, match="edit mode") as refused:
        check_head(story.header, story.header.genesis, replace(head, floor=1))
    assert refused.value.reason is RejectReason.MODE_FORBIDS
    check_head(replace(story.header, mode=SceneMode.RENDER), story.header.genesis, replace(head, floor=1))
