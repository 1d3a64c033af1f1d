"""A scene's log: which spaces a scene has, what their addresses mean and who may use it, as a pure fold of its records.

Light to import: numpy and the curves come with the first position that is asked for. specs/16-scene-log.md.
"""

from scenefold.scene.log.affine import Affine
from scenefold.scene.log.book import SceneLog
from scenefold.scene.log.bytes import OpenedLog, open_private, seal_private, sign_record, sign_snapshot
from scenefold.scene.log.certified import BY_PARTICIPANTS, CHANGES_MAX, changes_before, changes_left, decided_by_votes
from scenefold.scene.log.decisions import Decider, check_decided, check_log, check_told, decided, hash_of_log
from scenefold.scene.log.first import first_entry, first_log, first_record
from scenefold.scene.log.following import Draft, Followed, follow, header_keys, keys_after, keys_with_log, lockbox_for, signed_header
from scenefold.scene.log.grants import FOR_EVER, Granted, Grants
from scenefold.scene.log.keys import EpochKeys, SceneKeys
from scenefold.scene.log.lockboxes import Contents, check_granter, keys_in, locked, own_lockbox, unlocked
from scenefold.scene.log.new_shadows import free_offset, missing_shadows, with_shadows
from scenefold.scene.log.roster import Roster
from scenefold.scene.log.shadows import Layouts, free_offsets
from scenefold.scene.log.shortening import cut_at, shortened
from scenefold.scene.log.space import CellBox, LoggedSpace, SpaceFault
from scenefold.scene.log.states import packed_state, unpacked_state
from scenefold.scene.log.succession import header_key_now, proven_header_key, succeeded
from scenefold.scene.log.turns import Turn
from scenefold.scene.log.undecided import Undecided
from scenefold.scene.log.values import deciders_after, opened_value, value_of, without_log

__all__ = [
    "BY_PARTICIPANTS",
    "CHANGES_MAX",
    "FOR_EVER",
    "Affine",
    "CellBox",
    "Contents",
    "Decider",
    "Draft",
    "EpochKeys",
    "Followed",
    "Granted",
    "Grants",
    "Layouts",
    "LoggedSpace",
    "OpenedLog",
    "Roster",
    "SceneKeys",
    "SceneLog",
    "SpaceFault",
    "Turn",
    "Undecided",
    "changes_before",
    "changes_left",
    "check_decided",
    "check_granter",
    "check_log",
    "check_told",
    "cut_at",
    "decided",
    "decided_by_votes",
    "deciders_after",
    "first_entry",
    "first_log",
    "first_record",
    "follow",
    "free_offset",
    "free_offsets",
    "hash_of_log",
    "header_key_now",
    "header_keys",
    "keys_after",
    "keys_in",
    "keys_with_log",
    "lockbox_for",
    "locked",
    "missing_shadows",
    "open_private",
    "opened_value",
    "own_lockbox",
    "packed_state",
    "proven_header_key",
    "seal_private",
    "shortened",
    "sign_record",
    "sign_snapshot",
    "signed_header",
    "succeeded",
    "unlocked",
    "unpacked_state",
    "value_of",
    "with_shadows",
    "without_log",
]
