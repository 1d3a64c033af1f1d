"""If this fails, a render whose organiser dies ends, or one that can never succeed is begun for ever."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import pytest
import trio
from trio.testing import MockClock

from scenefold.base.errors import LocalFault, NoLease, PeerFault, Refused, ScenefoldError, Unreachable
from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.client import Cluster, Scene
from scenefold.crypto import SealingKey
from scenefold.render import one_image
from scenefold.render.anew import BEGUN_MAX, CHOOSE_S_MAX, PAUSE_S, VAIN_MAX, Heard, Tries, heard_of
from scenefold.render.choice import OTHER_CLASS, SILENT, LeftOut, Renderers
from scenefold.render.job import RenderOptions
from scenefold.render.one_image import OneImage
from scenefold.render.pool.request import Keep
from scenefold.render.pool.unattended import ALL_JOBS
from scenefold.render.watch import Keeper
from scenefold.wire import JobStateReply, Value, pack_value
from unit.peer.village import TrioClock

LOST = Unreachable("gone")
KEYS = {NodeId(number): SealingKey(bytes(32)).public for number in (1, 2, 3)}


def test_it_is_begun_anew_a_few_times_in_vain_and_later_each_time() -> None:
    tries, pauses = Tries(), []
    while tries.may_begin_anew(LOST, 0):
        pauses.append(tries.pause_s)
    assert tries.begun == 1 + VAIN_MAX
    assert pauses == [PAUSE_S * 2**number for number in range(VAIN_MAX)]


def test_who_gets_further_is_begun_anew_as_often_again() -> None:
    tries = Tries()
    for passes in (0, 0, 0, 5, 5, 5, 9):
        assert tries.may_begin_anew(LOST, passes)
    assert tries.pause_s == PAUSE_S
    assert tries.may_begin_anew(LOST, 9) and tries.may_begin_anew(LOST, 8)
    assert not tries.may_begin_anew(LOST, 9), "what it had once is no progress"


def test_there_is_an_end_of_it() -> None:
    tries = Tries()
    passes = 0
    while tries.may_begin_anew(LOST, passes):
        passes += 1
    assert tries.begun == BEGUN_MAX


@pytest.mark.parametrize(
    ("error", "is_so"),
    [
        (LOST, True),
        (Refused(RejectReason.NOT_READY, "it organises no such job"), True),
        (Refused(RejectReason.NOT_AUTHORISED, "no"), False),
        (Refused(RejectReason.MODE_FORBIDS, "edit mode"), False),
        (Refused(RejectReason.POOL_BUSY, "full"), False),
        (NoLease(RejectReason.MODE_FORBIDS, "nobody lends one"), False),
        (NoLease(RejectReason.MODE_FORBIDS, "nobody answered in time", was_held=True), True),
        (LocalFault("too large"), False),
        (PeerFault("nonsense"), False),
    ],
)
def test_what_will_fail_again_is_not_tried_again(error: ScenefoldError, is_so: bool) -> None:
    assert Tries().may_begin_anew(error, 0) == is_so


def test_once_all_were_gone_for_a_while_it_is_waited_until_they_lend_again() -> None:
    tries = Tries()
    assert tries.may_begin_anew(NoLease(RejectReason.MODE_FORBIDS, "nobody answered in time", was_held=True), 7)
    assert tries.may_begin_anew(NoLease(RejectReason.BUSY, "they have just started"), 7)
    assert not tries.may_begin_anew(Refused(RejectReason.MODE_FORBIDS, "somebody switched to edit mode"), 7)


class Chooser:
    """Who says who may render, and who answers, each time that it is asked."""

    def __init__(
        self,
        monkeypatch: pytest.MonkeyPatch,
        answers: list[Renderers | ScenefoldError],
        silent: list[set[int]],
        classes: dict[int, str] | None = None,
    ) -> None:
        self.answers, self.silent, self.classes = iter(answers), iter(silent), classes or {}
        monkeypatch.setattr(one_image, "renderers_of", self._renderers)
        monkeypatch.setattr(one_image, "heard_of", self._heard)
        calls = SimpleNamespace(world=SimpleNamespace(clock=TrioClock(), entropy=SimpleNamespace(token=bytes)))
        cluster, scene = SimpleNamespace(calls=calls), SimpleNamespace(access=SimpleNamespace(identity=None))
        self.image = OneImage(cast(Cluster, cluster), cast(Scene, scene), RenderOptions(), None, lambda *_: None)
        self.image.asked = {*KEYS}

    async def _renderers(self, _cluster: object, _scene: object) -> Renderers:
        answer = next(self.answers)
        if isinstance(answer, ScenefoldError):
            raise answer
        return answer

    async def _heard(self, _cluster: object, nodes: set[NodeId]) -> Heard:
        silent = frozenset(map(NodeId, next(self.silent))) & nodes
        return Heard(silent, {NodeId(node): told for node, told in self.classes.items() if node not in silent})


async def test_who_knows_who_may_render_may_just_be_starting(monkeypatch: pytest.MonkeyPatch, autojump_clock: MockClock) -> None:
    chooser = Chooser(monkeypatch, [LOST, LOST, LOST, Renderers(KEYS)], [{2}])
    choice = await chooser.image.choose_again()
    assert choice.renderers.nodes == (1, 3) and choice.without == {2} and choice.organiser in (1, 3)


async def test_nobody_who_answers_is_waited_for_and_no_lack_of_rights(monkeypatch: pytest.MonkeyPatch, autojump_clock: MockClock) -> None:
    chooser = Chooser(monkeypatch, [Renderers(KEYS)] * 3, [{1, 2, 3}, {1, 2, 3}, {1}])
    assert (await chooser.image.choose_again()).renderers.nodes == (2, 3)
    chooser = Chooser(monkeypatch, [Renderers(KEYS)] * 100, [{1, 2, 3}] * 100)
    before = trio.current_time()
    with pytest.raises(Unreachable, match="none of the nodes that may render answers"):
        await chooser.image.choose_again()
    assert CHOOSE_S_MAX <= trio.current_time() - before < CHOOSE_S_MAX + 2


async def test_who_may_not_know_is_not_asked_again(monkeypatch: pytest.MonkeyPatch) -> None:
    chooser = Chooser(monkeypatch, [Refused(RejectReason.NOT_AUTHORISED, "revoked")], [])
    with pytest.raises(Refused, match="revoked"):
        await chooser.image.choose_again()


def test_who_does_not_answer_is_left_out_and_named() -> None:
    before = LeftOut(NodeId(9), "a stranger")
    left = Renderers(KEYS, (before,)).without({NodeId(2), NodeId(7)})
    assert left.nodes == (1, 3)
    assert left.left_out == (before, LeftOut(NodeId(2), SILENT))


async def test_who_renders_in_another_class_than_most_is_left_out_and_so_the_render_does_not_fail_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    chooser = Chooser(monkeypatch, [Renderers(KEYS)], [set()], {1: "of one maker", 2: "of the other", 3: "of the other"})
    choice = await chooser.image.choose_again()
    assert choice.renderers.nodes == (2, 3) and choice.without == {1} and choice.organiser in (2, 3)
    assert choice.renderers.left_out == (LeftOut(NodeId(1), OTHER_CLASS),)


async def test_what_is_kept_waits_for_who_renders_in_its_class(monkeypatch: pytest.MonkeyPatch, autojump_clock: MockClock) -> None:
    """With the others it would end for good, as they cannot go on from it."""
    chooser = Chooser(monkeypatch, [Renderers(KEYS)] * 2, [{1}, set()], {1: "kept", 2: "other", 3: "other"})
    chooser.image._keeper = cast(Keeper, SimpleNamespace(keep=Keep(4, bytes(32), "kept")))
    choice = await chooser.image.choose_again()
    assert choice.renderers.nodes == (1,) and choice.without == {2, 3}


@pytest.mark.parametrize(
    ("classes", "wanted", "nodes"),
    [
        ({}, "", (1, 2, 3)),
        ({1: "a", 2: "a", 3: "a"}, "", (1, 2, 3)),
        ({1: "a", 2: "b", 3: "b"}, "", (2, 3)),
        ({1: "a", 2: "b", 3: "b"}, "a", (1,)),
        ({1: "a", 2: "b", 3: "b"}, "of nobody here", (2, 3)),
        ({2: "b", 3: "a"}, "", (1, 2)),
        ({1: "", 2: "b", 3: "b"}, "", (1, 2, 3)),
        ({1: "", 2: "", 3: ""}, "a", (1, 2, 3)),
    ],
)
def test_of_several_classes_one_renders(classes: dict[int, str], wanted: str, nodes: tuple[int, ...]) -> None:
    """A kept render's, or that of most, or of the first on the line; and who has said none: its own nodes will hear of it."""
    left = Renderers(KEYS).of_one_class({NodeId(node): told for node, told in classes.items()}, wanted)
    assert left.nodes == nodes
    assert left.left_out == tuple(LeftOut(node, OTHER_CLASS) for node in KEYS if node not in nodes)


async def test_nodes_are_asked_whether_they_are_there_and_in_which_class_they_render() -> None:
    answers: dict[int, object] = {
        1: {"jobs": [], "numeric_class": "a"},
        2: LOST,
        3: {"jobs": []},
        4: Refused(RejectReason.NOT_READY, "it knows no such question"),
        5: {"jobs": [], "numeric_class": 5},
        6: ["no document"],
        7: {"jobs": [], "numeric_class": "x" * 100_000},
    }

    async def ask(address: str, _packet: object, _reply: object, *, timeout_s: float) -> JobStateReply:
        assert timeout_s > 0
        answer = answers[int(address.rpartition(".")[2])]
        if isinstance(answer, ScenefoldError):
            raise answer
        return JobStateReply(job=ALL_JOBS, document=pack_value(cast(Value, answer)))

    nodes = [NodeId(0x7F000000 + number) for number in answers]
    heard = await heard_of(cast(Cluster, SimpleNamespace(calls=SimpleNamespace(ask=ask))), nodes)
    assert heard.silent == {nodes[1]}
    assert heard.classes == {nodes[0]: "a", nodes[2]: ""}
