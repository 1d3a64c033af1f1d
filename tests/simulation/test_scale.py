"""If this fails, a larger cluster is slow to start, to know itself, or to notice a death; or talks too much; or the measuring is broken."""

from __future__ import annotations

import json

import pytest

from scenefold.simulation import scale
from scenefold.simulation.cluster import Cluster

NODES = 20
crash = Cluster.crash


@pytest.mark.slow
def test_twenty_nodes_in_virtual_minutes(capsys: pytest.CaptureFixture[str]) -> None:
    assert scale.main(["--nodes", str(NODES), "--only", "traffic,join,removal", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["violations"] == [] and not found["prepared"]
    assert found["start_s"] < 10 and found["start_datagrams_per_node"] < 4 * NODES, (
        "a start is not a flood, the challenges of first contacts included"
    )
    assert found["table_complete_s"] < 2
    assert found["removal_s"] < 150
    told = found["a_node_and_second"]
    assert told["gossip"]["messages"] < 1.5 and told["leases"]["messages"] < 0.6
    assert told["log"]["messages"] < 0.1, "who has a lease knows that its log is the newest"


@pytest.mark.slow
def test_a_cluster_from_prepared_disks_lives(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scale, "FEW", 4)
    assert scale.main(["--nodes", "9", "--only", "join,loss", "--loss-s", "60", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["prepared"] and found["violations"] == [] and found["false_removals"] == 0
    assert found["joiner_is_member_s"] < 10 and found["table_complete_s"] < 10


def test_what_is_waited_for_in_vain_is_said_and_fails(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scale, "REMOVAL_S_MAX", 5.0)
    assert scale.main(["--nodes", "3", "--only", "join,removal", "--json"]) == 1
    output = capsys.readouterr()
    found = json.loads(output.out)
    assert found["removal_s"] is None and found["table_complete_s"] is not None
    assert output.err == "did not come: removal_s\n"


def test_a_violation_is_said_and_fails(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Cluster, "crash", _crash_by_itself)
    assert scale.main(["--nodes", "3", "--only", "removal", "--json"]) == 1
    output = capsys.readouterr()
    assert len(json.loads(output.out)["violations"]) == 1
    assert output.err.startswith("violated: n1 ends by itself: ValueError: gone\n")


def _crash_by_itself(cluster: Cluster, slot: int, *, silent: bool) -> bool:
    """The node does not die from outside, but of a fault of its own, and its machine is never seen again."""
    node = cluster.nodes[slot]
    cluster._judge_end(node, [ValueError("gone")], came_up=True)
    return crash(cluster, slot, silent=silent)


@pytest.mark.parametrize("arguments", ["--nodes 2", "--nodes x", "--only joy", "--loss-s 0", "--seed -1"])
def test_wrong_usage_is_one_line(arguments: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        scale.main(arguments.split())
    output = capsys.readouterr()
    assert (ended.value.code, output.out, output.err.count("\n")) == (2, "", 1)
