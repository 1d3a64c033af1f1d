"""Feeds the wire what strangers may send, for as long as it is told (docs/how-to/fuzz.md).

    PYTHONPATH=tests .venv/bin/python -m fuzz.fuzz_wire --seconds 600

Begins with one of every packet and log entry, spoils them by structure and by bytes, and keeps what was answered in a
way not seen before, so that later rounds spoil the spoilt. Same seed, same inputs. An input that breaks a law, or takes
more than 50 ms for each 64 KiB begun, is written down as hexadecimal, and the run ends with exit code 1.
"""

from __future__ import annotations

import argparse
import json
import random
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgpack

from fuzz import datagrams, enrolling, mutations, scenes
from fuzz.findings import Finding
from fuzz.targets import TARGETS
from scenefold.base.errors import ScenefoldError
from scenefold.base.limits import FRAME_BYTES_MAX
from scenefold.wire import encode_packet, frame, pack_value
from scenefold.wire.log_entries import LOG_ENTRY
from scenefold.wire.log_records import SignedRecord, pack_log
from scenefold.wire.log_snapshots import SHORTENED_LOG, SNAPSHOT_STATE
from scenefold.wire.orders import FORM, ORDER
from scenefold.wire.pieces import pack_piece
from scenefold.wire.scene_headers import SCENE_LOG_PUBLIC
from scenefold.wire.status_packets import STATUS
from scenefold.wire.table import ROWS
from unit.wire.vectors import example, example_packet, example_record

SECONDS_PER_PIECE = 0.05
PIECE_BYTES = 64 * 1024
SEEDS_KEPT_MAX = 2_000
"""Inputs of one target that were answered in a new way, taken or refused; beyond it a random one makes room."""


@dataclass
class Tally:
    """What a run saw."""

    inputs: Counter[str] = field(default_factory=Counter)
    accepted: Counter[str] = field(default_factory=Counter)
    outcomes: set[tuple[str, str]] = field(default_factory=set)
    slowest_ms: float = 0.0
    """Of one input, for each 64 KiB begun."""
    slowest: str = ""
    findings: list[dict[str, str]] = field(default_factory=list)

    def as_json(self) -> dict[str, Any]:
        return {
            "inputs": sum(self.inputs.values()),
            "by_target": dict(sorted(self.inputs.items())),
            "accepted": dict(sorted(self.accepted.items())),
            "distinct_outcomes": len(self.outcomes),
            "slowest_ms_per_64_kib": round(self.slowest_ms, 2),
            "slowest": self.slowest,
            "findings": self.findings,
        }


def seeds() -> dict[str, list[bytes]]:
    """Good inputs for every target."""
    packets = [encode_packet(example_packet(number)) for number in sorted(ROWS)]
    records = [example_record(number).encode() for number in LOG_ENTRY.structs]
    logs = [pack_log([SignedRecord(record, bytes(64)) for record in records[:count]]) for count in (0, 1, len(records))]
    documents = [pack_value(value) for value in (None, {"a": [1, -1, 0.5, True], "b": {"c": b"bytes", "d": "text"}}, [[[]]])]
    return {
        "packet": packets,
        "later": list(packets),
        "frames": [frame(data) for data in packets] + [b"".join(frame(data) for data in packets[:9])],
        "status": [pack_piece(STATUS, example(STATUS, salt)) for salt in range(4)],
        "header": [pack_piece(SCENE_LOG_PUBLIC, example(SCENE_LOG_PUBLIC, salt)) for salt in range(4)],
        "decided": scenes.DECIDED,
        "certificate": scenes.CERTIFICATES,
        "value": scenes.VALUES,
        "body": scenes.BODIES,
        "lockbox": scenes.LOCKBOXES,
        "former": scenes.FORMER,
        "former plain": scenes.FORMER_PLAIN,
        "record": records,
        "log": logs,
        "shortened": scenes.SHORTENED + [pack_piece(SHORTENED_LOG, example(SHORTENED_LOG, salt)) for salt in range(4)],
        "snapshot": scenes.STATES + [pack_piece(SNAPSHOT_STATE, example(SNAPSHOT_STATE, salt)) for salt in range(4)],
        "state": scenes.STATES,
        "datagram": datagrams.SEALED,
        "contents": datagrams.CONTENTS,
        "order": [pack_piece(ORDER, example(ORDER, salt)) for salt in range(4)],
        "form": [pack_piece(FORM, example(FORM, salt)) for salt in range(4)],
        "card": enrolling.CARDS,
        "token": enrolling.TOKENS,
        "question": enrolling.QUESTIONS,
        "document": documents,
    }


class Fuzzer:
    """One run: `step` makes an input and feeds it."""

    def __init__(self, seed: int) -> None:
        self._dice = random.Random(seed)
        self._taken = seeds()
        self._refused: dict[str, list[bytes]] = {name: [] for name in TARGETS}
        self._names = sorted(TARGETS)
        self.tally = Tally()

    def step(self) -> None:
        dice = self._dice
        name = dice.choice(self._names + ["packet"] * 6)
        self.feed(name, self._spoilt(name))

    def feed(self, name: str, data: bytes) -> None:
        """One input to one target, judged."""
        tally = self.tally
        tally.inputs[name] += 1
        begin = time.process_time()
        try:
            outcome = TARGETS[name](data, self._dice)
        except (Finding, ScenefoldError, Exception) as error:  # noqa: BLE001  whatever comes through is what we look for
            tally.findings.append({"target": name, "problem": f"{type(error).__name__}: {error}"[:300], "bytes": data.hex()})
            return
        self._judge_time(name, data, time.process_time() - begin)
        taken = not outcome.startswith("refused")
        tally.accepted[name] += taken
        # What is taken is worth keeping now and then, though its like was seen: it may lead on.
        if (name, outcome) not in tally.outcomes or (taken and self._dice.random() < 0.02):
            tally.outcomes.add((name, outcome))
            self._keep((self._taken if taken else self._refused)[name], data)

    def _keep(self, kept: list[bytes], data: bytes) -> None:
        if len(kept) < SEEDS_KEPT_MAX:
            kept.append(data)
        else:
            kept[self._dice.randrange(len(kept))] = data

    def _judge_time(self, name: str, data: bytes, seconds: float) -> None:
        pieces = 1 + len(data) // PIECE_BYTES
        if seconds > SECONDS_PER_PIECE * pieces:
            # A collection of garbage, or a page that was not there, may have come in between: it is not slow each time.
            for _ in range(3):
                begin = time.process_time()
                TARGETS[name](data, self._dice)
                seconds = min(seconds, time.process_time() - begin)
            if seconds > SECONDS_PER_PIECE * pieces:
                problem = f"{seconds * 1e3:.0f} ms for {len(data)} bytes"
                self.tally.findings.append({"target": name, "problem": problem, "bytes": data[:4096].hex()})
        milliseconds = seconds * 1e3 / pieces
        if milliseconds > self.tally.slowest_ms:
            self.tally.slowest_ms, self.tally.slowest = milliseconds, f"{name}, {len(data)} bytes, {data[:12].hex()}"

    def _spoilt(self, name: str) -> bytes:
        dice = self._dice
        refused = self._refused[name]
        known = refused if refused and dice.random() < 0.2 else self._taken[name]
        data = dice.choice(known)
        if name == "frames" and dice.random() < 0.5:
            return b"".join(frame(self._spoilt("packet")[:FRAME_BYTES_MAX] or b"\0") for _ in range(dice.randrange(1, 4)))
        match dice.randrange(12):
            case 0 | 1 | 2 | 3 | 4:
                spoilt = data
                for _ in range(dice.choice([1, 1, 2, 4])):
                    try:
                        spoilt = mutations.spoil_tree(spoilt, dice)
                    except (ValueError, TypeError, msgpack.UnpackException):
                        spoilt = mutations.spoil_bytes(spoilt, dice)
            case 5 | 6 | 7:
                spoilt = mutations.spoil_bytes(data, dice)
            case 8:
                spoilt = mutations.longer_form(data, dice)
            case 9:
                spoilt = mutations.spliced(data, dice.choice(known), dice)
            case 10:
                spoilt = dice.randbytes(dice.randrange(200))
            case _:
                spoilt = mutations.hostile(data, dice) if dice.random() < 0.1 else data[:3] + dice.randbytes(dice.randrange(100))
        return spoilt[: 4 * PIECE_BYTES]


def main() -> int:
    parser = argparse.ArgumentParser(description="Feed the wire what strangers may send.")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path, help="write findings to this file, as JSON")
    options = parser.parse_args()
    fuzzer = Fuzzer(options.seed)
    end = time.monotonic() + options.seconds
    while time.monotonic() < end and len(fuzzer.tally.findings) < 20:
        fuzzer.step()
    report = json.dumps(fuzzer.tally.as_json(), indent=2)
    if options.keep is not None:
        options.keep.write_text(report + "\n", encoding="utf-8")
    print(report)
    return 1 if fuzzer.tally.findings else 0


if __name__ == "__main__":
    raise SystemExit(main())
