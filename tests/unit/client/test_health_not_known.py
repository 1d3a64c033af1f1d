"""If one fails, `cluster health` says that all is well, or soon will be, where nobody knows that, or somebody has to do something."""

from __future__ import annotations

from scenefold.client.cluster_health import ClusterHealth, Condition
from unit.client.test_cluster_health import copies, health, kinds, nodes
from unit.client.test_health import ADDRESSES


def test_rot_that_could_not_be_counted_is_not_healthy() -> None:
    for waiting, text in ((0, "it is not known how many are not healed"), (7, "of those that it knows 7 are being fetched from others")):
        found = health(*nodes(copies(rotten={"waiting": waiting, "unhealed": 0, "healed": 9, "more": True})))
        assert (found.condition, kinds(found), found.seconds_to_health) == (Condition.DEGRADED, ["rotten"], None)
        assert text in found.ailments[0].text and "drain" in found.ailments[0].to_do
    assert health(*nodes(copies(rotten={"waiting": 0, "unhealed": 0, "healed": 9, "more": False}))).condition is Condition.HEALTHY


def test_copies_that_a_full_disk_does_not_take_are_not_waited_for() -> None:
    def owed(*, full: bool) -> ClusterHealth:
        nodes_owed = [{"address": ADDRESSES[1], "records": 7, "alive": True}]
        told = copies(owed={"records": 7, "records_to_silent": 0, "nodes": nodes_owed}, full=[ADDRESSES[1 if full else 2]])
        return health(*nodes(told))

    found = owed(full=True)
    assert kinds(found) == ["no room", "pending"] and found.seconds_to_health is None
    assert not found.ailments[1].mends_itself and ADDRESSES[1] in found.ailments[1].to_do and "--capacity" in found.ailments[1].to_do
    assert owed(full=False).ailments[1].mends_itself
