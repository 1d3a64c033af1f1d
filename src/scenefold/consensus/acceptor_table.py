"""What a node does with somebody else's proposal (specs/25-consensus.md, The acceptor). Guards and actions: acceptor.py.

First what holds wherever the node stands, then who may propose here at all, then what it has promised, and only then what it
thinks of the value.
"""

from __future__ import annotations

from scenefold.base.reasons import RejectReason
from scenefold.consensus.tables import Row

PREPARE = "prepare"
ACCEPT = "accept"
_BOTH = (PREPARE, ACCEPT)

ACCEPTOR = (
    Row(_BOTH, ("of_another_log",)),
    Row(_BOTH, ("my_own",)),
    Row((ACCEPT,), ("without_a_value",)),
    Row(_BOTH, ("decided_already",), ("refuse", "tell_log"), RejectReason.POSITION_BEHIND),
    Row(_BOTH, ("too_far_ahead", "not_of_a_participant"), ("ask_log", "turn_back")),
    Row(_BOTH, ("too_far_ahead",), ("ask_log", "hand_on")),
    Row(_BOTH, ("takes_no_part", "not_of_a_participant")),
    Row(_BOTH, ("takes_no_part",), ("hand_on",)),
    Row((PREPARE,), ("not_of_a_participant",)),
    Row(_BOTH, ("of_a_stranger",), ("refuse",), RejectReason.NOT_AUTHORISED),
    Row(_BOTH, ("not_first",), ("refuse",), RejectReason.NOT_AUTHORISED),
    Row(_BOTH, ("not_of_its_originator",), ("refuse",), RejectReason.SIGNATURE_INVALID),
    Row(_BOTH, ("route_incomplete",), ("refuse",), RejectReason.PEER_MISSED),
    Row(_BOTH, ("below_promised",), ("refuse",), RejectReason.POSITION_TAKEN),
    Row((PREPARE,), ("has_voted_in_it",), ("refuse",), RejectReason.POSITION_TAKEN),
    Row((ACCEPT,), ("has_voted_otherwise_in_it",), ("refuse",), RejectReason.POSITION_TAKEN),
    Row((PREPARE,), ("another_is_at_it",), ("refuse",), RejectReason.POSITION_TAKEN),
    Row(_BOTH, ("ill_formed",), ("refuse",), RejectReason.ILL_FORMED),
    Row(_BOTH, ("cannot_write",), ("hand_on",)),
    Row((ACCEPT,), ("abstains",), ("hand_on",)),
    Row((PREPARE,), ("nothing_begun", "does_not_suit"), ("refuse_as_it_says",)),
    Row((PREPARE,), (), ("promise", "hear", "hand_on")),
    Row((ACCEPT,), (), ("vote", "count", "hear", "hand_on")),
)
