"""If this fails, a stranger or a member can keep a node from serving others, or have it store or tell what nobody signed."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import pytest
import trio

from integration.living_clusters import SPACE, living_cluster
from loopback import ports_option
from scenectl.attacks import ATTACKS
from scenectl.attacks.running import attacking
from scenectl.bench_hostile import BATCH, Honest, memory_bytes
from scenectl.program import main
from scenefold.base.location import LINE_LENGTH, Location

LAST_S = 1.0
"""What an attack has for itself: some need that long to do anything."""
ROUNDS = 5
GROWTH_BYTES_MAX = 512 << 20
STRANGERS = ("silent strangers", "garbage", "handshakes", "forged datagrams")
MEMBERS = ("silent members", "a byte a second", "enormous lengths", "malformed packets", "flood of requests")
FORGERS = ("forged records", "others' names", "replayed datagrams")


def judge(name: str, seen: dict[str, int], seconds: float) -> None:
    """What must have happened, and what must not."""
    assert sum(seen.values()) > 0, "nobody attacked"
    match name:
        case "forged records" | "others' names":
            assert "taken" not in seen
        case "replayed datagrams":
            assert 0 < seen["answers"] <= 50 + seconds / 0.05, "each counts once"
            assert seen["sent"] > 10 * seen["answers"]
        case "silent strangers" | "garbage" | "enormous lengths":
            assert seen["closed by the node"] > 0


@pytest.mark.slow
@pytest.mark.parametrize("names", [STRANGERS, MEMBERS, FORGERS], ids=["strangers", "members", "forgers"])
async def test_honest_clients_go_on_being_served(names: Sequence[str], tmp_path: Path) -> None:
    places = [Location.from_number(LINE_LENGTH * (2 * index + 1) // (2 * BATCH)) for index in range(BATCH)]
    async with living_cluster(tmp_path, 2, spares=1) as living:
        scene = await living.cluster.scenes.open("kept")
        honest = Honest(living.kept.space, places)
        await honest.work(1)
        before = memory_bytes(living.nodes)
        aim = {
            "profile": str(living.nodes.profile),
            "address": living.nodes.addresses[0],
            "scene": scene.id,
            "space": SPACE,
            "place": places[0].hex(),
        }
        for name in names:
            async with attacking({**aim, "attack": name}) as report:
                with trio.fail_after(60):
                    await trio.sleep(LAST_S)
                    await honest.work(ROUNDS)
            judge(name, report.seen, report.seconds)
            assert memory_bytes(living.nodes) - before < GROWTH_BYTES_MAX, name
        await honest.work(1)
        assert not honest.wrong
        assert not (await living.cluster.look()).degraded


def test_every_attack_is_tried() -> None:
    assert {*STRANGERS, *MEMBERS, *FORGERS} == set(ATTACKS)


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
