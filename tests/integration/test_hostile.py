"""If this fails, a stranger or a member can keep a node from serving others, or have it store or tell what nobody signed."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import pytest
import trio

from integration.living_clusters import living_cluster
from loopback import ports_option
from scenectl.attacks import ATTACKS, BY_MEMBERS, LIARS
from scenectl.attacks.running import Report, attacking
from scenectl.bench_hostile import BATCH, NODE, OPTIONS, Honest, aimed, counted, honest_places, memory_bytes
from scenectl.program import main
from scenefold.client import Cluster

ROUNDS = 5
"""Of honest work beside each attack at least, each of a whole batch written and read, and none may fail."""
HAPPENS_S_MAX = 60.0
GROWTH_BYTES_MAX = 96 << 20
"""Of all nodes under one attack: a peer may have 64 MiB under way."""
ROUNDS_PER_FLOOD = 0.02
"""Of honest work, for each request of a flood that is answered meanwhile: both are slow on a slow machine. With shares there are four times
as many and more; a member that had no share left as many as this."""
STRANGERS = ("silent strangers", "garbage", "handshakes", "forged datagrams")
HOLDERS = ("silent members", "a byte a second", "enormous lengths", "malformed packets", "flood of requests")
FORGERS = ("forged records", "others' names", "replayed datagrams", "an old record played again")
HAPPENS = {
    "silent strangers": ("closed by the node", 100),
    "garbage": ("closed by the node", 10),
    "handshakes": ("closed by the node", 10),
    "forged datagrams": ("sent", 100),
    "forged datagrams, true address": ("sent", 100),
    "replayed datagrams": ("sent", 1_000),
    "silent members": ("refused", 100),
    "a byte a second": ("closed by the node", 10),
    "enormous lengths": ("closed by the node", 2),
    "malformed packets": ("closed by the node", 3),
    "others' names": ("not_authorised", 20),
    "forged records": ("signature_invalid", 64),
    "forged records from a member": ("signature_invalid", 64),
    "an old record played again": ("stale_version", 10),
    "flood of requests": ("of these after a quarter of a second", 300),
    "flood by a member": ("of these after a quarter of a second", 300),
    "answers with garbage": ("lies refused", 16),
    "answers with an old version": ("old, and the reader was warned", 16),
}
"""What the attacker sees of each attack's end, and how often before it is judged."""
NEVER = ("taken", "wrong, and taken")


def judge(name: str, report: Report, node_counted: Counter[str], rounds: int) -> None:
    """What must have happened, and what must not."""
    seen = report.seen
    assert not any(seen.get(what, 0) for what in NEVER), seen
    match name:
        case "replayed datagrams":
            assert 0 < seen["answers"] <= 50 + report.seconds / 0.05, "each counts once"
            assert seen["sent"] > 10 * seen["answers"]
        case "forged datagrams" | "forged datagrams, true address":
            assert node_counted["datagrams dropped"] >= HAPPENS[name][1], "each is dropped, unless the kernel did"
        case "handshakes":
            assert node_counted["turned away"] > 0 and seen["answered"] <= 2 * (64 + 16 * report.seconds), "so many are left to one address"
        case "silent members":
            assert node_counted["turned away"] > 0 and seen["opened"] <= 64 + 16 * report.seconds
        case "flood of requests" | "flood by a member":
            assert rounds >= ROUNDS_PER_FLOOD * seen["answered"], "the flood had more than its share"


async def under_attack(cluster: Cluster, honest: Honest, settings: dict[str, object], name: str) -> None:
    """Work until enough has happened, and judge it."""
    node_before, rounds = await counted(cluster, str(settings["address"])), 0
    what, often = HAPPENS[name]
    async with attacking(settings) as report:
        with trio.move_on_after(HAPPENS_S_MAX) as patience:
            while rounds < ROUNDS or report.seen.get(what, 0) < often:
                await honest.work(1)
                rounds += 1
    assert not patience.cancelled_caught, f"{name}: {rounds} rounds, and of {what!r} no {often}: {report.seen}"
    judge(name, report, await counted(cluster, str(settings["address"])) - node_before, rounds)


@pytest.mark.slow
@pytest.mark.parametrize("names", [STRANGERS, HOLDERS, FORGERS, BY_MEMBERS], ids=["strangers", "holders", "forgers", "members"])
async def test_honest_clients_go_on_being_served(names: Sequence[str], tmp_path: Path) -> None:
    async with living_cluster(tmp_path, 2, spares=1, options=OPTIONS, module=NODE) as living:
        scene = await living.cluster.scenes.open("kept")
        honest = Honest(living.kept.space, honest_places())
        await honest.work(ROUNDS)
        for name in names:
            honest.places = honest_places()[: BATCH // 2 if name in LIARS else BATCH]
            before = memory_bytes(living.nodes)
            await under_attack(living.cluster, honest, aimed(living.nodes, scene, name), name)
            assert memory_bytes(living.nodes) - before < GROWTH_BYTES_MAX, name
        honest.places = honest_places()
        await honest.work(1)
        assert not honest.wrong
        assert not (await living.cluster.look()).degraded


def test_every_attack_is_tried() -> None:
    assert {*STRANGERS, *HOLDERS, *FORGERS, *BY_MEMBERS} == set(ATTACKS) == set(HAPPENS)


@pytest.mark.slow
def test_the_table_is_measured(capsys: pytest.CaptureFixture[str]) -> None:
    ports = ports_option("127.0.0.2", "127.0.0.3")
    assert (
        main(["bench", "hostile", "--attack", "garbage", "--seconds", "1", "--rounds", "2", "--nodes", "1", "--ports", ports, "--json"])
        == 0
    )
    report = json.loads(capsys.readouterr().out)
    (row,) = report["attacks"]
    assert report["wrong_bytes"] == report["failed_calls"] == 0
    assert row["seen"]["sent"] > 0 and row["records_per_second"] > 0 and row["beside_a_burner"] > 0


def test_an_attack_that_there_is_not_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "hostile", "--attack", "kindness"]) == 1
    assert "forged records" in capsys.readouterr().err
