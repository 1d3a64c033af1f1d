"""The logs that several decide: rows that can be read, one behind the other (specs/21-verify.md). Certificates are not looked at: who learns
from them looks himself."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby, pairwise

from scenefold.base.errors import DamagedData
from scenefold.store.checking.findings import Finding, Helps, named
from scenefold.store.checking.fixes import delete
from scenefold.store.checking.tables import EVERY_KEY
from scenefold.store.layout import LOGS
from scenefold.store.log_rows import GENESIS_BYTES, decided_key, position_of, unpack_decided, unpack_votes, votes_key
from scenefold.world.ports import ReadTransaction


def check_logs(raw: ReadTransaction) -> Iterator[Finding]:
    """Nothing of this stops a node: it does not vote in that log, and asks the others for what is decided."""
    for genesis, keys in groupby(raw.keys(LOGS, *EVERY_KEY), lambda key: key[:GENESIS_BYTES]):
        positions = list[int]()
        for key in keys:
            position = position_of(key)
            if position is None:
                yield Finding(LOGS, named(LOGS, key), "a row under a key that names no log", Helps.MEND, delete(LOGS, key))
            elif position:
                positions.append(position)
                yield from _decided(raw, key)
        yield from _gaps(genesis, positions)
        if positions or (len(genesis) == GENESIS_BYTES and raw.get(LOGS, votes_key(genesis)) is not None):
            yield from _votes(raw, genesis, positions)


def _decided(raw: ReadTransaction, key: bytes) -> Iterator[Finding]:
    stored = raw.get(LOGS, key)
    assert stored is not None
    try:
        unpack_decided(key, stored)
    except DamagedData as damage:
        yield Finding(LOGS, named(LOGS, key), damage.what, Helps.FETCH)


def _gaps(genesis: bytes, positions: list[int]) -> Iterator[Finding]:
    for before, behind in pairwise(positions):
        if behind != before + 1:
            yield Finding(LOGS, named(LOGS, decided_key(genesis, before + 1)), "what is decided there is not there", Helps.FETCH)


def _votes(raw: ReadTransaction, genesis: bytes, positions: list[int]) -> Iterator[Finding]:
    where, stored = named(LOGS, votes_key(genesis)), raw.get(LOGS, votes_key(genesis))
    if stored is None:
        yield Finding(LOGS, where, "what this node has voted for is not there", Helps.FETCH)
        return
    try:
        opened = unpack_votes(genesis, stored).position
    except DamagedData as damage:
        yield Finding(LOGS, where, damage.what, Helps.FETCH)
        return
    if positions and opened != positions[-1] + 1:
        yield Finding(LOGS, where, f"they are of position {opened}, and {positions[-1]} is the newest that is decided", Helps.FETCH)
