"""Guards and actions of learning (specs/25-consensus.md, Learning). Nobody is believed: a certificate shows what is decided."""

from __future__ import annotations

from scenefold.base.ids import NodeId
from scenefold.consensus.case import Case
from scenefold.consensus.effects import Tell
from scenefold.consensus.learning_table import LEARN, LEARNING, LOG_ASKED
from scenefold.consensus.messages import AskLog, Learn
from scenefold.consensus.tables import acting, first_fit, named


class Lesson:
    """What is decided, or who wants to know it."""

    def __init__(self, case: Case, sender: NodeId, message: Learn | AskLog) -> None:
        self.case, self.sender, self.message = case, sender, message

    @property
    def learn(self) -> Learn:
        assert isinstance(self.message, Learn)
        return self.message

    @property
    def proves(self) -> bool:
        """Whether the certificate shows that the value is decided at its position."""
        case, message = self.case, self.learn
        is_of_it = message.certificate.position == message.position
        return is_of_it and message.certificate.proves(message.value, case.setting.genesis, case.participants)

    @property
    def is_taken(self) -> bool:
        """Whether the judge does. What this node has voted for was judged then, and these bytes are kept."""
        accepted, value = self.case.slot.accepted, self.learn.value
        return (accepted is not None and accepted.value == value) or self.case.state.judge.refuses(value, is_decided=True) is None

    @property
    def have(self) -> int:
        assert isinstance(self.message, AskLog)
        return self.message.have


def learn(case: Case, sender: NodeId, message: Learn | AskLog) -> None:
    """Take the row that fits."""
    lesson = Lesson(case, sender, message)
    row = first_fit(LEARNING, LEARN if isinstance(message, Learn) else LOG_ASKED, None, GUARDS, lesson)
    assert row is not None, "the last rows have no guards"
    for name in row.do:
        ACTIONS[name](lesson)


# ------------------------------------------------------------------------------------------------------------ guards


def of_another_log(lesson: Lesson) -> bool:
    """it names another genesis"""
    return lesson.message.genesis != lesson.case.setting.genesis


def decided_already(lesson: Lesson) -> bool:
    """L ≤ c"""
    return lesson.learn.position <= lesson.case.state.position


def too_far_ahead(lesson: Lesson) -> bool:
    """L > c + 1"""
    return lesson.learn.position > lesson.case.open_position


def without_its_body(lesson: Lesson) -> bool:
    """it is decided, and what is here of it is not enough: it was told to one who has voted for it, and this node has not"""
    return not lesson.learn.value.body and lesson.proves and not lesson.is_taken


def unproven(lesson: Lesson) -> bool:
    """its certificate is none for L and this value by P(L), or the judge refuses the value"""
    return not lesson.proves or not lesson.is_taken


def cannot_write(lesson: Lesson) -> bool:
    """the disk refuses"""
    return not lesson.case.view.can_write


def knows_no_more(lesson: Lesson) -> bool:
    """what is asked for begins above c"""
    return lesson.have >= lesson.case.state.position


# ----------------------------------------------------------------------------------------------------------- actions


def ask_log(lesson: Lesson) -> None:
    """ask for what is decided above c (5): whoever brought this, unless a participant was asked less than 0.9 s ago, or another one if it is none"""
    lesson.case.ask_log(lesson.sender)


def decide(lesson: Lesson) -> None:
    """L is decided here"""
    lesson.case.decide(lesson.learn.value, lesson.learn.certificate)


def tell_log(lesson: Lesson) -> None:
    """send all above what the asker has, with certificates"""
    lesson.case.do(Tell(lesson.sender, lesson.have))


GUARDS = named((of_another_log, decided_already, too_far_ahead, without_its_body, unproven, cannot_write, knows_no_more))
ACTIONS = acting((ask_log, decide, tell_log))
