"""A cluster's authority, and cards that it issued, for tests of who may become a member."""

from __future__ import annotations

import datetime
import hashlib
from dataclasses import replace
from functools import lru_cache

from scenefold.base.ids import NodeId, address_of
from scenefold.crypto import ENROL_DOMAIN, Authority, Card, MemberSecrets, SealingKey, SigningKey, new_tls_key, node_named, tls_key_in
from scenefold.wire.enrol_entries import Enrol
from scenefold.wire.orders import EnrolForm

NOW = datetime.datetime(2026, 3, 1, tzinfo=datetime.UTC)
AUTHORITY = Authority.create("studio", now=NOW)
TLS_KEYS = tuple(tls_key_in(new_tls_key()) for _ in range(3))


def _seed(text: str) -> bytes:
    return hashlib.sha256(text.encode()).digest()


NEWCOMERS = tuple(MemberSecrets(SigningKey(_seed(f"signing {number}")), SealingKey(_seed(f"sealing {number}"))) for number in range(3))


@lru_cache
def invitation_key(number: int) -> SigningKey:
    return SigningKey(_seed(f"invitation {number}"))


@lru_cache
def card_for(name: str, who: int, *, admin: bool = False, since: datetime.timedelta = datetime.timedelta(0)) -> Card:
    """A card under this name for the keys of one of NEWCOMERS."""
    where = [address_of(NodeId(int(name[5:])))] if name.startswith("node:") else []
    pem = AUTHORITY.certify(name, where, TLS_KEYS[who], keys=NEWCOMERS[who].public(is_administrator=admin), now=NOW + since)
    return Card.verified(pem, AUTHORITY.certificate)


def form_for(card: Card, number: int) -> EnrolForm:
    """What the holder of an invitation has asked for to be given this card."""
    node = node_named(card.name)
    keys = replace(card.keys, is_administrator=False).encode()
    return EnrolForm(invitation_key(number).public.raw, card.name if node else "", node or NodeId(0), card.tls_key, keys)


def enrolled(number: int, card: Card, *, form: EnrolForm | None = None, by: SigningKey | None = None) -> Enrol:
    """That an invitation was used for a card: as its holder asked for, or by another form, or signed by somebody else."""
    data = (form or form_for(card, number)).encode()
    return Enrol(data, (by or invitation_key(number)).sign(ENROL_DOMAIN, data), card.der)
