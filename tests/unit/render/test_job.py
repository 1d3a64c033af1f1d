"""If this fails, nodes of one job render different things, or a foreign document makes a node do what it should not."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.errors import PeerFault, UsageFault
from scenefold.base.ids import NodeId, SceneId
from scenefold.partition import Partition
from scenefold.render.algorithms import ALGORITHMS
from scenefold.render.job import Job, RenderOptions
from scenefold.render.lens import Lens
from scenefold.render.levels import Adaptive
from scenefold.render.sampling import Sampling
from scenefold.render.sealed_keys import SealedKeys
from scenefold.render.window import Window
from scenefold.scene.head import SceneHead
from scenefold.wire import pack_value, unpack_value

JOB = Job(
    id=2**63 + 5,
    scene=SceneId(3),
    genesis=bytes(range(32)),
    keys=SealedKeys(
        ((NodeId(0x7F000002), b"a box"), (NodeId(0x7F000003), b"another one"), (NodeId(0x7F000004), b"of one that left")), b"what they open"
    ),
    content=bytes(32),
    numeric_class="embree-4.3.3-avx2-embreex-4.3.3",
    width=640,
    height=360,
    samples=64,
    seed=2**63 - 1,
    frame=0,
    depth=8,
    sky=(0.1, 0.2, 1e-300),
    camera=tuple(float(number) / 7 for number in range(16)),
    nodes=(NodeId(0x7F000002), NodeId(0x7F000003)),
    partition=Partition.voronoi([[0, 0, 0], [1, 2, 3]]),
    layers=("direct", "samples"),
    crop=Window(600, 300, 40, 60),
    lens=Lens(0.1, 2.5),
    sampling=Sampling("independent", 5, None, 10.0),
    environment_rotation=-12.5,
    mips=False,
    adaptive=Adaptive(0.1, 8),
    keeps=True,
    moves=True,
    skips=True,
    head=SceneHead(2**64 - 1, bytes(range(32))),
)
DOCUMENT: dict[str, Any] = unpack_value(JOB.to_bytes(), what="a job")


def test_a_job_round_trips_to_the_bit() -> None:
    assert Job.from_bytes(JOB.to_bytes()) == JOB
    assert Job.from_bytes(JOB.to_bytes()).to_bytes() == JOB.to_bytes()
    assert JOB.plan.paths == 40 * 60 * 64
    assert replace(JOB, crop=None).plan.paths == 640 * 360 * 64
    assert Job.from_bytes(replace(JOB, crop=None).to_bytes()).crop is None


OPTIONAL: dict[str, Any] = {"lens": None, "sampling": Sampling(), "environment_rotation": 0.0, "mips": True, "moves": False, "skips": False}
"""What older documents do not have, and what it is then."""


def test_an_older_job_reads_as_it_was_meant() -> None:
    older = {name: value for name, value in DOCUMENT.items() if name not in OPTIONAL}
    assert Job.from_bytes(pack_value(older)) == replace(JOB, **OPTIONAL)


def test_a_job_of_several_pools_round_trips_and_is_of_all_of_them() -> None:
    pools = replace(JOB, partition=Partition.voronoi([[0, 0, 0]]), others=(Partition.voronoi([[1, 2, 3]]),))
    assert Job.from_bytes(pools.to_bytes()) == pools
    assert pools.division.nodes == 2 and pools.divided(JOB.division) == JOB and JOB.divided(pools.division) == pools
    with pytest.raises(PeerFault):
        Job.from_bytes(replace(pools, others=()).to_bytes())


def test_a_job_of_a_build_in_which_each_node_held_the_whole_scene_by_one_partition_is_not_taken_for_one_with_cells() -> None:
    with pytest.raises(PeerFault, match="older version"):
        Job.from_bytes(pack_value({**DOCUMENT, "whole": True}))
    assert Job.from_bytes(pack_value({**DOCUMENT, "whole": False})) == JOB


@pytest.mark.parametrize("key", sorted(set(DOCUMENT) - set(OPTIONAL)))
def test_every_entry_is_needed(key: str) -> None:
    with pytest.raises(PeerFault):
        Job.from_bytes(pack_value({name: value for name, value in DOCUMENT.items() if name != key}))


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("size", [0, 360]),
        ("size", [640]),
        ("size", [640, 360, 1]),
        ("size", [-1, 360]),
        ("size", [100_000, 360]),
        ("size", 640),
        ("head", [-1, bytes(32)]),
        ("head", [1, bytes(31)]),
        ("head", [1]),
        ("samples", 0),
        ("samples", 2**40),
        ("depth", 0),
        ("depth", 33),
        ("seed", -1),
        ("seed", 2**63),
        ("frame", -1),
        ("id", -1),
        ("nodes", []),
        ("nodes", [1]),
        ("nodes", [5, 5]),
        ("nodes", [2**32, 1]),
        ("nodes", None),
        ("keys", [[[0x7F000002, b"a box"]], b"what it opens"]),
        ("keys", []),
        ("keys", None),
        ("keys", [[]]),
        ("keys", [[], None]),
        ("keys", [[], bytes(200_000)]),
        ("keys", [[[1, "text"]], b""]),
        ("keys", [[[1, bytes(600)]], b""]),
        ("keys", [[[-1, b"box"]], b""]),
        ("keys", [[[2**32, b"box"]], b""]),
        ("keys", [[[True, b"box"]], b""]),
        ("keys", [[[2, b"box"], [2, b"box"]], b""]),
        ("keys", [[[2, b"box"], [1, b"box"]], b""]),
        ("keys", [[[node, b"box"] for node in range(128)], b""]),
        ("genesis", bytes(31)),
        ("content", bytes(31)),
        ("sky", bytes(8)),
        ("sky", b"\xff" * 24),
        ("camera", bytes(8)),
        ("camera", b"\xff" * 128),
        ("partition", {}),
        ("partition", {"epoch": 1}),
        ("partition", None),
        ("numeric_class", 5),
        ("layers", None),
        ("crop", []),
        ("crop", [0, 0, 0, 1]),
        ("crop", [0, 0, 641, 1]),
        ("crop", [0, 359, 1, 2]),
        ("crop", [-1, 0, 2, 2]),
        ("crop", [0.0, 0.0, 2.0, 2.0]),
        ("layers", "albedo"),
        ("layers", [1]),
        ("layers", ["albedo", "albedo"]),
        ("layers", ["depth", "albedo"]),
        ("layers", ["beauty"]),
        ("layers", ["nothing"]),
    ],
)
def test_what_makes_no_sense_is_refused(key: str, value: object) -> None:
    with pytest.raises(PeerFault):
        Job.from_bytes(pack_value({**DOCUMENT, key: value}))


@given(st.binary(max_size=200))
def test_noise_is_refused(noise: bytes) -> None:
    with pytest.raises(PeerFault):
        Job.from_bytes(noise)


@given(st.integers(0, len(JOB.to_bytes()) - 1), st.integers(1, 255))
def test_a_damaged_document_is_refused_or_another_job(place: int, damage: int) -> None:
    raw = bytearray(JOB.to_bytes())
    raw[place] ^= damage
    try:
        found = Job.from_bytes(bytes(raw))
    except PeerFault:
        return
    # In bytes, for -0.0 equals 0.0. No value of JOB is what is taken where a field is not there: its damaged name is one that is not known.
    assert found.to_bytes() != JOB.to_bytes()


def test_options_are_checked_one_by_one() -> None:
    good = RenderOptions()
    good.check()
    for algorithm in ALGORITHMS:
        replace(good, algorithm=algorithm).check()
    wrong: list[dict[str, Any]] = [
        {"width": 0},
        {"height": -5},
        {"width": 16_385},
        {"samples": 0},
        {"seed": -1},
        {"seed": 2**63},
        {"depth": 0},
        {"depth": 33},
        {"sky": (0.0, 0.0)},
        {"sky": (0.0, -1.0, 0.0)},
        {"sky": (0.0, float("nan"), 0.0)},
        {"sky": (float("inf"), 0.0, 0.0)},
        {"algorithm": "tiles"},
        {"layers": ("beauty",)},
        {"crop": Window(0, 0, 641, 1)},
        {"crop": Window(5, 5, 0, 1)},
        {"crop": Window(-1, 0, 5, 5)},
        {"layers": ("depth", "albedo")},
        {"layers": ("shine",)},
        {"lens": Lens(0.1, 0.0)},
        {"environment_rotation": float("nan")},
        {"environment_rotation": 361.0},
        {"sampling": Sampling("halton")},
        {"sampling": Sampling(roulette_from=0)},
        {"sampling": Sampling(clamp_direct=0.0)},
        {"sampling": Sampling(clamp_indirect=float("nan"))},
    ]
    for options in wrong:
        with pytest.raises(UsageFault) as caught:
            replace(good, **options).check()
        assert caught.value.remedy
