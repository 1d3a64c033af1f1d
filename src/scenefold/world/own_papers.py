"""What a member looks at in its own profile before it speaks to anybody: certificate and keys are its own, whole, and count today."""

from __future__ import annotations

import datetime
from pathlib import Path

from scenefold.base.errors import DamagedData, LocalFault
from scenefold.crypto import AUTHORITY_PURPOSE, Authority, Card, Identity, MemberSecrets
from scenefold.crypto.secrets_on_disk import read_certificate
from scenefold.world.profile import ClusterProfile
from scenefold.world.profile_making import SEALED_AUTHORITY


def check_papers(profile: ClusterProfile, identity: Identity, secrets: MemberSecrets) -> None:
    """OutOfDate, with both dates, if the certificate does not count by this computer's clock; NotOfThisCluster if it is of another one,
    DamagedData if it is damaged; LocalFault if it names other keys than these. All name the file.
    """
    card = _card_in(identity.certificate, profile.authority_certificate(), identity.where, datetime.datetime.now(datetime.UTC))
    check_keys(card, identity, secrets)


def own_card(profile: ClusterProfile, identity: Identity, secrets: MemberSecrets) -> Card:
    """The card in one's certificate, whatever the date is; errors are those of `check_papers`."""
    card = _card_in(identity.certificate, profile.authority_certificate(), identity.where)
    check_keys(card, identity, secrets)
    return card


def card_in_file(path: Path, authority: bytes) -> Card:
    """The card in a file, whatever the date is, if this authority (PEM) issued it; errors name the file."""
    return _card_in(read_certificate(path), authority, str(path))


def check_keys(card: Card, identity: Identity, secrets: MemberSecrets) -> None:
    """LocalFault unless these are the keys that a certificate names: else a file was damaged, or is another member's."""
    for name in secrets.files_besides(card.keys.signing, card.keys.sealing):
        where = card.name if identity.folder is None else str(identity.folder / name)
        what = "these are not the keys that the certificate names"
        raise LocalFault(what, where=where, remedy="restore all of them from one backup: scenectl key import")


def opened_authority(profile: ClusterProfile, address: str, secrets: MemberSecrets) -> Authority | None:
    """The authority, by its key as it was sealed to a node here; None if it was not. DamagedData if it does not open."""
    sealed = profile.sealed_authority(address)
    if sealed is None:
        return None
    try:
        key = secrets.sealing.open(sealed, AUTHORITY_PURPOSE, profile.cluster_id)
        return Authority.from_key(profile.authority_certificate(), key)
    except DamagedData as problem:
        where = str(profile.node_folder(address) / SEALED_AUTHORITY)
        remedy = "restore it from a backup, or move it away: then this node issues no certificates"
        raise DamagedData(f"the authority's key does not open: {problem.what}", where=where, remedy=remedy) from None


def _card_in(certificate: bytes, authority: bytes, where: str, now: datetime.datetime | None = None) -> Card:
    try:
        return Card.verified(certificate, authority, now)
    except DamagedData as problem:
        remedy = problem.remedy or "restore it from a backup, or have it renewed: scenectl cluster renew"
        raise type(problem)(problem.what, where=where, remedy=remedy) from None
