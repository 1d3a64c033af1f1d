"""`scenectl scene log`: what a scene's log says, and who decided it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any

from scenectl.entry_text import entry_document, entry_text
from scenectl.names import SceneName
from scenectl.output import DEFAULT_PROFILE, ProfileOutput, date_text, emit, table
from scenectl.values import whole
from scenefold.base.ids import address_of

if TYPE_CHECKING:
    from scenefold.client import LogStory
    from scenefold.client.log_story import ToldEntry

LAST_MAX = 65_536


def log(
    scene: SceneName,
    /,
    *,
    last: Annotated[int | None, whole(1, LAST_MAX)] = None,
    output: ProfileOutput = DEFAULT_PROFILE,
) -> None:
    """Show what a scene's log says, an entry a line: by which owners' key it is signed, which node proposed it, which ones accepted it, and when.

    All of it is verified: that each entry follows the one before, its signature, the votes. When it was, is what one of those nodes has noted, by its clock.

    Example: scenectl scene log kitchen --last 20 --profile studio

    Parameters
    ----------
    scene
        Name of the scene.
    last
        The newest entries that are shown; by default all.
    """
    from scenectl.running import connected, run

    async def ask() -> LogStory:
        async with connected(output.profile) as cluster:
            return await (await cluster.scenes.open(scene)).log(last)

    found = run(ask)
    document = {
        "scene": scene,
        "position": found.position,
        "in_snapshot": found.before,
        "seen_by": None if found.seen_by is None else address_of(found.seen_by),
        "entries": [_document(entry, found) for entry in found.entries],
    }
    emit(output, document, log_text(found))


def log_text(found: LogStory) -> str:
    """A table, and whose word it is."""
    titles = ("position", "entry", "signed by", "proposed by", "accepted by", "seen")
    rows = [_row(entry, found) for entry in found.entries]
    lines = [table(titles, rows)] if rows else []
    if found.before:
        lines.append(f"Positions 1 to {found.before} are in a snapshot: what they came to is known, and no more.")
    if found.seen_by is not None:
        lines.append(f"Proposed, accepted and seen as {address_of(found.seen_by)} has it; the votes are verified.")
    elif found.why:
        lines.append(f"Who decided is not told: {found.why}")
    return "\n".join(lines)


def _row(entry: ToldEntry, found: LogStory) -> tuple[str, ...]:
    key = f"key {entry.signed_by:08x}"
    if not entry.participants:
        return str(entry.position), entry_text(entry.record.entry), key, "", f"{address_of(found.origin)} alone", ""
    vouched = entry.vouched
    if vouched is None:
        return str(entry.position), entry_text(entry.record.entry), key, "?", "?", "?"
    accepted = f"{len(vouched.voters)} of {len(entry.participants)}: {_addresses(vouched.voters)}"
    seen = "?" if vouched.seen_s is None else date_text(vouched.seen_s)
    return str(entry.position), entry_text(entry.record.entry), key, address_of(vouched.proposer), accepted, seen


def _document(entry: ToldEntry, found: LogStory) -> dict[str, Any]:
    vouched = entry.vouched
    deciders = [address_of(one.member.node) for one in entry.participants] or [address_of(found.origin)]
    return {
        "position": entry.position,
        "request": entry.record.request_id.hex(),
        "entry": entry_document(entry.record.entry),
        "signed_by": f"{entry.signed_by:08x}",
        "decided_by": deciders,
        "by_origin_alone": not entry.participants,
        "proposed_by": None if vouched is None else address_of(vouched.proposer),
        "ballot": None if vouched is None else vouched.ballot,
        "accepted_by": None if vouched is None else [address_of(node) for node in vouched.voters],
        "seen": None if vouched is None or vouched.seen_s is None else date_text(vouched.seen_s),
    }


def _addresses(nodes: Sequence[Any]) -> str:
    return ", ".join(map(address_of, nodes))
