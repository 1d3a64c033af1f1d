"""What members and nodes show of scenes: headers with their decisions, lockboxes, former keys, snapshots. A value or the refusal of its kind, nothing else."""

from __future__ import annotations

import json
import random

from cryptography.hazmat.primitives.ciphers.aead import AESGCM

from fuzz.findings import Finding
from house.sources import ROOT
from scenefold.base.errors import DamagedData, Refused
from scenefold.client.births import verified_header_key
from scenefold.crypto import SigningKey, open_former, seal_former
from scenefold.peer.scene_log.headers import checked_header
from scenefold.scene.log import Contents, packed_state, unpacked_state
from scenefold.wire import MalformedPacket, Role, SceneLogPublic, ShortenedLog, SignedSnapshot
from unit.peer.scenes_made import HEADER_KEY, first_header, later_header

_FIRST = first_header()
_HEADERS = [_FIRST, later_header(_FIRST), later_header(_FIRST, position=9, write_floor=3, key_epoch=1)]
_VOTED = json.loads((ROOT / "specs" / "vectors" / "consensus.json").read_text(encoding="utf-8"))["scene"]
DECIDED = [*(header.encode() for header in _HEADERS), *map(bytes.fromhex, _VOTED["headers"])]
CERTIFICATES = [bytes.fromhex(data) for data in _VOTED["certificates"]]
VALUES, BODIES = ([bytes.fromhex(_VOTED["value"][part])] for part in ("kept", "body"))

_SNAPSHOT = json.loads((ROOT / "specs" / "vectors" / "scene_log.json").read_text(encoding="utf-8"))["shortened"]
STATES = [bytes.fromhex(_SNAPSHOT["state"])]
SHORTENED = [ShortenedLog(SignedSnapshot(STATES[0], bytes.fromhex(_SNAPSHOT["signature"])), ()).encode()]

LOCKBOXES = [
    Contents(role, epoch, b"k" * 24, HEADER_KEY.public, name, "user:ada", HEADER_KEY.seed if role is Role.OWNER else None).encode()
    for epoch, (role, name) in enumerate(((Role.READER, "kitchen"), (Role.WRITER, ""), (Role.OWNER, "k" * 64)))
]

_GENESIS, _KEY, _NONCE, _EPOCH = b"g" * 32, b"s" * 24, b"n" * 12, 5
FORMER_PLAIN = [bytes(24 * _EPOCH), bytes(range(24)) * _EPOCH]
FORMER = [
    seal_former(dict.fromkeys(range(_EPOCH), key), genesis=_GENESIS, key_epoch=_EPOCH, symmetric_key=_KEY, nonce=_NONCE)
    for key in (bytes(24), bytes(range(24)))
]


def decided(data: bytes, _dice: random.Random) -> str:
    """Nodes and clients believe a header that was decided, and none that somebody has touched."""
    try:
        header = SceneLogPublic.decode(data)
    except MalformedPacket as error:
        return f"refused {error.field}"
    problems = []
    for check, refusal in ((lambda: checked_header(header, None), Refused), (lambda: verified_header_key(header), DamagedData)):
        try:
            check()
        except refusal as error:
            problems.append(error.what)
    # Clients look at less: at what a first header says of itself nodes alone.
    if (data in DECIDED) == bool(problems):
        raise Finding(f"a header is believed that nobody decided, or not that was: {problems}")
    return f"refused {problems[0][:60]}" if problems else "accepted a header"


def lockbox(data: bytes, _dice: random.Random) -> str:
    """What an owner has sealed who keeps to no format."""
    try:
        found = Contents.decode(data)
    except DamagedData as error:
        return f"refused {error.what}"
    if found.encode() != data:
        raise Finding("a lockbox was accepted from bytes that are not its own")
    if found.header_seed is not None and SigningKey(found.header_seed).public != found.header_key:
        raise Finding("a lockbox was accepted with the seed of another key")
    return f"accepted lockbox of a {found.role.name}"


def state(data: bytes, _dice: random.Random) -> str:
    """What an owner has signed in place of records, and no fold has ever come to, perhaps."""
    try:
        found = unpacked_state(data)
    except MalformedPacket as error:
        return f"refused {error.field}"
    except (DamagedData, Refused) as error:
        return f"refused {error.what}"
    if packed_state(found) != data:
        raise Finding("a state was accepted from bytes that are not its own")
    for space in found.spaces.values():
        if not (space.name and space.transform.factor > 0.0 and found.grants.members):
            raise Finding("a state was accepted that no log comes to")
    return f"accepted a state of {len(found.spaces)} spaces"


def former(data: bytes, _dice: random.Random) -> str:
    """What nobody has sealed opens as nothing."""
    try:
        found = open_former(data, genesis=_GENESIS, key_epoch=_EPOCH, symmetric_key=_KEY)
    except DamagedData as error:
        return f"refused {error.what}"
    if data not in FORMER:
        raise Finding("former keys open that nobody has sealed")
    return f"accepted {len(found)} former keys"


def former_plain(data: bytes, dice: random.Random) -> str:
    """What a member has sealed who keeps to no format."""
    associated = bytes((21,)) + b"scenefold/former-keys" + _GENESIS + _EPOCH.to_bytes(4, "big")
    nonce = dice.randbytes(12)
    try:
        found = open_former(nonce + AESGCM(_KEY).encrypt(nonce, data, associated), genesis=_GENESIS, key_epoch=_EPOCH, symmetric_key=_KEY)
    except DamagedData as error:
        return f"refused {error.what}"
    if b"".join(found.values()) != data or list(found) != list(range(_EPOCH)):
        raise Finding("former keys were accepted from bytes that are not their own")
    return "accepted former keys"
