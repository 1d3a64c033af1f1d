"""Whose folder this is: node, format, incarnation, boot (design: storage, members and owners).

The incarnation is drawn when the folder is made, so that a wiped node is seen to be a newcomer; the boot counter rises
durably at every start, so that what the node says of itself is above all that it said before. A node that the cluster
has removed draws a new incarnation (`RenewIdentity`): it comes back as a newcomer that has some records.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

from scenefold.base.errors import LocalFault
from scenefold.base.ids import NodeId, address_of
from scenefold.store.digest_changes import unbuild
from scenefold.store.layout import HOLDING, IDENTITY, LOGS, NOTES, RECORDS, STATISTICS, SUSPECTS, space_of
from scenefold.store.sealing import WIPE, StoreDamaged
from scenefold.world.ports import DiskFailed, DiskFull, Environment, WriteTransaction

FORMAT_VERSION = 4
"""4: digests and debts. 3: records of version 2. 2: a checksum on everything, node-managed records, the holding. A folder of 3, or an older one that holds no record, becomes 4."""
INCARNATION_BYTES = 16

_NUMBER = struct.Struct(">I")


@dataclass(frozen=True, slots=True)
class StoreIdentity:
    """What a Status says of the node's data: 128 bits of incarnation, 32 bits of boot counter, the first is 1."""

    node: NodeId
    incarnation: bytes
    boot: int


def claim(environment: Environment, folder: str, node: NodeId, new_incarnation: bytes) -> StoreIdentity:
    """Make the folder this node's if it is new, and count the start. LocalFault if it is somebody else's."""
    assert len(new_incarnation) == INCARNATION_BYTES

    def begin(transaction: WriteTransaction) -> StoreIdentity:
        if transaction.get(IDENTITY, b"format") is None:
            _begin_folder(transaction, folder, node, new_incarnation)
        _check(transaction, folder, node)
        if _number(transaction, b"format", folder) < FORMAT_VERSION:
            # Its records are put into trees bit by bit, while the node runs.
            for key in list(transaction.keys(STATISTICS, b"", b"\xff" * 6)):
                unbuild(transaction, space_of(key))
        transaction.put(IDENTITY, b"format", _NUMBER.pack(FORMAT_VERSION))
        incarnation = bytes(_value(transaction, b"incarnation", folder))
        boot = _number(transaction, b"boot", folder) + 1
        transaction.put(IDENTITY, b"boot", _NUMBER.pack(boot))
        return StoreIdentity(node, incarnation, boot)

    try:
        return environment.update(begin)
    except (DiskFull, DiskFailed) as error:
        raise LocalFault(str(error), where=folder, remedy="free some space, or see to the disk") from error


def _begin_folder(transaction: WriteTransaction, folder: str, node: NodeId, incarnation: bytes) -> None:
    for table in (RECORDS, IDENTITY, HOLDING, NOTES, SUSPECTS, LOGS):
        if next(transaction.keys(table, b"", b"\xff" * 64), None) is not None:
            raise StoreDamaged(f"the store has {table} but no identity", where=folder, remedy=WIPE)
    transaction.put(IDENTITY, b"format", _NUMBER.pack(FORMAT_VERSION))
    transaction.put(IDENTITY, b"node", _NUMBER.pack(node))
    transaction.put(IDENTITY, b"incarnation", incarnation)
    transaction.put(IDENTITY, b"boot", _NUMBER.pack(0))


def _check(transaction: WriteTransaction, folder: str, node: NodeId) -> None:
    version = _number(transaction, b"format", folder)
    if version > FORMAT_VERSION:
        raise LocalFault(
            f"the data folder was written by a newer scenefold (format {version}, this one knows {FORMAT_VERSION})",
            where=folder,
            remedy="upgrade this node",
        )
    owner = NodeId(_number(transaction, b"node", folder))
    if owner != node:
        raise LocalFault(
            f"the data folder belongs to node {address_of(owner)}, not to {address_of(node)}",
            where=folder,
            remedy="give each node a data folder of its own",
        )


def _value(transaction: WriteTransaction, name: bytes, folder: str) -> memoryview:
    value = transaction.get(IDENTITY, name)
    if value is None:
        raise StoreDamaged(f"the store's identity lacks {name.decode()!r}", where=folder, remedy=WIPE)
    return value


def _number(transaction: WriteTransaction, name: bytes, folder: str) -> int:
    value = _value(transaction, name, folder)
    if len(value) != _NUMBER.size:
        raise StoreDamaged(f"the store's {name.decode()!r} is damaged", where=folder, remedy=WIPE)
    return int(_NUMBER.unpack(value)[0])
