"""Reject reasons of Appendix C (1 to 7) and ours (8 and up). 8 bits on the wire; specs/03-wire.md, Reasons."""

from __future__ import annotations

from enum import IntEnum


class RejectReason(IntEnum):
    """Why a node said no."""

    POSITION_TAKEN = 1
    POSITION_BEHIND = 2
    PEER_MISSED = 3
    SIGNATURE_INVALID = 4
    ILL_FORMED = 5
    TOO_LARGE_FOR_PACKET = 6
    OUTSIDE_BOUNDS = 7
    STALE_VERSION = 8
    MODE_FORBIDS = 9
    NOT_MY_LOCATION = 10
    STORAGE_FULL = 11
    NOT_AUTHORISED = 12
    BUSY = 13
    LIMIT_EXCEEDED = 14
    NO_MAJORITY = 15
    NOT_READY = 16
    KEY_REVOKED = 17
    WRONG_INCARNATION = 18
    UNKNOWN_SCENE_OR_SPACE = 19
    POOL_BUSY = 20
    DAMAGED = 21
    TOO_FEW_COPIES = 22
