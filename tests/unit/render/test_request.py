"""If this fails, one packet of any user of a cluster ends a node, or makes it reserve what memory there is."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as some

from scenefold.base.errors import PeerFault, UsageFault
from scenefold.base.ids import NodeId, SceneId
from scenefold.render.job import RenderOptions
from scenefold.render.lens import Lens
from scenefold.render.levels import Adaptive
from scenefold.render.pool.request import Keep, RenderRequest
from scenefold.render.pool.unattended import Unattended
from scenefold.render.sampling import Sampling
from scenefold.render.sealed_keys import SealedKeys
from scenefold.render.window import Window
from scenefold.scene.head import SceneHead
from scenefold.wire import pack_value, unpack_value

KEYS = SealedKeys(((NodeId(3), b"a box"),), b"what it opens")
REQUEST = RenderRequest(
    7,
    SceneId(3),
    bytes(range(32)),
    KEYS,
    RenderOptions(
        sky=(0.1, 0.2, 1e-300),
        camera="left",
        layers=("position",),
        crop=Window(5, 6, 7, 8),
        lens=Lens(0.1, 2.5),
        sampling=Sampling("independent", 5, 2.0),
        environment_rotation=-12.5,
        mips=False,
        adaptive=Adaptive(0.05),
        pools=3,
        skips=True,
    ),
    SceneHead(5, bytes(32), 4),
    Keep(2, bytes(range(32)), "embree"),
    Unattended("kitchen", -0.5),
)
DOCUMENT: dict[str, Any] = unpack_value(REQUEST.to_bytes(), what="a request")
ENDLESS = float("inf")
ODD = [
    None,
    True,
    -1,
    2**62,
    2**64 - 1,
    ENDLESS,
    -ENDLESS,
    0.5,
    1e308,
    "",
    "x",
    b"",
    bytes(32),
    [],
    [[]],
    [1, b"x"],
    [[1, b"x"]],
    {},
    {"a": 1},
]


def test_a_request_round_trips() -> None:
    assert RenderRequest.from_map(7, DOCUMENT) == REQUEST


OPTIONAL: dict[str, Any] = {
    "lens": None,
    "sampling": Sampling(),
    "environment_rotation": 0.0,
    "mips": True,
    "moving": False,
    "pools": 1,
    "skips": False,
}
"""What older clients do not send, and what it is then."""


def test_an_older_request_reads_as_it_was_meant() -> None:
    older = {name: value for name, value in DOCUMENT.items() if name not in {*OPTIONAL, "unattended"}}
    assert RenderRequest.from_map(7, older) == replace(REQUEST, options=replace(REQUEST.options, **OPTIONAL), unattended=None)


@pytest.mark.parametrize("key", sorted(set(DOCUMENT) - {"request", "unattended"} - set(OPTIONAL)))
def test_every_entry_is_needed(key: str) -> None:
    with pytest.raises(PeerFault):
        RenderRequest.from_map(7, {name: value for name, value in DOCUMENT.items() if name != key})


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("width", ENDLESS),
        ("pools", None),
        ("pools", 1.5),
        ("pools", ENDLESS),
        ("height", -ENDLESS),
        ("samples", float("nan")),
        ("width", "640"),
        ("depth", 2.0),
        ("genesis", 2**62),
        ("genesis", 3 << 30),
        ("genesis", [0] * 32),
        ("genesis", bytes(31)),
        ("scene", 2**32),
        ("scene", ENDLESS),
        ("sky", [ENDLESS, 0.0, 0.0]),
        ("sky", [2**62, 0.0, 0.0]),
        ("sky", ["1", "1", "1"]),
        ("sky", [0.0, 0.0]),
        ("camera", 5),
        ("algorithm", b"voronoi"),
        ("layers", "depth"),
        ("layers", [b"depth"]),
        ("sampling", ["sobol", 3, 1.0]),
        ("sampling", ["sobol", 3, 1.0, ENDLESS]),
        ("sampling", [5, 3, 1.0, None]),
        ("sampling", ["sobol", 2.5, None, None]),
        ("lens", 5),
        ("lens", [1.0]),
        ("lens", [ENDLESS, 1.0]),
        ("adaptive", 0.1),
        ("adaptive", [0.1]),
        ("adaptive", ["0.1", 16]),
        ("adaptive", [ENDLESS, 16]),
        ("keep", 5),
        ("keep", [1, bytes(32)]),
        ("keep", [1, bytes(31), "embree"]),
        ("keep", [2**32, bytes(32), "embree"]),
        ("keep", [10**6, bytes(32), "embree"]),
        ("unattended", 5),
        ("unattended", ["kitchen"]),
        ("unattended", [b"kitchen", None]),
        ("unattended", ["a\nkitchen", None]),
        ("unattended", ["k" * 65, None]),
        ("unattended", ["kitchen", ENDLESS]),
        ("unattended", ["kitchen", 1e6]),
        ("crop", 5),
        ("crop", [1, 2, 3]),
        ("crop", [1, 2, 3, ENDLESS]),
    ],
)
def test_nothing_is_made_of_what_makes_no_sense(key: str, value: object) -> None:
    with pytest.raises(PeerFault):
        RenderRequest.from_map(7, {**DOCUMENT, key: value})


def test_an_option_out_of_range_is_told_by_its_name() -> None:
    for pools in (-1, 128, 2**62):
        with pytest.raises(UsageFault, match="pools is"):
            RenderRequest.from_map(7, {**DOCUMENT, "pools": pools})
    with pytest.raises(UsageFault, match="no layer 'shine'"):
        RenderRequest.from_map(7, {**DOCUMENT, "layers": ["shine"]})
    with pytest.raises(UsageFault, match="is no part of an image of 640x360"):
        RenderRequest.from_map(7, {**DOCUMENT, "crop": [600, 0, 41, 1]})
    with pytest.raises(UsageFault, match="adaptive is -1"):
        RenderRequest.from_map(7, {**DOCUMENT, "adaptive": [-1, 16]})
    with pytest.raises(UsageFault, match="width is 99999"):
        RenderRequest.from_map(7, {**DOCUMENT, "width": 99_999})


@given(some.dictionaries(some.sampled_from(sorted(DOCUMENT)), some.sampled_from(ODD), min_size=1, max_size=3))
def test_whatever_stands_in_it_no_other_error_comes_of_it(changes: dict[str, object]) -> None:
    # As it arrives: some of these are nothing that the wire carries.
    document = unpack_value(pack_value({**DOCUMENT, **changes}), what="a request")
    try:
        RenderRequest.from_map(7, document)
    except (PeerFault, UsageFault):
        return
