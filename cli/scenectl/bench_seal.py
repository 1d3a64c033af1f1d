"""What `bench seal` does: sealing and verifying as clients and nodes do it, beside the same calls of the library made bare.

Ours is what a client runs for a batch (client/sealing.py) and what a node runs for one (peer/records/verification.py), headers, places and
writers looked at. Bare is AES-GCM, SHA-256 and a signature of as many bytes as a header has, and nothing around them. Both get the
same payloads, in batches as clients make them, and keep what they make. All works take turns. One core: seconds of one thread's
processor time. Two: two threads at once, by the wall clock, each with all of the work.
"""

from __future__ import annotations

import os
import statistics
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from scenectl.output import size_text, table

if TYPE_CHECKING:
    from scenefold.base.measuring import Work
    from scenefold.crypto import SigningKey

SIZES = (60 * 1024, 1024)
WORKS = ("seal", "sign", "verify", "open")
_RECORDS_MAX = {1: 1024, 2: 64}
"""Of a batch, by suite: an RSA signature takes fifty times as long."""
_TURN_RECORDS = 128
"""That one turn works on at least in the first suite, so that it takes some 20 ms."""


@dataclass(frozen=True, kw_only=True)
class SealBench:
    """What to measure."""

    records: int
    """Of a batch at most; a client makes them of a mebibyte, which are 17 of 60 KiB."""
    rounds: int
    threads: int


def bench_seal(bench: SealBench) -> dict[str, Any]:
    """Measure and return the report (docs/reference/scenectl.md)."""
    from scenefold.base.measuring import Rate, seconds_in_turns
    from scenefold.crypto import SUITES, SigningKey

    results: list[dict[str, Any]] = []
    headline = 0.0
    for suite in SUITES.values():
        key = SigningKey.generate(suite.number)
        for size in SIZES:
            works = _works(key, size, bench.records)
            alone: dict[str, Rate] = {}
            for cores in range(1, bench.threads + 1):
                timed = works if cores == 1 else [_in_threads(work, cores) for work in works]
                seconds = seconds_in_turns(timed, time.thread_time if cores == 1 else time.monotonic, bench.rounds)
                rates = {work.name: Rate.of(work.items, seconds[work.name]) for work in timed}
                alone = alone or rates
                ratio = _ratio(seconds)
                headline = headline or ratio
                results.append(
                    {
                        "suite": suite.name,
                        "payload_bytes": size,
                        "cores": cores,
                        "works": {name: _row(name, size, rates, alone) for name in WORKS},
                        "ratio_to_bare": ratio,
                    }
                )
    return {"rounds": bench.rounds, "results": results, "ratio_to_bare_60kib": headline}


def bench_text(report: Mapping[str, Any]) -> str:
    """The report for people."""
    rows: list[tuple[str, ...]] = []
    for result in report["results"]:
        for name, work in result["works"].items():
            rate, bare = work["records_per_second"]["median"], work["bare_records_per_second"]["median"]
            what = (result["suite"], size_text(result["payload_bytes"]), str(result["cores"]), name)
            volume = "-" if name == "sign" else size_text(round(rate * result["payload_bytes"])) + "/s"
            rows.append((*what, f"{rate:,.0f}", volume, f"{bare:,.0f}", f"{work['ratio']:.2f}", f"{work['gain']:.2f}"))
    heads = ("suite", "payload", "threads", "work", "records/s", "payload/s", "bare records/s", "of bare", "x one thread")
    headline = f"seal, sign and verify 60 KiB, default suite, one core: {report['ratio_to_bare_60kib']:.0%} of the bare calls"
    return f"{table(heads, rows)}\n{headline}"


def _row(name: str, size: int, rates: Mapping[str, Any], alone: Mapping[str, Any]) -> dict[str, Any]:
    ours, bare = rates[name], rates[f"bare {name}"]
    return {
        "records_per_second": asdict(ours),
        "payload_bytes_per_second": None if name == "sign" else ours.median * size,
        "bare_records_per_second": asdict(bare),
        "ratio": ours.median / bare.median,
        "gain": ours.median / alone[name].median,
        "bare_gain": bare.median / alone[f"bare {name}"].median,
    }


def _ratio(seconds: Mapping[str, Sequence[float]]) -> float:
    """Of sealing, signing and verifying together: the median of the rounds."""
    bare = map(sum, zip(seconds["bare seal"], seconds["bare verify"], strict=True))
    ours = map(sum, zip(seconds["seal"], seconds["verify"], strict=True))
    return statistics.median(b / o for b, o in zip(bare, ours, strict=True))


def _works(key: SigningKey, size: int, most: int) -> list[Work]:
    """Ours and bare, in turns; `seal` signs, too."""
    from scenefold.base.ids import SceneId, SpaceId
    from scenefold.base.limits import CLIENT_BATCH_BYTES
    from scenefold.base.location import Location
    from scenefold.base.measuring import Work
    from scenefold.client.sealing import Draft, SceneIdentity, open_all, seal_all
    from scenefold.client.verifying import writers_of
    from scenefold.crypto import ED25519, RECORD_DOMAIN, Record, new_symmetric_key
    from scenefold.crypto.bare import BareCalls
    from scenefold.peer.records.verification import KnownScene, verify_all
    from scenefold.scene.log import EpochKeys
    from scenefold.wire import RecordBytes

    count = min(CLIENT_BATCH_BYTES // size, _RECORDS_MAX[key.suite], most)
    times = max(min(_TURN_RECORDS, most) // count, 1) if key.suite == ED25519 else 1
    space, symmetric_key = SpaceId(10), new_symmetric_key(os.urandom)
    header = _scene(key, space)
    places = [Location.from_number(number) for number in range(count)]
    drafts = [Draft(space, place, os.urandom(size), None, number, os.urandom(12)) for number, place in enumerate(places)]
    identity = SceneIdentity(SceneId(header.scene), header.genesis, 1, writers_of(header), EpochKeys.only(symmetric_key))
    items = seal_all(identity, key, 1, drafts)
    claims = [(item, KnownScene.of(header)) for item in items]
    records = [RecordBytes(item.signature, item.header, item.ciphertext) for item in items]
    sealed = [Record(item.header, item.signature, item.ciphertext) for item in items]
    bare = BareCalls(key, symmetric_key, sealed, [draft.payload for draft in drafts])
    assert [type(verdict).__name__ for verdict in verify_all(claims)] == ["Put"] * count

    def sign() -> None:
        for item in items:
            key.sign(RECORD_DOMAIN, item.header)

    runs: dict[str, Callable[[], object]] = {
        "seal": partial(seal_all, identity, key, 1, drafts),
        "bare seal": bare.seal,
        "sign": sign,
        "bare sign": bare.sign,
        "verify": partial(verify_all, claims),
        "bare verify": bare.verify,
        "open": partial(open_all, identity, [(space, place) for place in places], records),
        "bare open": bare.open,
    }
    return [Work(name, count * times, partial(_repeat, times, run)) for name, run in runs.items()]


def _scene(key: SigningKey, space: Any) -> Any:
    """A public header that names the writer; nobody looks at its own signature here."""
    from scenefold.base.ids import KeyId, NodeId, SceneId
    from scenefold.base.location import FIRST
    from scenefold.wire import NO_GENESIS, KeyEntry, SceneLogPublic, SceneMode, SpaceEntry, WriterEntry

    return SceneLogPublic(
        scene=SceneId(1),
        genesis=NO_GENESIS,
        origin=NodeId(1),
        position=1,
        write_floor=0,
        mode=SceneMode.EDIT,
        spaces=(SpaceEntry(space, type(space)(0), FIRST, 1, 1, render_output=False, node_managed=False),),
        writers=(WriterEntry(key.key_id, 0, 2**64 - 1),),
        public_key=key.key_id,
        private_key=KeyId(0),
        keys=(KeyEntry(key.suite, key.public.raw),),
        first_key=key.public.raw[:32],
    ).with_genesis()


def _repeat(times: int, run: Callable[[], object]) -> None:
    for _ in range(times):
        run()


def _in_threads(work: Work, threads: int) -> Work:
    """The work, done by so many threads at once, each all of it."""
    from scenefold.base.measuring import Work

    def run() -> None:
        running = [threading.Thread(target=work.run) for _ in range(threads)]
        for thread in running:
            thread.start()
        for thread in running:
            thread.join()

    return Work(work.name, work.items * threads, run)
