"""What a member looks at in its own profile before it speaks to anybody: certificate and keys are its own, whole, and count today."""

from __future__ import annotations

import datetime

from scenefold.base.errors import DamagedData, LocalFault
from scenefold.crypto import Card, Identity, MemberSecrets
from scenefold.world.profile import ClusterProfile


def check_papers(profile: ClusterProfile, identity: Identity, secrets: MemberSecrets) -> None:
    """OutOfDate, with both dates, if the certificate does not count by this computer's clock; NotOfThisCluster if it is of another one,
    DamagedData if it is damaged; LocalFault if it names other keys than these.
    """
    try:
        card = Card.verified(identity.certificate, profile.authority_certificate(), datetime.datetime.now(datetime.UTC))
    except DamagedData as problem:
        raise type(problem)(problem.what, where=f"{identity.name}, {profile.folder}", remedy=problem.remedy) from None
    check_keys(profile, card, secrets)


def check_keys(profile: ClusterProfile, card: Card, secrets: MemberSecrets) -> None:
    """LocalFault unless these are the keys that a certificate names: else a file was damaged, or is another member's."""
    if (card.keys.signing, card.keys.sealing) != (secrets.signing.public, secrets.sealing.public):
        what = "these are not the keys that the certificate names"
        where = f"{card.name}, {profile.folder}"
        raise LocalFault(what, where=where, remedy="restore all of them from one backup: scenectl key import")
