"""If this fails, a kept render goes on with a scene that some of its nodes read before an edit, and others after it."""

from __future__ import annotations

from dataclasses import replace

import pytest

from scenefold.base.errors import PeerFault, Refused
from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.partition import Partition
from scenefold.render.pool.whole_scene import digest_of_pools, digest_of_scene
from unit.render.test_job import JOB

TWO, ONE = Partition.voronoi([[0, 0, 0], [1, 0, 0]]), Partition.voronoi([[0, 0, 0]])
POOLS = replace(JOB, nodes=tuple(NodeId(1 + node) for node in range(5)), partition=TWO, others=(ONE, TWO))


def told(*numbers: int) -> list[bytes]:
    return [number.to_bytes(32, "big") for number in numbers]


def test_each_pool_tells_of_the_whole_scene_however_it_is_divided() -> None:
    assert digest_of_pools(POOLS, told(3, 4, 7, 6, 1)) == digest_of_scene(POOLS.content, told(7))
    assert digest_of_pools(JOB, told(3, 4)) == digest_of_scene(JOB.content, told(7))


@pytest.mark.parametrize("sums", [(3, 4, 7, 6, 2), (3, 4, 8, 6, 1), (2, 4, 7, 6, 1)])
def test_pools_that_read_different_scenes_render_none(sums: tuple[int, ...]) -> None:
    with pytest.raises(Refused, match="was changed while nodes read it") as refused:
        digest_of_pools(POOLS, told(*sums))
    assert refused.value.reason is RejectReason.NOT_READY, "it may be begun anew"


def test_what_is_no_digest_is_none() -> None:
    with pytest.raises(PeerFault):
        digest_of_pools(JOB, [bytes(32), None])
