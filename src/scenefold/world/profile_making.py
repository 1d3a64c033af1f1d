"""How the folder of a profile is written: by `cluster init`, and by who is enrolled (profile.py says what lies where)."""

from __future__ import annotations

import base64
import secrets
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from scenefold.base.errors import LocalFault, UsageFault
from scenefold.base.ids import address_of, checked_node_id, node_id_of
from scenefold.base.limits import NODES_MAX
from scenefold.crypto import AUTHORITY_PURPOSE, DEFAULT_SUITE, Authority, Card, MemberSecrets, SigningKey, make_private_folder, write_secret
from scenefold.world.charter import SEEDS_MAX, Charter
from scenefold.world.facts import ClusterFacts, Credential
from scenefold.world.keyring import checked_name
from scenefold.world.ports import Ports
from scenefold.world.toml_files import write_toml

DEFAULT_USER = "owner"
FORMAT = 4
SETTINGS = "cluster.toml"
AUTHORITY_CERTIFICATE = Path("authority/certificate.pem")
LOG_SEED = "log.seed"
LOG_SEED_GIVEN_UP = "log.given-up"
"""In its place, once voters decide the cluster's log by votes (specs/15-cluster-log.md, Voters)."""
GIVEN_UP_WORDS = b"The key of the cluster's log lay here until voters took over, and is erased.\n"
SEALED_AUTHORITY = "authority.sealed"


def checked_addresses(node_addresses: Sequence[str]) -> list[str]:
    """The addresses in id order; LocalFault if one is malformed, doubled, or their number is out of bounds."""
    try:
        ids = sorted(checked_node_id(address) for address in node_addresses)
    except ValueError as problem:
        raise LocalFault(f"{problem}", where="node addresses", remedy="give IPv4 addresses such as 127.0.0.2") from None
    twice = next((first for first, second in pairwise(ids) if first == second), None)
    if twice is not None:
        raise UsageFault("a node address is given twice", where=address_of(twice), remedy="give every address once")
    if not 1 <= len(ids) <= NODES_MAX:
        raise LocalFault(f"{len(ids)} nodes", remedy=f"a cluster has 1 to {NODES_MAX} nodes")
    return [address_of(node_id) for node_id in ids]


def checked_ports(ports: Ports) -> Ports:
    """The ports, if they are two that can be."""
    if not (0 < ports.low < 65536 and 0 < ports.high < 65536) or ports.low == ports.high:
        raise LocalFault(f"{ports.low} and {ports.high} are no two ports", remedy="choose two different numbers from 1 to 65535")
    return ports


def refuse_taken(folder: Path) -> None:
    """LocalFault if a profile cannot be made here, since something is here already."""
    if (folder / SETTINGS).exists():
        raise LocalFault("a cluster profile exists already", where=str(folder), remedy="choose another name, or remove the folder")
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise LocalFault("the place is taken by something else", where=str(folder), remedy="choose another folder")


def write_cluster(
    folder: Path, name: str, addresses: Sequence[str], founders: Sequence[str], ports: Ports, suite: int, *, trust_all: bool = False
) -> None:
    """Authority, keys and settings of a new cluster. The first founder votes, and is trusted with the authority's key; with `trust_all`
    the others are, too. `suite`: the owner's.
    """
    authority = Authority.create(name)
    make_private_folder(folder)
    authority.to_files(folder / "authority")
    members = []
    for address in addresses:
        card = _write_party(authority, folder / "nodes" / address, f"node:{node_id_of(address)}", [address])
        members.append(Credential(node_id_of(address), address, card.keys.signing, card.keys.sealing))
    owner = _write_party(authority, folder / "users" / DEFAULT_USER, f"user:{DEFAULT_USER}", [], suite=suite, is_administrator=True)
    make_private_folder(folder / "scenes")
    voter, log_key = members[addresses.index(founders[0])], SigningKey.generate()
    facts = ClusterFacts(
        name=checked_name(name, "cluster"),
        cluster_id=secrets.token_bytes(16),
        ports=ports,
        seeds=tuple(founders[:SEEDS_MAX]),
        credentials=tuple(members),
        founders=tuple(node_id_of(address) for address in founders),
        voters=(voter.node_id,),
        log_key=log_key.public,
        owners=(owner.der,),
        trusted=tuple(one.node_id for one in members if one is not voter) if trust_all else (),
    )
    log_key.to_file(folder / "nodes" / voter.address / LOG_SEED)
    sealed = voter.sealing_key.seal(authority.key_der(), AUTHORITY_PURPOSE, facts.cluster_id, secrets.token_bytes)
    write_secret(folder / "nodes" / voter.address / SEALED_AUTHORITY, sealed)
    write_settings(folder, facts, Charter.of(facts).signed(authority))


def write_settings(folder: Path, facts: ClusterFacts, charter: bytes, *, user: str = DEFAULT_USER) -> None:
    """cluster.toml, or another one in its place."""
    document: dict[str, Any] = {
        "format": FORMAT,
        "name": facts.name,
        "cluster_id": facts.cluster_id.hex(),
        "seeds": list(facts.seeds),
        "founders": [int(node) for node in facts.founders],
        "voters": [int(node) for node in facts.voters],
        "log_key": facts.log_key.raw.hex(),
        "user": user,
        "charter": base64.b64encode(charter).decode(),
        "ports": {"low": facts.ports.low, "high": facts.ports.high},
        "members": [_member(credential) for credential in facts.credentials],
    }
    if facts.trusted:
        document["trusted"] = [int(node) for node in facts.trusted]
    write_toml(folder / SETTINGS, document)


def _member(credential: Credential) -> dict[str, Any]:
    public = {"public_key": credential.public_key.raw.hex(), "sealing_key": credential.sealing_key.raw.hex()}
    return {"id": int(credential.node_id), "address": credential.address, **public}


def _write_party(
    authority: Authority, folder: Path, name: str, addresses: list[str], *, suite: int = DEFAULT_SUITE, is_administrator: bool = False
) -> Card:
    own = MemberSecrets.generate(suite)
    identity = authority.issue(name, addresses, keys=own.public(is_administrator=is_administrator))
    identity.to_files(folder)
    own.to_files(folder)
    return Card.verified(identity.certificate, authority.certificate)
