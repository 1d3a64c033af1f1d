"""Entries of a scene's log for people, and as JSON. No key of a scene leaves here."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from enum import Enum
from typing import TYPE_CHECKING, Any

from scenefold.base.ids import address_of

if TYPE_CHECKING:
    from scenefold.wire import LogEntry

PARTS_MAX = 4
"""Of a batch, in words; the rest is counted."""
_SECRET = {"KeyEpoch": ("previous",)}


def entry_text(entry: LogEntry) -> str:
    """One line."""
    from scenefold.wire import AddObserver, AddParticipant, Batch, RemoveObserver, RemoveParticipant

    match entry:
        case AddParticipant(member):
            return f"{address_of(member.node)} decides, too"
        case RemoveParticipant(member):
            return f"{address_of(member.node)} decides no more"
        case AddObserver(member):
            return f"{address_of(member.node)} observes"
        case RemoveObserver(member):
            return f"{address_of(member.node)} observes no more"
        case Batch(entries):
            shown = [entry_text(one) for one in entries[:PARTS_MAX]]
            return "; ".join(shown) + (f"; and {len(entries) - PARTS_MAX} more" if len(entries) > PARTS_MAX else "")
        case _:
            return _of_spaces(entry) or _of_access(entry)


def _of_spaces(entry: LogEntry) -> str:
    from scenefold.wire import BeginPurge, CreateSpace, RenderSettings, ScaleSpace, SetCopies, TranslateSpace

    match entry:
        case CreateSpace(parent=parent) if parent:
            return f"space {entry.space} for copies of space {parent}"
        case CreateSpace():
            return f"space {entry.space} {entry.name!r}, {entry.dimensions}D, {entry.copies} copies"
        case TranslateSpace(space, offset):
            return f"space {space} moved by {_numbers(offset)}"
        case ScaleSpace(space, factor):
            return f"space {space} scaled by {factor:g}"
        case SetCopies(space, copies, least):
            return f"space {space}: {copies} copies, at least {least}"
        case BeginPurge():
            return "a purge of deletions begins"
        case RenderSettings():
            said = [f"{name} {_setting(value)}" for name, value in entry.flat().items() if value is not None]
            return f"an image is by default: {', '.join(said) or 'not said'}"
        case _:
            return ""


def _of_access(entry: LogEntry) -> str:
    from scenefold.wire import EndScene, Grant, KeyEpoch, Revoke, SetMode

    match entry:
        case EndScene():
            return "the scene ends"
        case SetMode(mode):
            return f"mode {mode.name.lower()}"
        case Grant(name, role):
            return f"{name} is {role.name.lower()}"
        case Revoke(key):
            return f"the member with key {key:08x} is revoked"
        case KeyEpoch(epoch):
            return f"a new key, epoch {epoch}"
        case _:
            return type(entry).__name__


def entry_document(entry: LogEntry) -> dict[str, Any]:
    """Its kind and fields; keys of former epochs, which stand in some, are left out."""
    from scenefold.wire import Batch, RenderSettings

    kind = type(entry).__name__
    if isinstance(entry, Batch):
        return {"kind": kind, "entries": [entry_document(one) for one in entry.entries]}
    if isinstance(entry, RenderSettings):
        return {"kind": kind} | {name: _plain(value) for name, value in entry.flat().items()}
    left_out = _SECRET.get(kind, ())
    return {"kind": kind} | {one.name: _plain(getattr(entry, one.name)) for one in fields(entry) if one.name not in left_out}


def _plain(value: Any) -> Any:
    from scenefold.wire import KeyEntry, Member

    match value:
        case Member(node, incarnation):
            return {"address": address_of(node), "incarnation": incarnation.hex()}
        case KeyEntry(suite, raw):
            return {"suite": suite, "key": raw.hex()}
        case Enum():
            return value.name.lower()
        case bytes():
            return value.hex()
        case tuple():
            return list(value)
        case _:
            return value


def _setting(value: object) -> str:
    return _numbers(value) if isinstance(value, tuple) else repr(value)


def _numbers(values: Sequence[float]) -> str:
    return ",".join(f"{value:g}" for value in values)
