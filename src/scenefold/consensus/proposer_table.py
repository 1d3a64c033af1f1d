"""How a node gets something decided (specs/25-consensus.md, The proposer). Guards and actions: proposer_guards.py, proposer_actions.py."""

from __future__ import annotations

from scenefold.base.reasons import RejectReason
from scenefold.consensus.state import Stage
from scenefold.consensus.tables import Row

ASK = "ask"
ORPHANED = "T_ORPHAN over"
ANSWERED = "8"
REFUSED = "9"
WAITED = "T_PASS over"
"""T_PASS, or the link to the last arm that was waited for is lost."""
RESTED = "pause over"
LATE = "deadline over"
"""Of whoever asks."""
DECIDED = "L decided"

_IDLE, _PREPARING, _SEEKING, _ACCEPTING, _REPEATING, _RESTING = Stage
_BUSY = (_PREPARING, _SEEKING, _ACCEPTING, _REPEATING, _RESTING)
_FIRST = (_PREPARING, _SEEKING)
_PAUSING = (_RESTING,)
"""The ballot came to nothing in its time, and no other one follows yet: what comes late still counts."""
_SECOND = (_ACCEPTING, _REPEATING)
_OUTSIDE = (_PREPARING, _SEEKING, _RESTING)
_VOTING = (_ACCEPTING, _REPEATING, _RESTING)
_NEWS = (ANSWERED, REFUSED, WAITED)

PROPOSER = (
    Row((ASK,), ("found",), ("say_committed_there",), at=(_IDLE,)),
    Row((ASK,), ("takes_no_part",), ("reject",), RejectReason.NOT_AUTHORISED, (_IDLE,)),
    Row((ASK,), ("cannot_write", "under_way"), ("say_unknown_of_it",), at=(_IDLE,)),
    Row((ASK,), ("cannot_write",), ("reject",), RejectReason.STORAGE_FULL, (_IDLE,)),
    Row((ASK,), ("ill_formed",), ("reject_as_judged",), at=(_IDLE,)),
    Row((ASK,), ("no_ballot_left", "under_way"), ("say_unknown_of_it",), at=(_IDLE,)),
    Row((ASK,), ("no_ballot_left",), ("reject",), RejectReason.LIMIT_EXCEEDED, (_IDLE,)),
    Row((ASK,), ("has_the_first_ballot",), ("begin", "vote_first", "hear", "send_out"), at=(_IDLE,), then=_ACCEPTING),
    Row((ASK,), (), ("begin", "open_ballot", "send_out"), at=(_IDLE,), then=_PREPARING),
    Row((ASK,), ("under_way",), ("say_unknown_of_it",), at=_BUSY),
    Row((ASK,), (), ("reject",), RejectReason.BUSY, _BUSY),
    Row((ORPHANED,), ("nothing_accepted",), at=(_IDLE,)),
    Row((ORPHANED,), ("cannot_write",), ("wait_again",), at=(_IDLE,)),
    Row((ORPHANED,), ("no_ballot_left",), at=(_IDLE,)),
    Row((ORPHANED,), (), ("take_over", "open_ballot", "send_out"), at=(_IDLE,), then=_PREPARING),
    Row((ORPHANED,), (), ("wait_again",), at=_BUSY),
    Row((REFUSED,), ("for_good", "nothing_begun"), ("reject_as_refused",), at=_OUTSIDE, then=_IDLE),
    Row((REFUSED,), (), ("note", "rest"), at=_FIRST, then=_RESTING),
    Row((ANSWERED,), ("arms_are_out", "needs_consent"), at=(_PREPARING,)),
    Row((ANSWERED,), ("arms_are_out", "too_few_promises"), at=(_PREPARING,)),
    Row((ANSWERED, WAITED), ("overtaken",), ("note_overtaken", "rest"), at=_FIRST, then=_RESTING),
    Row((ANSWERED, WAITED), ("too_few_promises",), ("repeat",), at=(_PREPARING,), then=_SEEKING),
    Row((ANSWERED,), ("too_few_promises", "arms_are_out"), at=(_SEEKING,)),
    Row((ANSWERED, WAITED), ("too_few_promises",), ("rest",), at=(_SEEKING,), then=_RESTING),
    Row((ANSWERED, WAITED), ("not_all_agree",), ("note_who_is_missing", "rest"), at=_FIRST, then=_RESTING),
    Row((ANSWERED, WAITED), ("nothing_to_propose",), ("say_open",), at=_FIRST, then=_IDLE),
    Row((ANSWERED, WAITED), ("cannot_write",), ("rest",), at=_FIRST, then=_RESTING),
    Row((ANSWERED, WAITED), (), ("vote", "hear", "send_out"), at=_FIRST, then=_ACCEPTING),
    Row(_NEWS, ("voted_by_a_majority",), ("decide",), at=_VOTING),
    Row((REFUSED,), (), ("note",), at=_PAUSING),
    Row((ANSWERED,), ("in_the_second_phase",), at=_PAUSING),
    Row((ANSWERED,), ("overtaken",), at=_PAUSING),
    Row((ANSWERED,), ("too_few_promises",), at=_PAUSING),
    Row((ANSWERED,), ("not_all_agree",), at=_PAUSING),
    Row((ANSWERED,), ("nothing_to_propose",), ("say_open",), at=_PAUSING, then=_IDLE),
    Row((ANSWERED,), ("cannot_write",), at=_PAUSING),
    Row((ANSWERED,), (), ("vote", "hear", "send_out"), at=_PAUSING, then=_ACCEPTING),
    Row((ANSWERED, REFUSED), ("arms_are_out",), ("note",), at=(_ACCEPTING, _REPEATING)),
    Row(_NEWS, (), ("note", "repeat"), at=(_ACCEPTING,), then=_REPEATING),
    Row(_NEWS, (), ("note", "rest"), at=(_REPEATING,), then=_RESTING),
    Row((RESTED,), ("deadline_over", "nobody_waits"), ("wait_again",), at=(_RESTING,), then=_IDLE),
    Row((RESTED,), ("cannot_write",), ("rest",), at=(_RESTING,)),
    Row((RESTED,), ("no_ballot_left", "in_doubt"), ("say_unknown",), at=(_RESTING,), then=_IDLE),
    Row((RESTED,), ("no_ballot_left",), ("reject",), RejectReason.LIMIT_EXCEEDED, (_RESTING,), _IDLE),
    Row((RESTED,), (), ("open_ballot", "send_out"), at=(_RESTING,), then=_PREPARING),
    Row((LATE,), ("nobody_waits",), at=_BUSY),
    Row((LATE,), ("in_doubt",), ("say_unknown",), at=_OUTSIDE, then=_IDLE),
    Row((LATE,), ("overtaken",), ("note_overtaken", "reject_as_noted"), at=_FIRST, then=_IDLE),
    Row((LATE,), (), ("reject_as_noted",), at=_OUTSIDE, then=_IDLE),
    Row((LATE,), ("in_doubt",), ("say_unknown", "let_go"), at=_SECOND),
    Row((LATE,), (), ("reject_as_noted", "let_go"), at=_SECOND),
    Row((DECIDED,), ("nobody_waits",), at=_BUSY, then=_IDLE),
    Row((DECIDED,), ("is_the_wish",), ("say_committed",), at=_BUSY, then=_IDLE),
    Row((DECIDED,), (), ("reject",), RejectReason.POSITION_BEHIND, _BUSY, _IDLE),
)
