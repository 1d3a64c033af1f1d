"""A store looked at as a whole, and mended (specs/21-verify.md)."""

from scenefold.store.checking.findings import Finding, Findings, Helps
from scenefold.store.checking.mending import Mended, mend
from scenefold.store.checking.records import Judge, Tell, nobody_can_tell
from scenefold.store.checking.singles import check_format, read_identity, sound_holding
from scenefold.store.checking.tables import EVERY_KEY, Sound
from scenefold.store.checking.whole import as_far_as_it_goes, check_store, silent

__all__ = [
    "EVERY_KEY",
    "Finding",
    "Findings",
    "Helps",
    "Judge",
    "Mended",
    "Sound",
    "Tell",
    "as_far_as_it_goes",
    "check_format",
    "check_store",
    "mend",
    "nobody_can_tell",
    "read_identity",
    "silent",
    "sound_holding",
]
