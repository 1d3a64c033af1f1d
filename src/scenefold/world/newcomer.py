"""The profile of who joins a cluster by a token: keys before the answer, everything else after it (specs/15-cluster-log.md, Enrolling).

    .<profile>.joining-<invitation>/    keys that were made for one token; gone once the profile has them, or no node can have taken them
    .<profile>.joining-<invitation>.<random>/, .<profile>.<random>/, and <profile>/users/.<name>.<random>/ or the like: drafts (leftovers.py)

Keys are made here and go nowhere. They lie on disk before anybody is asked, so that whose answer was lost, or whose clock was wrong, may
ask again with the same ones; the same token with other keys is refused.
"""

from __future__ import annotations

import datetime
import shutil
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from scenefold.base.errors import DamagedData, LocalFault
from scenefold.base.ids import NodeId, address_of
from scenefold.crypto import (
    ENROL_DOMAIN,
    Card,
    Identity,
    MemberSecrets,
    Token,
    authority_pem,
    make_private_folder,
    mark_of,
    new_tls_key,
    pem_of,
    read_secret,
    tls_key_in,
    write_secret,
)
from scenefold.crypto.drafts import name_folder, new_folder, sync_folder
from scenefold.wire.enrol_packets import Enrolled, RequestEnrolment
from scenefold.wire.orders import EnrolForm
from scenefold.world.charter import SEEDS_MAX, facts_of
from scenefold.world.facts import ClusterFacts, Credential
from scenefold.world.keyring import checked_name
from scenefold.world.leftovers import draft_of, sweep_profile
from scenefold.world.profile import ClusterProfile
from scenefold.world.profile_making import AUTHORITY_CERTIFICATE, DEFAULT_USER, SETTINGS, write_settings

USER_AT = NodeId(0)
"""Where a user is: nowhere."""
SOMEWHERE = NodeId(0xFFFF_FFFF)
"""Of a node whose address is not known before a node of the cluster answers it; no machine can have this one."""
_TLS_KEY = "key.pem"


@dataclass(frozen=True, slots=True)
class Newcomer:
    """Who asks: a token, and keys made for it. `node`: USER_AT for a user, SOMEWHERE until it is known. `asked_before`: with these keys."""

    profile: Path
    token: Token
    node: NodeId
    tls_key: bytes
    secrets: MemberSecrets
    asked_before: bool = True

    @classmethod
    def at(cls, profile: Path, token: Token, address: NodeId = USER_AT, *, suite: int = 1) -> Newcomer:
        """With new keys, or those that were made for this token before. LocalFault if the profile is another cluster's, or another user's."""
        known = _known_profile(profile, token)
        if known is not None and address == USER_AT and known.user_folder().exists() and not _draft_of(profile, token).exists():
            remedy = "nothing is left to do if that is you; else name another folder with --profile"
            raise LocalFault(f"the profile is that of user {known.user}", where=str(profile), remedy=remedy)
        folder = _draft_of(profile, token)
        asked_before = (folder / _TLS_KEY).exists()
        if not asked_before:
            _make_keys(profile, folder, suite)
        tls_key = read_secret(folder / _TLS_KEY)
        tls_key_in(tls_key, str(folder / _TLS_KEY))  # Here, where its file can be named.
        return cls(profile, token, address, tls_key, MemberSecrets.from_files(folder), asked_before)

    def request(self) -> RequestEnrolment:
        """What to ask a node. A user is told its name by the answer."""
        key, name = self.token.key, f"node:{self.node}" if self.node else ""
        form = EnrolForm(key.public.raw, name, self.node, tls_key_in(self.tls_key), self.secrets.public().encode()).encode()
        return RequestEnrolment(form=form, signature=key.sign(ENROL_DOMAIN, form))

    def check(self, answer: Enrolled, now: datetime.datetime) -> tuple[ClusterFacts, Card]:
        """What a node has answered; DamagedData if that does not verify, OutOfDate by a wrong clock."""
        authority = authority_pem(answer.authority)
        if mark_of(authority) != self.token.mark:
            raise DamagedData("the answer is of another cluster than the token")
        facts, card = facts_of(answer.charter, authority), Card.verified(answer.certificate, authority, now)
        name = card.name if not self.node and _user_of(card.name) else f"node:{self.node}"
        own = (name, self.secrets.signing.public, self.secrets.sealing.public, tls_key_in(self.tls_key))
        if (card.name, card.keys.signing, card.keys.sealing, card.tls_key) != own:
            raise DamagedData("the certificate is for somebody else, or for other keys than ours")
        return facts, card

    def admitted(self, answer: Enrolled, now: datetime.datetime) -> ClusterProfile:
        """Write the profile by what a node has answered; errors are those of `check`."""
        facts, card = self.check(answer, now)
        authority, name = authority_pem(answer.authority), card.name
        identity = Identity(name, pem_of(card.der), self.tls_key)
        known = _known_profile(self.profile, self.token)
        if known is None:
            _write_new(self.profile, self._facts(facts, known), authority, identity, self.secrets)
        else:
            write_party(self.profile, identity, self.secrets)
            write_settings(self.profile, self._facts(facts, known), answer.charter, user=_user_of(name) or known.user)
        self.forget()
        return ClusterProfile.load(self.profile)

    def forget(self) -> None:
        """Remove the keys that were made for the token: no node has certified them, nor will."""
        folder = _draft_of(self.profile, self.token)
        with suppress(OSError):
            shutil.rmtree(folder)
            sync_folder(folder.parent)

    def _facts(self, chartered: ClusterFacts, known: ClusterProfile | None) -> ClusterFacts:
        """The cluster's facts as this machine shall know them: where to look first, and ourselves."""
        credentials = {one.node_id: one for one in (known.members if known is not None else chartered.credentials)}
        if self.node:
            keys = self.secrets.public()
            credentials[self.node] = Credential(self.node, address_of(self.node), keys.signing, keys.sealing)
        others = [address for address in map(address_of, self.token.addresses) if address != address_of(self.node)]
        seeds = tuple(dict.fromkeys([*others, *chartered.seeds]))[:SEEDS_MAX]
        trusted = () if known is None else known.trusted
        return replace(chartered, credentials=tuple(credentials[node] for node in sorted(credentials)), seeds=seeds, trusted=trusted)


def write_party(profile: Path, identity: Identity, own: MemberSecrets) -> None:
    """A node's or a user's folder in a profile, in place of what a former member of this name left there."""
    user = _user_of(identity.name)
    if user:
        checked_name(user, "user")  # It becomes a path, and who gave it is not asked for trust in that.
    where = profile / "users" / user if user else profile / "nodes" / address_of(NodeId(int(identity.name.removeprefix("node:"))))
    if (where / _TLS_KEY).exists() and read_secret(where / _TLS_KEY) == identity.key:
        return  # We were interrupted after this.
    if where.exists():
        raise LocalFault("keys of this member are in the profile already", where=str(where), remedy="move that folder away, then try again")
    make_private_folder(where.parent)
    sweep_profile(profile)
    try:
        with new_folder(where) as draft:
            identity.to_files(draft)
            own.to_files(draft)
            name_folder(draft, where)
    except OSError as problem:
        raise LocalFault(
            f"cannot write the keys: {problem.strerror or problem}", where=str(where), remedy="check its permissions"
        ) from problem


def _write_new(profile: Path, facts: ClusterFacts, authority: bytes, identity: Identity, own: MemberSecrets) -> None:
    try:
        with draft_of(profile) as draft:
            make_private_folder(draft / AUTHORITY_CERTIFICATE.parent)
            write_secret(draft / AUTHORITY_CERTIFICATE, authority)
            make_private_folder(draft / "scenes")
            write_party(draft, identity, own)
            write_settings(draft, facts, facts.charter, user=_user_of(identity.name) or DEFAULT_USER)
            name_folder(draft, profile)
    except OSError as problem:
        raise LocalFault(f"cannot make the profile: {problem.strerror}", where=str(profile), remedy="choose another folder") from problem


def _make_keys(profile: Path, folder: Path, suite: int) -> None:
    """New keys in `folder`, whole or not at all; nothing if another process has made some there meanwhile."""
    try:
        with draft_of(profile, folder.name.removeprefix(f".{profile.name}")) as draft:
            MemberSecrets.generate(suite).to_files(draft)
            write_secret(draft / _TLS_KEY, new_tls_key())
            if folder.exists() and not (folder / _TLS_KEY).exists():
                shutil.rmtree(folder)  # Earlier versions made them where they are looked for, and one was killed there.
            name_folder(draft, folder)
    except OSError as problem:
        if not (folder / _TLS_KEY).exists():
            remedy = "choose another folder"
            raise LocalFault(f"cannot make the keys: {problem.strerror}", where=str(folder), remedy=remedy) from problem


def _known_profile(profile: Path, token: Token) -> ClusterProfile | None:
    """The profile that is there already; LocalFault if it is another cluster's, or something else is in its place."""
    if not (profile / SETTINGS).exists():
        if profile.exists() and (not profile.is_dir() or any(profile.iterdir())):
            raise LocalFault("the place is taken by something else", where=str(profile), remedy="choose another folder")
        return None
    known = ClusterProfile.load(profile)
    if mark_of(known.authority_certificate()) != token.mark:
        raise LocalFault(
            "the profile is of another cluster than the token", where=str(profile), remedy="name another folder with --profile"
        )
    return known


def _draft_of(profile: Path, token: Token) -> Path:
    return profile.with_name(f".{profile.name}.joining-{token.key.key_id:08x}")


def _user_of(name: str) -> str:
    """The user that a name speaks of; empty for a node."""
    return name.removeprefix("user:") if name.startswith("user:") else ""
