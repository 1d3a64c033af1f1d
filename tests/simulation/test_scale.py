"""If this fails, a larger cluster is slow to start, to know itself, or to notice a death; or talks too much; or the measuring is broken."""

from __future__ import annotations

import json

import pytest

from scenefold.simulation import scale


@pytest.mark.slow
def test_thirty_nodes_in_virtual_minutes(capsys: pytest.CaptureFixture[str]) -> None:
    assert scale.main(["--nodes", "30", "--only", "traffic,join,removal", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["violations"] == [] and not found["prepared"]
    assert found["start_s"] < 10 and found["start_datagrams_per_node"] < 3 * 30, "a start is not a flood"
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
