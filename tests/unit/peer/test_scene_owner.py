"""If this fails, a participant forgets that it lacks the sealed log that it should keep, and asks nobody for it."""

from __future__ import annotations

from dataclasses import dataclass, field

from scenefold.consensus import Certificate, Decide
from scenefold.peer.scene_log.scene_judge import SceneJudge
from scenefold.peer.scene_log.scene_owner import SceneOwner
from scenefold.scene.log import Followed, without_log
from unit.scene.log.council import BALLOT, Council
from unit.scene.log.members import grant


@dataclass
class Keeper:
    """An owner of a scene's log, and what becomes of it."""

    council: Council = field(default_factory=Council)

    def __post_init__(self) -> None:
        self.judge = SceneJudge.of(self.council.known)
        self.owner = SceneOwner(self.council.known, lambda known, decided: None)

    def writes(self, offered: Followed, *, lean: bool) -> Decide:
        """What is decided is about to be written."""
        value = self.council.value(offered)
        votes = tuple(self.council.votes(value, BALLOT))
        position = self.council.header.position + 1
        decided = Decide(position, without_log(value) if lean else value, Certificate(position, BALLOT, votes))
        self.owner.beside(decided, self.judge.after(decided.value))
        return decided

    def decides(self, *, lean: bool) -> None:
        offered = self.council.offer(grant(self.council.header.position))
        decided = self.writes(offered, lean=lean)
        self.judge = self.judge.after(decided.value)
        self.council.settle(offered)
        self.owner.decided(decided, self.judge)


def test_what_lacks_its_log_is_asked_for_until_a_whole_one_is_decided() -> None:
    keeper = Keeper()
    assert not keeper.owner.lacks_log
    keeper.decides(lean=True)
    assert keeper.owner.lacks_log
    keeper.decides(lean=False)
    assert not keeper.owner.lacks_log


def test_a_full_disk_changes_nothing_about_what_is_lacking() -> None:
    keeper = Keeper()
    keeper.decides(lean=True)
    keeper.writes(keeper.council.offer(grant(9)), lean=False)
    assert keeper.owner.lacks_log, "the newest position that is on the disk has none"
