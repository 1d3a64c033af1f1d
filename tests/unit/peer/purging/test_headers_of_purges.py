"""If one fails, a node forgets that something was purged, and takes what is older again."""

from __future__ import annotations

import pytest

from scenefold.base.errors import Refused
from scenefold.base.reasons import RejectReason
from scenefold.peer.scene_log.headers import checked_header
from scenefold.wire import SceneLogPublic
from unit.peer.scenes_made import first_header, later_header

FIRST = first_header()
BEGUN = later_header(FIRST, position=3, write_floor=3, purged=3)


def test_a_header_says_that_a_purge_began_and_who_takes_it_goes_on_from_there() -> None:
    known = checked_header(BEGUN, checked_header(FIRST, None))
    assert known.public.purged == 3
    again = later_header(FIRST, position=4, write_floor=4, purged=4)
    assert checked_header(again, known).public.purged == 4
    assert checked_header(BEGUN, None).public == BEGUN


@pytest.mark.parametrize(
    "header, reason",
    [
        (later_header(FIRST, position=4, write_floor=4, purged=2), RejectReason.POSITION_BEHIND),
        (later_header(FIRST, position=4, write_floor=4), RejectReason.POSITION_BEHIND),
        (later_header(FIRST, position=4, write_floor=3, purged=4), RejectReason.ILL_FORMED),
    ],
)
def test_it_never_goes_back_nor_stands_above_the_write_floor(header: SceneLogPublic, reason: RejectReason) -> None:
    with pytest.raises(Refused) as problem:
        checked_header(header, checked_header(BEGUN, None))
    assert problem.value.reason is reason
