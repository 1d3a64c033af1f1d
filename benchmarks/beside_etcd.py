"""Scenefold's log of a scene beside etcd on one machine, in turns within the same minutes.

    python benchmarks/beside_etcd.py --etcd FOLDER/usr/bin/etcd --turns 3

Five members each, on 127.0.0.2 to 127.0.0.6: small changes one after the other, by 16 clients at once, and the time from a `kill -9` of who leads
(proposes) while somebody asks to the next acknowledgement through another member. etcd by its gateway of JSON, asked where it leads, with its own defaults:
every write is synced; without TLS unless --tls. Scenefold by `scenectl bench log`. Medians of the turns count.

What is compared is not the same: etcd's members believe each other, and a put is a key and a value; here every promise and vote is
signed and verified, since a log must hold where its members are strangers, and a change is an owner's signed header with the sealed log.

Ends with 77 and a reason if etcd cannot be had here.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from http.client import HTTPException
from itertools import count, islice
from pathlib import Path
from typing import Any

from etcd_members import HOW_TO_HAVE_IT, Asked, CannotBe, Member, Members, running, until_put, version_of

MEMBERS = 5
VALUE_BYTES = 64
SKIPPED = 77
WAYS = {"one_client": ("one_client", "one client"), "one_scene": ("clients", "{clients} clients, one scene")}
WAYS["a_scene_each"] = ("clients", "{clients} clients, a scene each")
"""By our measurement: etcd's, and words for both."""


def main() -> int:
    options = _options()
    scenectl, program = shutil.which(options.scenectl), shutil.which(options.etcd)
    try:
        if program is None:
            raise CannotBe(f"there is no program {options.etcd}; {HOW_TO_HAVE_IT}")
        if scenectl is None:
            raise CannotBe(f"there is no program {options.scenectl}; name it with --scenectl")
        version = version_of(Path(program))
        turns = [_turn(Path(program), scenectl, options) for _ in range(options.turns)]
    except CannotBe as problem:
        print(f"skipped: {problem}", file=sys.stderr)
        return SKIPPED
    report = {"etcd_version": version, "members": MEMBERS, "tls": options.tls, "clients": options.clients, "turns": turns}
    report["compared"] = compared(turns)
    print(json.dumps(report, indent=2) if options.json else text(report))
    return 0


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--etcd", default="etcd", help="the program; by default the one that the system finds")
    parser.add_argument("--tls", action="store_true", help="etcd with TLS of its own, between members and to clients")
    parser.add_argument("--turns", type=int, default=3, help="how often both take turns")
    parser.add_argument("--puts", type=int, default=1000, help="of etcd, one after the other, and as many by all clients")
    parser.add_argument("--commits", type=int, default=100, help="of Scenefold, likewise; at most 100")
    parser.add_argument("--clients", type=int, default=16)
    parser.add_argument("--kills", type=int, default=3, help="of who leads, each turn")
    parser.add_argument(
        "--scenectl", default=str(Path(sys.executable).with_name("scenectl")), help="the program; by default beside this Python"
    )
    parser.add_argument("--ports", help="ports of Scenefold's nodes, LOW,HIGH")
    parser.add_argument("--json", action="store_true")
    return parser.parse_args()


def _turn(program: Path, scenectl: str, options: argparse.Namespace) -> dict[str, Any]:
    with tempfile.TemporaryDirectory(prefix="beside-etcd-") as folder, running(program, Path(folder), MEMBERS, tls=options.tls) as members:
        theirs = {
            "one_client": _puts(members, 1, options.puts),
            "clients": _puts(members, options.clients, options.puts),
            "killed": [_killed(members) for _ in range(options.kills)],
        }
    return {"etcd": theirs, "scenefold": _ours(scenectl, options)}


# ------------------------------------------------------------------------------------------------------------- etcd


def _puts(members: Members, clients: int, puts: int) -> dict[str, float]:
    leader = members.leader()
    numbers: Iterator[int] = iter(range(puts))
    lock = threading.Lock()

    def client(number: int) -> list[float]:
        asked, waits = leader.asked(), []
        while True:
            with lock:
                if not list(islice(numbers, 1)):
                    break
            begun = time.monotonic()
            asked.put(f"bench/{number}", os.urandom(VALUE_BYTES))
            waits.append(time.monotonic() - begun)
        asked.close()
        return waits

    cpu_s, begun = members.cpu_s() + time.process_time(), time.monotonic()
    with ThreadPoolExecutor(clients) as pool:
        waits = [wait for found in pool.map(client, range(clients)) for wait in found]
    seconds, spent = time.monotonic() - begun, members.cpu_s() + time.process_time() - cpu_s
    cuts = statistics.quantiles(waits, n=100, method="inclusive")
    return {
        "commits_per_s": puts / seconds,
        "p50_ms": 1000 * cuts[49],
        "p99_ms": 1000 * cuts[98],
        "cpu_ms_per_commit": 1000 * spent / puts,
    }


def _killed(members: Members) -> float:
    """Seconds from the leader's death, while somebody puts there, to the next acknowledgement of another member."""
    leader = members.leader()
    others = [member for member in members.all if member is not leader]
    stop = threading.Event()
    puts = threading.Thread(target=_keep_putting, args=(leader, stop))
    puts.start()
    time.sleep(0.5)
    members.kill(leader)
    dead_at = time.monotonic()
    until_put(others, _put_once)
    seconds = time.monotonic() - dead_at
    stop.set()
    puts.join()
    members.start(leader)
    members.leader()
    return seconds


def _keep_putting(member: Member, stop: threading.Event) -> None:
    asked = member.asked()
    for number in count():
        if stop.is_set():
            return
        with suppress(OSError, HTTPException):
            asked.put("bench/killed", str(number).encode())


def _put_once(asked: Asked) -> None:
    asked.put("bench/next", b"next")


# ------------------------------------------------------------------------------------------------------------- ours


def _ours(scenectl: str, options: argparse.Namespace) -> dict[str, Any]:
    command = [scenectl, "bench", "log", "--participants", str(MEMBERS), "--commits", str(options.commits), "--json"]
    command += ["--clients", str(options.clients), "--kills", str(options.kills), *(["--ports", options.ports] if options.ports else [])]
    environment = {name: value for name, value in os.environ.items() if name != "SCENEFOLD_PROFILE"}
    done = subprocess.run(command, stdout=subprocess.PIPE, check=False, env=environment)
    if done.returncode:
        raise SystemExit(f"scenectl bench log ended with {done.returncode}")
    (row,) = json.loads(done.stdout)["participants"]
    found: dict[str, Any] = {way: row[way] for way in WAYS}
    return found | {"killed": row["killed"]["next_commit_s"]}


def compared(turns: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Medians of the turns, for each way of asking, and all waits after deaths."""
    found: dict[str, Any] = {}
    for ours, (theirs, _) in WAYS.items():
        found[ours] = {
            who: {key: _median(turn[who][way][key] for turn in turns) for key in ("commits_per_s", "p50_ms", "p99_ms", "cpu_ms_per_commit")}
            for who, way in (("etcd", theirs), ("scenefold", ours))
        }
    found["killed"] = {who: sorted(wait for turn in turns for wait in turn[who]["killed"]) for who in ("etcd", "scenefold")}
    return found


def _median(values: Iterator[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return statistics.median(known) if known else None


def text(report: Mapping[str, Any]) -> str:
    """The report for people."""
    heads = ("", "", "a second", "median ms", "99 % ms", "processor ms")
    rows: list[Sequence[str]] = [heads]
    for way, (_, words) in WAYS.items():
        for who, turn in report["compared"][way].items():
            figures = [turn[key] for key in ("commits_per_s", "p50_ms", "p99_ms", "cpu_ms_per_commit")]
            rows.append((words.format(clients=report["clients"]), who, *("" if one is None else f"{one:,.1f}" for one in figures)))
    widths = [max(len(row[column]) for row in rows) for column in range(len(heads))]
    lines = ["  ".join(word.ljust(width) for word, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    killed = report["compared"]["killed"]
    lines += [f"who leads killed, {who}: {', '.join(f'{wait:.2f}' for wait in waits)} s" for who, waits in killed.items()]
    lines.append(f"etcd {report['etcd_version']}, {report['members']} members, {'with' if report['tls'] else 'without'} TLS")
    return "\n".join(lines)


if __name__ == "__main__":
    raise SystemExit(main())
