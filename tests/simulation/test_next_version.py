"""If one fails, a cluster does not stay whole while it is brought to the next version, one node after the other."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from unittest import mock

import pytest

from following_version import BOTH, TODAY, Wave, next_version
from scenefold.base.errors import Refused
from scenefold.base.reasons import RejectReason
from scenefold.simulation.faults import Kind
from scenefold.simulation.outcome import Order
from scenefold.simulation.run import run
from scenefold.wire import NotSpoken, RequestTable, RespondTable
from scenefold.world import Priority, open_links
from scenefold.world.sim import SimNet
from simulation.quiet import Rest, at_rest
from simulation.runs import fail_with_stories

pytestmark = pytest.mark.timeout(600)
"""A storm ends by its virtual time. What this machine does besides may only make it slow."""
SEED = 1_003
OF_ALL_WORK = {
    "PutMany",
    "GetMany",
    "GetCopies",
    "StoreCopies",
    "SetCustody",
    "CompareRange",
    "RangeCompared",
    "FetchHeld",
    "ClaimRange",
    "RequestSceneLog",
}
"""Writes, reads, copies, comparing and healing, handovers, logs: packets that must have been read on connections of the next version."""


@contextmanager
def half_upgraded() -> Iterator[tuple[Counter[str], Counter[str]]]:
    """Every second process takes the next version, and so does each that is started again; what was read in it, and who began as what."""
    names: dict[str, int] = {}
    began = Counter[str]()
    make = SimNet.world

    def world(net: SimNet, name: str, *arguments: Any, **options: Any) -> Any:
        is_new = name not in names
        versions = TODAY if is_new and names.setdefault(name, len(names)) % 2 == 0 else BOTH
        began[f"{'first' if is_new else 'later'} {versions}"] += 1
        return make(net, name, *arguments, **{"versions": versions, **options})

    with next_version() as met, mock.patch.object(SimNet, "world", world):
        yield met, began


@pytest.mark.parametrize(("seed", "kinds"), [(SEED + 2, ()), (SEED, (Kind.CRASH, Kind.WIPED_DISK))], ids=["a storm", "upgraded one by one"])
def test_programs_of_two_versions_are_one_cluster(seed: int, kinds: tuple[Kind, ...]) -> None:
    with half_upgraded() as (met, began):
        result = run(Order(seed, copies=True, kinds=kinds))
    fail_with_stories([result])
    assert result.violations == ()
    assert began[f"first {TODAY}"] and began[f"first {BOTH}"] and began[f"later {BOTH}"]
    assert met.keys() >= OF_ALL_WORK, "nothing of a kind was said in the next version"


def test_what_only_the_next_version_knows_is_refused_and_all_else_goes_on() -> None:
    heard: list[tuple[str, type[Refused], RejectReason]] = []

    async def look(rest: Rest) -> None:
        async with open_links(rest.cluster.net.world("user:later", versions=BOTH)) as links:
            for node in rest.cluster.founding:
                with pytest.raises(Refused) as refused:
                    await links.request(node.address, Priority.HIGH, Wave("hello"), timeout_s=5.0)
                heard.append((node.address, type(refused.value), refused.value.reason))
                answer = await links.request(node.address, Priority.HIGH, RequestTable(), timeout_s=5.0)
                assert isinstance(answer, RespondTable)

    with half_upgraded():
        at_rest(look)
    assert {reason for _, _, reason in heard} == {RejectReason.ILL_FORMED}
    assert {kind for _, kind, _ in heard} == {NotSpoken, Refused}, "by who asks, and by a node that has the version, but no answer"
