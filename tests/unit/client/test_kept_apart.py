"""If this fails, nobody learns that a node keeps something that only who can read it may let go."""

from __future__ import annotations

import pytest

from scenectl.health_text import health_text
from scenefold.base.errors import PeerFault
from scenefold.client.cluster_health import Condition
from unit.client.test_cluster_health import health, nodes
from unit.client.test_health import ADDRESSES, arc, report

APART = {"records": 12, "scenes": [{"scene": "0000abcd", "records": 9}, {"scene": "00000007", "records": 3}]}


def test_what_a_node_keeps_apart_is_told_and_degrades_nothing() -> None:
    found = health(*nodes(suspects=APART))
    assert (found.condition, found.kept_apart, found.document()["kept_apart"]) == (Condition.HEALTHY, 12, 12)
    assert found.document()["nodes"][0]["kept_apart"] == APART
    text = health_text(found)
    assert f"{ADDRESSES[0]} keeps 12 records apart" in text and "of scenes 0000abcd (9), 00000007 (3)" in text
    assert "scenectl scene strays" in text


def test_who_keeps_nothing_apart_or_is_of_an_earlier_version_says_nothing() -> None:
    assert health(*nodes()).kept_apart == 0
    assert "apart" not in health_text(health(*nodes()))


@pytest.mark.parametrize("scene", ["\x1b[2J", "kitchen", "", 7])
def test_what_is_no_scene_is_no_report(scene: object) -> None:
    with pytest.raises(PeerFault):
        report(ADDRESSES[0], arc(0, 1), suspects={"records": 1, "scenes": [{"scene": scene, "records": 1}]})
