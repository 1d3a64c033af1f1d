"""If this fails, a header that was never decided rules which keys a scene is sealed under, or one that was decided for some and not for others."""

from __future__ import annotations

import pytest

from scenefold.scene.log import Followed, SceneKeys, Undecided, decided, follow, keys_after, keys_in, own_lockbox
from scenefold.wire import Batch, KeyEpoch, LogEntry, Revoke, Role, SceneLogPublic
from unit.scene.log.members import grant, secrets_of
from unit.scene.log.test_grants import KEEPER_KEY, MAKER_NUMBER, ORIGIN, Story


def owner_keys(story: Story, number: int) -> SceneKeys:
    found = own_lockbox(story.header, secrets_of(number).sealing)
    assert found is not None
    return keys_in(found[1], story.header.genesis)


def proposed(story: Story, entry: LogEntry, number: int, keys: SceneKeys) -> Followed:
    """What an owner makes to follow the newest position, and nobody decides."""
    record = story.state.next_record(entry, b"lost request id.", ORIGIN.node)
    return follow(story.header, story.log, record, keys, secrets_of(number).signing, story.token).sealed()


def twice(followed: Followed) -> SceneLogPublic:
    """As a deciding node shows it that decides a position once for some, and otherwise for others."""
    return decided(followed.header, KEEPER_KEY)


def test_a_header_that_nobody_decided_gives_no_keys() -> None:
    story = Story()
    story.do(grant(5, Role.OWNER))
    fork = proposed(story, story.key_epoch(), 5, owner_keys(story, 5))
    for sealing in (None, secrets_of(MAKER_NUMBER).sealing):
        with pytest.raises(Undecided, match="nobody shows that it was decided"):
            keys_after(fork.header, story.keys, sealing)
    assert 1 not in story.keys.epochs


def test_the_key_after_a_revocation_is_none_that_the_revoked_has_shown() -> None:
    story = Story()
    story.do(grant(5, Role.OWNER))
    fork = proposed(story, story.key_epoch(), 5, owner_keys(story, 5))
    mine = keys_after(twice(fork), story.keys, secrets_of(MAKER_NUMBER).sealing)
    story.do(grant(6))
    mine = keys_after(story.header, mine, secrets_of(MAKER_NUMBER).sealing)
    revoking = Batch((Revoke(secrets_of(5).signing.key_id), KeyEpoch(1, mine.epochs[0])))
    real = proposed(story, revoking, MAKER_NUMBER, mine)
    assert real.header.key_epoch == 1
    assert real.keys.epochs[1] != fork.keys.epochs[1]


def test_an_owner_seals_under_the_key_of_the_header_that_won() -> None:
    story = Story()
    story.do(grant(5, Role.OWNER))
    story.do(grant(6, Role.OWNER))
    lost = proposed(story, story.key_epoch(), 5, owner_keys(story, 5))
    keys = keys_after(twice(lost), owner_keys(story, 6), secrets_of(6).sealing)
    story.do(story.key_epoch())
    assert keys_after(story.header, keys, secrets_of(6).sealing).epochs[1] == story.keys.epochs[1] != lost.keys.epochs[1]
    # Who was away for that long learns it from the former keys.
    story.do(story.key_epoch())
    assert dict(keys_after(story.header, keys, secrets_of(6).sealing).epochs) == dict(story.keys.epochs)
