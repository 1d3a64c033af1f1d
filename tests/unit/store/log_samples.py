"""Logs that several decide, for tests of what the store keeps of them; and their golden bytes.

`PYTHONPATH=tests python -m unit.store.log_samples` writes `specs/vectors/log_rows.json` anew.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from scenefold.base.ids import NodeId
from scenefold.consensus import Certificate, Slot, Tentative, Value, Vote
from scenefold.store.log_rows import Decided, Votes, pack_decided, pack_votes
from scenefold.wire import Ballot, Member

GENESIS = bytes(range(32))
LIFE = bytes(range(16))
PATH = Path(__file__).resolve().parents[3] / "specs" / "vectors" / "log_rows.json"


def ballot(counter: int, node: int = 1) -> Ballot:
    return Ballot(counter, NodeId(node))


def value(number: int) -> Value:
    return Value(b"value %d" % number, b"body" if number % 2 == 0 else b"")


def decided(position: int, *, voters: int = 3) -> Decided:
    what, when = value(position), ballot(position)
    votes = [
        Vote(position, when, what.digest, Member(NodeId(node), bytes([node]) * 16), bytes([node]) * 64) for node in range(1, voters + 1)
    ]
    return Decided(position, what, Certificate(position, when, tuple(votes)))


def slot(*, promised: int = 5, accepted: int = 3) -> Slot:
    exposed = frozenset({value(8).digest, value(9).digest})
    return Slot(ballot(promised), Tentative(ballot(accepted, 2), value(8)), exposed)


ROWS: dict[str, Votes | Decided] = {
    "nothing promised": Votes(LIFE, 1),
    "promised": Votes(LIFE, 2, Slot(ballot(7))),
    "voted": Votes(LIFE, 3, slot()),
    "silent": Votes(LIFE, 4, Slot(), silent_until=9),
    "decided by one": decided(1, voters=1),
    "decided by three": decided(2),
}


def packed(row: Votes | Decided) -> bytes:
    return pack_votes(GENESIS, row) if isinstance(row, Votes) else pack_decided(GENESIS, row)


def made() -> dict[str, Any]:
    return {"genesis": GENESIS.hex(), "rows": {name: packed(row).hex() for name, row in ROWS.items()}}


if __name__ == "__main__":
    PATH.write_text(json.dumps(made(), indent=1) + "\n", encoding="utf-8")
