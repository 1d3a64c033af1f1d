"""A cluster as one user or node sees it on disk: who belongs to it, and the keys to speak there.

Written by `scenectl cluster init`, read by every client and node (design page ux, Set-up):

    cluster.toml             name, cluster id, ports, seeds, nodes (id, address, public keys), founders, voters, the
                             public key of the cluster's log, the charter that says this under the authority's
                             signature, and which user's keys clients take
    authority/               the cluster's certificate authority; its key is needed only to admit others
    nodes/<address>/         a node's TLS identity, signing and sealing key; a voter's also holds the seed of the log's key
    users/<name>/            a user's TLS identity, signing and sealing key
    scenes/<name>.toml       keys of scenes (keyring.py)
    members.log              what clients have read of the cluster's log (log_file.py); may be removed, and comes back

A machine needs only its own part: cluster.toml, the authority's certificate, and its own folder under nodes/ or users/.
So each file is read when it is asked for, and a missing one is that request's error.
The profile says who has credentials, not who is a member: founders are from the start, spares join and anybody may
be removed, and all that stands in the cluster's log. The lowest of the founders is its voter.
"""

from __future__ import annotations

import base64
import ipaddress
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from scenefold.base.errors import DamagedData, LocalFault, UsageFault
from scenefold.base.ids import NodeId
from scenefold.base.limits import NODES_MAX
from scenefold.crypto import (
    DEFAULT_SUITE,
    Authority,
    Identity,
    MemberSecrets,
    PublicKey,
    SealingPublicKey,
    SecretFolder,
    SigningKey,
    read_authority_certificate,
    read_secret,
    write_secret,
)
from scenefold.crypto.authority import CERTIFICATE_FILE
from scenefold.crypto.drafts import name_folder
from scenefold.crypto.secrets_on_disk import read_certificate
from scenefold.wire import SceneLogPublic
from scenefold.world.charter import facts_of
from scenefold.world.facts import ClusterFacts, Credential
from scenefold.world.keyring import Keyring, checked_name
from scenefold.world.leftovers import draft_of
from scenefold.world.ports import Ports
from scenefold.world.profile_making import (
    DEFAULT_USER,
    FORMAT,
    GIVEN_UP_WORDS,
    LOG_SEED,
    LOG_SEED_GIVEN_UP,
    SEALED_AUTHORITY,
    SETTINGS,
    checked_addresses,
    checked_ports,
    refuse_taken,
    write_cluster,
)
from scenefold.world.toml_files import damaged, read_settings_toml


@dataclass(frozen=True, slots=True)
class ClusterProfile:
    """The profile in `folder`. `members`: all nodes with credentials in id order, spares among them."""

    folder: Path
    name: str
    cluster_id: bytes
    ports: Ports
    seeds: tuple[str, ...]
    members: tuple[Credential, ...]
    founders: tuple[NodeId, ...]
    voters: tuple[NodeId, ...]
    log_key: PublicKey
    charter: bytes
    user: str = DEFAULT_USER
    """Whose keys clients take if nobody says otherwise."""
    trusted: tuple[NodeId, ...] = ()
    """Whom the cluster trusts from its start, besides its voter."""

    @classmethod
    def create(
        cls,
        folder: Path,
        name: str,
        node_addresses: Sequence[str],
        *,
        spares: Sequence[str] = (),
        ports: Ports | None = None,
        suite: int = DEFAULT_SUITE,
        trust_all: bool = False,
    ) -> ClusterProfile:
        """Make a new cluster with these nodes and the user "owner" in `folder`, whole or not at all.

        The nodes found the cluster; `spares` get credentials, so that they can join it later. `folder` must not
        exist, or be empty. `suite` is that of the user's keys. `trust_all`: the cluster trusts all of them, spares too, from its start,
        and not its first node alone. Takes some ten milliseconds a node.
        """
        checked_name(name, "cluster")
        founders, addresses = checked_addresses(node_addresses), checked_addresses([*node_addresses, *spares])
        ports = checked_ports(ports or Ports())
        refuse_taken(folder)
        try:
            with draft_of(folder) as draft:
                write_cluster(draft, name, addresses, founders, ports, suite, trust_all=trust_all)
                name_folder(draft, folder)  # fails if somebody filled `folder` meanwhile
        except OSError as problem:
            raise LocalFault(f"cannot make the profile: {problem.strerror}", where=str(folder), remedy="choose another folder") from problem
        return cls.load(folder)

    @classmethod
    def load(cls, folder: Path) -> ClusterProfile:
        """Read cluster.toml; LocalFault if there is no profile or it is damaged. Keys are read when asked for."""
        path = folder / SETTINGS
        if not path.exists():
            raise LocalFault("there is no cluster profile", where=str(folder), remedy="make one with `scenectl cluster init`")
        document = read_settings_toml(path)
        if document.get("format") != FORMAT:
            raise _other_format(path, document.get("format"))
        try:
            return _decoded(folder, document)
        except (KeyError, TypeError, ValueError, OverflowError, LocalFault, DamagedData) as problem:
            raise damaged(path, f"{type(problem).__name__} {problem}") from problem

    @property
    def keyring(self) -> Keyring:
        return Keyring(self.folder / "scenes")

    def facts(self) -> ClusterFacts:
        """What a node is told of its cluster. LocalFault without the authority's certificate, DamagedData if the charter is not its."""
        authority = self.authority_certificate()
        return replace(self._own_facts(), authority=authority, charter=self.charter, owners=self._chartered(authority).owners)

    @property
    def genesis_header(self) -> SceneLogPublic:
        """The unsigned header with which the cluster's log begins."""
        return self._own_facts().genesis_header

    def owners(self) -> tuple[bytes, ...]:
        """Cards (DER) of the users that the cluster began with, by its charter; errors as those of `facts`."""
        return self._chartered(self.authority_certificate()).owners

    def _chartered(self, authority: bytes) -> ClusterFacts:
        try:
            return facts_of(self.charter, authority)
        except DamagedData as problem:
            raise type(problem)(problem.what, where=str(self.folder / SETTINGS), remedy="restore it from a backup") from None

    def _own_facts(self) -> ClusterFacts:
        return ClusterFacts(
            name=self.name,
            cluster_id=self.cluster_id,
            ports=self.ports,
            seeds=self.seeds,
            credentials=self.members,
            founders=self.founders,
            voters=self.voters,
            log_key=self.log_key,
            trusted=self.trusted,
        )

    @property
    def voter(self) -> Credential:
        """The node that decides the cluster's log, and those of new scenes."""
        return next(member for member in self.members if member.node_id == self.voters[0])

    def member(self, address: str) -> Credential:
        """The node at an address; LocalFault if none has credentials for it."""
        for member in self.members:
            if member.address == address:
                return member
        known = ", ".join(member.address for member in self.members)
        raise LocalFault(f"{address} is no node of this cluster", where=f"{self.folder}", remedy=f"choose of {known}")

    def spare_here(self, *, besides: str) -> str:
        """The address of the one node whose keys lie here, that is no founder and not `besides`; UsageFault if there is not one."""
        spares = [member for member in self.members if member.node_id not in self.founders and member.address != besides]
        here = [member.address for member in spares if self.node_folder(member.address).is_dir()]
        if len(here) == 1:
            return here[0]
        where = str(self.folder / "nodes")
        if here:
            raise UsageFault("keys of several spares are here", where=where, remedy=f"choose with --address, of {', '.join(here)}")
        known = ", ".join(member.address for member in spares)
        remedy = f"copy the folder of one of {known} there" if known else "make the cluster with --spares, or name a node with --address"
        raise UsageFault("no keys of a spare are here", where=where, remedy=remedy)

    def authority(self) -> Authority:
        """The authority with its key, to admit others; absent from most machines."""
        return Authority.from_files(self.folder / "authority")

    def authority_certificate(self) -> bytes:
        """The certificate (PEM) that every certificate of the cluster verifies under."""
        return read_authority_certificate(self.folder / "authority")

    def node_identity(self, address: str) -> Identity:
        return Identity.from_files(self.node_folder(address))

    def keep_user_certificate(self, certificate: bytes) -> None:
        """Put a newer certificate (PEM) for the same keys in place of the user's."""
        write_secret(self.user_folder() / CERTIFICATE_FILE, certificate, replace=True)

    def keep_node_certificate(self, address: str, certificate: bytes) -> None:
        """Put a newer certificate (PEM) for the same keys in place of a node's."""
        write_secret(self.node_folder(address) / CERTIFICATE_FILE, certificate, replace=True)

    def node_secrets(self, address: str) -> MemberSecrets:
        """The keys that the node signs with and opens what is sealed to it; LocalFault if they are not the registered ones."""
        folder, member = self.node_folder(address), self.member(address)
        secrets = MemberSecrets.from_files(folder)
        for name in secrets.files_besides(member.public_key, member.sealing_key):
            raise damaged(folder / name, f"these are not the keys that are registered for {address}")
        return secrets

    def log_signing_key(self, address: str) -> SigningKey | None:
        """The key that signs the cluster's log, if the node has it and has not given it up; LocalFault if it is not the known one."""
        if self.member(address).node_id not in self.voters or (self.node_folder(address) / LOG_SEED_GIVEN_UP).exists():
            return None
        path = self.node_folder(address) / LOG_SEED
        key = SigningKey.from_file(path)
        if key.public != self.log_key:
            raise damaged(path, "it is not the key of this cluster's log")
        return key

    def forget_log_key(self, address: str) -> None:
        """Erase the key that signs the cluster's log from the node's folder, since votes decide from now on. OSError if that fails."""
        folder = self.node_folder(address)
        if not (folder / LOG_SEED_GIVEN_UP).exists():
            write_secret(folder / LOG_SEED_GIVEN_UP, GIVEN_UP_WORDS)
        (folder / LOG_SEED).unlink(missing_ok=True)

    def sealed_authority(self, address: str) -> bytes | None:
        """The authority's key as it was sealed to a node when the cluster was made; None for all nodes but one."""
        path = self.node_folder(address) / SEALED_AUTHORITY
        return read_secret(path) if path.exists() else None

    def user_identity(self, user: str | None = None, secrets: SecretFolder | None = None) -> Identity:
        """`secrets`: the user's folder, opened, if a passphrase locks it."""
        return Identity.from_files(self.user_folder(user), secrets)

    def user_certificate(self) -> bytes:
        """The certificate (PEM) of the user, which is no secret."""
        return read_certificate(self.user_folder() / CERTIFICATE_FILE)

    def user_secrets(self, user: str | None = None, secrets: SecretFolder | None = None) -> MemberSecrets:
        """`secrets`: the user's folder, opened, if a passphrase locks it."""
        return MemberSecrets.from_files(self.user_folder(user), secrets)

    def node_folder(self, address: str) -> Path:
        """Where the keys of a node lie, or would."""
        return self.folder / "nodes" / self.member(address).address

    def user_folder(self, user: str | None = None) -> Path:
        """Where the keys of a user lie, or would."""
        return self.folder / "users" / checked_name(self.user if user is None else user, "user")


def _other_format(path: Path, found: object) -> LocalFault:
    if not isinstance(found, int) or found is True:
        return damaged(path, "it names no format")
    if found < FORMAT:
        what = f"the profile has format {found}, of an earlier version of this program, which knows format {FORMAT}"
        remedy = "move the folder away, then make the cluster anew (`scenectl cluster init`), or join by a token (`scenectl cluster join`)"
    else:
        what = f"the profile has format {found}, and this program knows format {FORMAT}"
        remedy = "use the version of the program that wrote it, or a later one"
    return LocalFault(what, where=str(path), remedy=remedy)


def _decoded(folder: Path, document: dict[str, Any]) -> ClusterProfile:
    members = tuple(
        Credential(
            NodeId(int(entry["id"])),
            str(ipaddress.IPv4Address(entry["address"])),
            PublicKey(bytes.fromhex(entry["public_key"])),
            SealingPublicKey(bytes.fromhex(entry["sealing_key"])),
        )
        for entry in document["members"]
    )
    ids = [member.node_id for member in members]
    if not members or len(members) > NODES_MAX or ids != sorted(set(ids)):
        raise ValueError("members must be in id order, each once")
    cluster_id = bytes.fromhex(document["cluster_id"])
    if len(cluster_id) != 16:
        raise ValueError("cluster_id must have 16 bytes")
    profile = ClusterProfile(
        folder=folder,
        name=checked_name(document["name"], "cluster"),
        cluster_id=cluster_id,
        ports=checked_ports(Ports(int(document["ports"]["low"]), int(document["ports"]["high"]))),
        seeds=tuple(str(ipaddress.IPv4Address(seed)) for seed in document["seeds"]),
        members=members,
        founders=tuple(NodeId(int(node)) for node in document["founders"]),
        voters=tuple(NodeId(int(node)) for node in document["voters"]),
        log_key=PublicKey(bytes.fromhex(document["log_key"])),
        charter=base64.b64decode(document["charter"], validate=True),
        user=checked_name(document.get("user", DEFAULT_USER), "user"),
        trusted=tuple(NodeId(int(node)) for node in document.get("trusted", ())),
    )
    profile._own_facts()  # it says what does not fit
    return profile
