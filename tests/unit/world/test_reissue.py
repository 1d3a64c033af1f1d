"""If this fails, who was revoked is given new certificates by an authority that could have known."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from scenefold.base.errors import LocalFault
from scenefold.crypto import Card
from scenefold.wire.enrol_entries import RevokeUser
from scenefold.world.log_file import LogFile
from scenefold.world.profile import ClusterProfile
from scenefold.world.reissue import reissue
from unit.peer.logs_made import add, found
from unit.world.test_log_view import records

OWNER = "user:owner"


def sent_by(profile: ClusterProfile, folder: Path) -> Path:
    """A copy of the owner's certificate, as it is sent to who has the authority's key."""
    shutil.copy(profile.folder / "users" / "owner" / "certificate.pem", folder / "sent.pem")
    return folder / "sent.pem"


def test_nothing_is_issued_for_a_key_that_the_profile_knows_to_be_revoked(tmp_path: Path) -> None:
    profile = ClusterProfile.create(tmp_path / "studio", "studio", ["127.0.0.2"])
    sent = sent_by(profile, tmp_path)
    before = sent.read_bytes()
    key = Card.read(before).signing_id
    log = LogFile(profile.folder)
    log.save(records((found(3), add(0))))
    assert [card.name for card in reissue(profile, [sent])] == [OWNER]
    renewed = sent.read_bytes()
    assert renewed != before
    log.save(records((found(3), add(0), RevokeUser(OWNER, key))))
    with pytest.raises(LocalFault, match="is revoked") as refusal:
        reissue(profile, [sent])
    assert str(sent) == refusal.value.where and sent.read_bytes() == renewed
