"""A digest of all that a scene's image depends on, put together from what each node holds (specs/08-passes.md, *Kept renders*). Pure.

A scene's own digest (`SceneDocument.digest`) is of what an import wrote; a record that was changed by itself since then is no part of it.
A group's digest covers its geometry and the textures that it wears. A node tells the sum of those of the groups that no
node before it holds: so the sum over all nodes is that of all groups, each once, however space is divided.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence

from scenefold.base.errors import PeerFault, Refused
from scenefold.base.reasons import RejectReason
from scenefold.partition import Partition
from scenefold.render.content import share_of, worn_textures
from scenefold.render.job import Job
from scenefold.scene.payloads.geometry import GeometryAtom
from scenefold.scene.tables import SceneTables

DIGEST_BYTES = 32
_MODULUS = 1 << 8 * DIGEST_BYTES


def own_groups(tables: SceneTables, partition: Partition, me: int, held: Iterable[int]) -> list[int]:
    """Of the groups that a node holds those that no node before it does."""
    before = {int(group) for node in range(me) for group in share_of(tables, partition, node).groups}
    return [int(group) for group in held if int(group) not in before]


def sum_of_groups(
    tables: SceneTables,
    groups: Iterable[int],
    payloads: Mapping[int, Sequence[bytes | None]],
    atoms: Mapping[int, list[GeometryAtom]],
    tiles: Mapping[int, Sequence[bytes | None]],
) -> bytes:
    """The sum of these groups' digests, modulo 2^256. `payloads`: of each one's atoms; `tiles`: payloads by texture."""
    textures = {number: _digest(b"texture", number, payloads_of) for number, payloads_of in tiles.items()}
    total = 0
    for group in groups:
        worn = worn_textures(tables, {group: atoms[group]})
        total += int.from_bytes(_digest(b"group", group, (*payloads[group], *(textures[number] for number in worn))), "big")
    return (total % _MODULUS).to_bytes(DIGEST_BYTES, "big")


def digest_told(value: object) -> bytes:
    """A node's sum, as it told it. PeerFault if it is none."""
    if not isinstance(value, bytes) or len(value) != DIGEST_BYTES:
        raise PeerFault("a node tells no digest of what it holds")
    return value


def digest_of_pools(job: Job, told: Sequence[object]) -> bytes:
    """Of a job's scene, by what all of its nodes told, in their order. Refused (16) if two pools have read different ones."""
    sums = [digest_told(value) for value in told]
    digests = {digest_of_scene(job.content, sums[places.start : places.stop]) for places in job.division.ranges}
    if len(digests) > 1:
        raise Refused(RejectReason.NOT_READY, "the scene was changed while nodes read it", remedy="start the render again")
    return digests.pop()


def digest_of_scene(content: bytes, sums: Iterable[bytes]) -> bytes:
    """Of the scene's own digest, and what each node told."""
    total = sum(int.from_bytes(one, "big") for one in sums) % _MODULUS
    return hashlib.sha256(b"scenefold/whole scene" + content + total.to_bytes(DIGEST_BYTES, "big")).digest()


def _digest(what: bytes, number: int, parts: Iterable[bytes | None]) -> bytes:
    digest = hashlib.sha256(what + number.to_bytes(8, "big"))
    for part in parts:
        digest.update(hashlib.sha256(part or b"").digest())
    return digest.digest()
