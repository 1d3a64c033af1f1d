"""If this fails, a node that keeps no log of a scene takes a header for decided otherwise than it was, or tells others what nobody decided."""

from __future__ import annotations

from scenefold.peer.modes.header_votes import shown_by_header
from scenefold.peer.scene_log.scene_judge import participants_after
from scenefold.scene.log import value_of
from scenefold.wire import SceneMode, SetMode
from unit.scene.log.council import Council, added, removed


def test_the_votes_of_a_header_prove_the_value_that_was_decided() -> None:
    council = Council()
    for entry in (SetMode(SceneMode.RENDER), added(4), removed(1), SetMode(SceneMode.EDIT)):
        before, offered = council.header, council.offer(entry)
        value = council.value(offered)
        public = council.settle(offered)
        found = shown_by_header(public, before)
        assert found is not None and found.position == public.position and found.value == value and not found.value.body
        assert found.certificate.proves(value, public.genesis, participants_after(before))


def test_behind_other_participants_it_proves_nothing() -> None:
    council = Council()
    first = council.header
    council.decide(added(4))
    public = council.decide(SetMode(SceneMode.RENDER))
    found = shown_by_header(public, first)
    assert found is not None
    assert found.value != value_of(public, b"", council.headers[-2])
    for deciders in (first, council.headers[-2]):
        assert not found.certificate.proves(found.value, public.genesis, participants_after(deciders))


def test_what_the_origin_decided_alone_has_no_votes() -> None:
    council = Council(first=())
    assert shown_by_header(council.header, council.header) is None
