"""If this fails, the node that organises a render can make the client that asked for it fail in some odd way, or fill its memory."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
import trio
from hypothesis import given
from hypothesis import strategies as some
from trio.testing import MockClock

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.rays import RAY_BYTES
from scenefold.render.job import RenderOptions
from scenefold.render.levels import Adaptive
from scenefold.render.pool.telling import failure_fields
from scenefold.render.reports import image_size, report_of, stand_of
from scenefold.render.watch import Watch
from scenefold.render.window import Window
from scenefold.wire import ImagePart, JobStateReply, Packet, pack_value, unpack_value

OPTIONS = RenderOptions(width=16, height=16, samples=2)
SIZE = 16 * 16 * 40
ADDRESSES = ["127.0.0.2", "127.0.0.3"]
ODD = [None, True, -1, 2**62, 2**64 - 1, float("inf"), -0.5, "", "x", "\x1b[2J", b"", [], [[]], [1], {}, {"a": 1}, [{}]]


def node(address: str) -> dict[str, Any]:
    counts = dict.fromkeys(
        [
            "records",
            "groups",
            "triangles",
            "bytes_read",
            "shadow_casts",
            "packets_sent",
            "packets_resent",
            "acknowledgements_sent",
            "rays_received",
            "not_finite",
            "clamped",
            "late",
        ],
        5,
    )
    counts |= {"closed": 1, "owned": 1, "rays": 600, "casts": 700, "rays_sent": 256, "prepare_seconds": 0.5, "busy_seconds": 0.25}
    return {"address": address, "phase": "running", **counts, **failure_fields(None)}


STATE: dict[str, Any] = {
    "phase": "done",
    **failure_fields(None),
    "passes": 1,
    "paths": 512,
    "closed": 1,
    "numeric_class": "embree",
    "image_bytes": SIZE,
    "paths_before": 0,
    "moved": 3,
    "attempts": 2,
    "passes_again": 5,
    "lost": [ADDRESSES[1]],
    "back": [ADDRESSES[1]],
    "kept_passes": 0,
    "content": bytes(32),
    "seconds": {"plan": 0.5, "render": 2.0},
    "nodes": [node(address) for address in ADDRESSES],
}


def told(state: object) -> dict[str, Any]:
    return report_of(stand_of(pack_value(state), "127.0.0.2").document, OPTIONS, ADDRESSES, "127.0.0.2")


def test_a_report_says_what_the_nodes_did() -> None:
    report = told(STATE)
    assert image_size(OPTIONS) == SIZE
    assert image_size(replace(OPTIONS, crop=Window(3, 3, 4, 5))) == 4 * 5 * 40
    assert image_size(replace(OPTIONS, layers=("direct", "samples"))) == 16 * 16 * (12 + 12 + 4)
    assert (report["paths_per_second"], report["rays"], report["rays_passed_per_path"]) == (256.0, 1200, 1.0)
    assert (report["efficiency"], report["bytes_passed"]) == (1.0, 512 * RAY_BYTES)
    assert [one["address"] for one in report["render_nodes"]] == ADDRESSES
    assert "failure" not in report["render_nodes"][0] and report["render_nodes"][0]["busy_seconds"] == 0.25


def test_after_a_resumption_rays_are_of_the_paths_that_were_traced() -> None:
    assert told({**STATE, "paths_before": 256})["rays_passed_per_path"] == 2.0


def test_rounds_and_tail_are_told_and_an_earlier_organiser_knows_of_none() -> None:
    rows = [{**node(address), "processor_seconds": 1.5, "memory_most": 1 << 28} for address in ADDRESSES]
    report = told({**STATE, "rounds": [[150, 100, 2], [60, 30, 2]], "tail": [3.0, 4.0], "nodes": rows})
    assert report["rounds"] == [{"cell_visits": 150, "efficiency": 0.75}, {"cell_visits": 60, "efficiency": 1.0}]
    assert report["efficiency_of_rounds"] == 210 / 260 and report["tail"] == {"seconds_to_95": 3.0, "seconds_to_100": 4.0}
    assert report["render_nodes"][0]["processor_seconds"] == 1.5 and report["render_nodes"][0]["memory_most"] == 1 << 28
    before = told(STATE)
    assert (before["rounds"], before["efficiency_of_rounds"], before["tail"]) == ([], 1.0, None)
    assert before["render_nodes"][0]["memory_most"] == 0


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("rounds", 5),
        ("rounds", [[5, 6, 2]]),
        ("rounds", [[5, 2, 2]]),
        ("rounds", [[5, 5]]),
        ("rounds", [[5, 5, 128]]),
        ("rounds", [[0, 0, 1]]),
        ("rounds", [[5, 5, 1]] * 257),
        ("tail", [1.0]),
        ("tail", [1.0, -1.0]),
        ("tail", [1.0, 2.0, 3.0]),
        ("tail", [float("inf"), 1.0]),
        ("nodes", [{**node("127.0.0.2"), "memory_most": -1}]),
        ("nodes", [{**node("127.0.0.2"), "processor_seconds": "x"}]),
    ],
)
def test_rounds_and_tails_that_cannot_be_are_refused(key: str, value: object) -> None:
    with pytest.raises(PeerFault):
        told({**STATE, key: value})


def test_an_adaptive_image_has_from_its_least_to_its_most_paths() -> None:
    options = replace(OPTIONS, samples=512, adaptive=Adaptive(0.1, 64))

    def paths(count: int, passes: int) -> float:
        state = {**STATE, "paths": count, "passes": passes}
        told: float = report_of(stand_of(pack_value(state), "127.0.0.2").document, options, ADDRESSES, "127.0.0.2")["samples_per_pixel"]
        return told

    assert (paths(256 * 64, 1), paths(256 * 100, 2), paths(256 * 512, 4)) == (64.0, 100.0, 512.0)
    for count, passes in ((256 * 64 - 1, 1), (256 * 512 + 1, 4), (256 * 64, 0), (256 * 512, 5)):
        with pytest.raises(PeerFault):
            paths(count, passes)


@pytest.mark.parametrize("key", sorted(STATE))
def test_every_entry_is_needed(key: str) -> None:
    with pytest.raises(PeerFault):
        told({name: value for name, value in STATE.items() if name != key})


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("phase", "asleep"),
        ("phase", []),
        ("closed", 2),
        ("paths", 0),
        ("paths", 513),
        ("passes", "y"),
        ("image_bytes", SIZE + 1),
        ("image_bytes", 1 << 60),
        ("nodes", []),
        ("nodes", [{}]),
        ("nodes", [node("127.0.0.9")]),
        ("nodes", [node("127.0.0.2")] * 128),
        ("nodes", [{**node("127.0.0.2"), "casts": -1}]),
        ("seconds", {"render": -1.0}),
        ("seconds", {"render": float("inf")}),
        ("seconds", {"\x1b[2J": 1.0}),
        ("seconds", {str(number): 1.0 for number in range(99)}),
        ("numeric_class", "x" * 1_000),
        ("attempts", 0),
        ("passes_again", -1),
        ("lost", ["127.0.0.9"]),
        ("lost", ["127.0.0.2"] * 128),
        ("lost", [7]),
        ("back", ["127.0.0.9"]),
        ("back", [7]),
    ],
)
def test_what_makes_no_sense_is_the_organisers_fault(key: str, value: object) -> None:
    with pytest.raises(PeerFault, match=r"127\.0\.0\.2"):
        told({**STATE, key: value})


@given(
    some.dictionaries(some.sampled_from(sorted(STATE)), some.sampled_from(ODD), max_size=3),
    some.dictionaries(some.sampled_from(sorted(node(""))), some.sampled_from(ODD), max_size=2),
)
def test_whatever_it_says_no_other_error_comes_of_it(changes: dict[str, object], of_node: dict[str, object]) -> None:
    try:
        report = told({**STATE, "nodes": [{**node("127.0.0.2"), **of_node}], **changes})
    except PeerFault:
        return
    assert report["paths"] == 512


@pytest.mark.parametrize("noise", [b"", b"\x00", b"\xc1", pack_value([1]), pack_value({})])
def test_noise_is_no_state(noise: bytes) -> None:
    with pytest.raises(PeerFault):
        stand_of(noise, "127.0.0.2")


def watch(answers: Callable[[Packet], Packet]) -> Watch:
    async def ask(_address: str, packet: Packet, _answer: object, timeout_s: float) -> Packet:
        await trio.lowlevel.checkpoint()
        return answers(packet)

    calls = SimpleNamespace(ask=ask, world=SimpleNamespace(clock=SimpleNamespace(sleep=trio.sleep)))
    return Watch(SimpleNamespace(calls=calls), "127.0.0.2", 1)  # type: ignore[arg-type]


def nothing(_phase: str, _done: int, _total: int) -> None:
    pass


@pytest.mark.parametrize(
    "state", [{}, {"phase": "rendering"}, {"phase": "failed", "failure_reason": "x", "failure": ""}, {"phase": "done"}]
)
async def test_an_ill_formed_state_ends_the_waiting(state: dict[str, Any]) -> None:
    with pytest.raises(PeerFault):
        await watch(lambda _: JobStateReply(job=1, document=pack_value(state))).until_done(nothing)


async def test_each_phase_is_told_until_it_is_over_and_not_again(autojump_clock: MockClock) -> None:
    closed, told = iter((0, 1, 1)), list[tuple[str, int, int]]()
    phases = iter(("preparing", "rendering", "rendering", "done"))

    def state(_packet: Packet) -> JobStateReply:
        phase = next(phases)
        return JobStateReply(job=1, document=pack_value({**STATE, "phase": phase, "closed": 0 if phase == "preparing" else next(closed)}))

    await watch(state).until_done(lambda *step: told.append(step))
    assert told == [("prepare", 1, 1), ("render", 0, 1), ("render", 1, 1), ("render", 1, 1)]


async def test_each_node_that_is_lost_or_back_is_told_once(autojump_clock: MockClock) -> None:
    losses, told, back = iter(([], ADDRESSES[:1], ADDRESSES[:1], ADDRESSES)), list[str](), list[str]()

    def state(_packet: Packet) -> JobStateReply:
        lost = next(losses)
        phase = "done" if lost == ADDRESSES else "rendering"
        return JobStateReply(job=1, document=pack_value({**STATE, "phase": phase, "lost": lost, "back": lost[:1]}))

    await watch(state).until_done(nothing, lost=told.append, back=back.append)
    assert (told, back) == (ADDRESSES, ADDRESSES[:1])


async def test_an_organiser_that_is_lost_is_said_to_be_it() -> None:
    def away(_packet: Packet) -> JobStateReply:
        raise Unreachable("connection refused", where="127.0.0.2")

    with pytest.raises(Unreachable, match="organises the render is lost: connection refused") as caught:
        await watch(away).until_done(nothing)
    assert "--resume" in caught.value.remedy


async def test_a_failed_job_says_why() -> None:
    state = {**unpack_value(pack_value(STATE), what="state"), "phase": "failed", **failure_fields(Refused(13, "no room"))}  # type: ignore[arg-type]
    with pytest.raises(Refused, match="the render failed: no room"):
        await watch(lambda _: JobStateReply(job=1, document=pack_value(state))).until_done(nothing)


@pytest.mark.parametrize("total, step", [(SIZE + 1, 100), (1 << 60, 1 << 20), (SIZE, SIZE + 1), (SIZE, 0)])
async def test_an_image_of_another_size_is_not_taken(total: int, step: int) -> None:
    taken = 0

    def part(packet: Any) -> ImagePart:
        nonlocal taken
        taken += step
        return ImagePart(job=1, total_bytes=total, offset=packet.offset, payload=bytes(step))

    with pytest.raises(PeerFault, match="a part of the image does not fit"):
        await watch(part).fetch(SIZE, nothing)
    assert taken == step
