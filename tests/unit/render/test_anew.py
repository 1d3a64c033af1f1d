"""If this fails, a render whose organiser dies ends, or one that can never succeed is begun for ever."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import pytest
import trio
from trio.testing import MockClock

from scenefold.base.errors import LocalFault, PeerFault, Refused, ScenefoldError, Unreachable
from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.client import Cluster, Scene
from scenefold.crypto import SealingKey
from scenefold.render import one_image
from scenefold.render.anew import BEGUN_MAX, CHOOSE_S_MAX, PAUSE_S, VAIN_MAX, Tries
from scenefold.render.choice import SILENT, LeftOut, Renderers
from scenefold.render.job import RenderOptions
from scenefold.render.one_image import OneImage
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
        (LocalFault("too large"), False),
        (PeerFault("nonsense"), False),
    ],
)
def test_what_will_fail_again_is_not_tried_again(error: ScenefoldError, is_so: bool) -> None:
    assert Tries().may_begin_anew(error, 0) == is_so


class Chooser:
    """Who says who may render, and who answers, each time that it is asked."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, answers: list[Renderers | ScenefoldError], silent: list[set[int]]) -> None:
        self.answers, self.silent = iter(answers), iter(silent)
        monkeypatch.setattr(one_image, "renderers_of", self._renderers)
        monkeypatch.setattr(one_image, "silent_of", self._silent)
        calls = SimpleNamespace(world=SimpleNamespace(clock=TrioClock(), entropy=SimpleNamespace(token=bytes)))
        cluster, scene = SimpleNamespace(calls=calls), SimpleNamespace(access=SimpleNamespace(identity=None))
        self.image = OneImage(cast(Cluster, cluster), cast(Scene, scene), RenderOptions(), None, lambda *_: None)
        self.image.asked = {*KEYS}

    async def _renderers(self, _cluster: object, _scene: object) -> Renderers:
        answer = next(self.answers)
        if isinstance(answer, ScenefoldError):
            raise answer
        return answer

    async def _silent(self, _cluster: object, nodes: set[NodeId]) -> frozenset[NodeId]:
        return frozenset(map(NodeId, next(self.silent))) & nodes


async def test_who_knows_who_may_render_may_just_be_starting(monkeypatch: pytest.MonkeyPatch, autojump_clock: MockClock) -> None:
    chooser = Chooser(monkeypatch, [LOST, LOST, LOST, Renderers(KEYS)], [{2}])
    choice = await chooser.image.choose_again()
    assert choice.renderers.nodes == (1, 3) and choice.silent == {2} and choice.organiser in (1, 3)


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
