"""What is wrong with the copies of what one node owns, and what to do about it (specs/20-copies.md, Health). Pure.

People are told to wait only where what they wait for can come without them: not where a blacklist, a full disk, too few nodes or a node
that does not answer keeps it from coming.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

from scenefold.client.copy_reports import UNTOLD, CopiesOf, CopiesReport
from scenefold.client.health import NodeState
from scenefold.client.listing import some_text
from scenefold.client.own_warnings import strays_text
from scenefold.client.surroundings import Surroundings


@dataclass(frozen=True, slots=True)
class Ailment:
    """Something that is wrong at a node. `mends_itself`: nobody has to do anything but wait."""

    kind: str
    address: str
    text: str
    to_do: str
    degrades: bool = True
    mends_itself: bool = False

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md)."""
        known = {"kind": self.kind, "address": self.address or None, "text": self.text, "to_do": self.to_do}
        return {**known, "degrades": self.degrades, "mends_itself": self.mends_itself}


MAKE_ROOM = "free its disk, give it more (node run --capacity), or add a node"
_REPLACE_DISK = "replace its disk: drain it, or take it off the line once all others answer; else look at the disk (scenectl node verify) and start it anew"
_WAIT = "wait: what is missing is copied"
_RESTS = frozenset({"under-copied", "mis-placed", "comparing", "placing", "forbidden"})
"""What nobody mends while repair is paused."""


def ailments_of(node: NodeState, around: Surroundings) -> list[Ailment]:
    """Of one node that answers; nothing of one that does not."""
    return [_held_up(ailment, node) for ailment in _found(node, around)]


def _held_up(ailment: Ailment, node: NodeState) -> Ailment:
    if node.report is None or "repair" not in node.report.paused or ailment.kind not in _RESTS or not ailment.mends_itself:
        return ailment
    return replace(ailment, to_do=f"repair is paused there: scenectl node upkeep resume {node.address}", mends_itself=False)


def _found(node: NodeState, around: Surroundings) -> Iterable[Ailment]:
    address = node.address
    if node.report is None:
        return
    copies = node.report.copies
    if copies is None:
        yield Ailment("unknown", address, f"{address} says nothing of copies", "let it run the same version as the others")
        return
    under_copied = [_under_copied(node, copies, of, around) for of in _unexplained(copies, around)]
    yield from under_copied
    if not under_copied and copies.owed_to_silent:
        yield _owed(copies, address, around)
    yield from _forbidden(copies, address, around)
    if copies.full:
        text = f"{address}: {some_text(copies.full)} had no room for copies of what it owns; others hold them, as far as there are any"
        yield Ailment("no room", address, text, MAKE_ROOM, degrades=False)
    if copies.rotten or copies.rotten_more:
        yield _rotten(copies, address)
    if copies.unrecovered:
        yield _unrecovered(copies, address, around)
    yield from _on_their_way(node, copies, around)


def _unrecovered(copies: CopiesReport, address: str, around: Surroundings) -> Ailment:
    text = f"{address}: it does not know yet what was acknowledged on {copies.unrecovered_share:.1%} of the line, which it took over"
    if copies.named_most:
        named = some_text([f"{node} ({count:,})" for node, count in copies.named_most])
        text += f": more pieces are said to be held there than it can keep, most of them by {named}"
        to_do = "if one of these cannot hold so many pieces, it lies: take it off the line (scenectl cluster revoke)"
        return Ailment("unrecovered", address, text, to_do)
    to_do = f"{around.start}: every node is asked what it has" if around.silent else "wait: every node is asked"
    return Ailment("unrecovered", address, text, to_do, mends_itself=not around.silent)


def _unexplained(copies: CopiesReport, around: Surroundings) -> list[CopiesOf]:
    """Where records lack copies, and that is not said already by naming why so few can be there."""
    return [of for of in copies.by_copies if of.under_copied and (around.silent or not copies.is_explained(of))]


def _under_copied(node: NodeState, copies: CopiesReport, of: CopiesOf, around: Surroundings) -> Ailment:
    spaces = f" in spaces with {of.copies} copies" if of.copies != UNTOLD else ""
    text = (
        f"{node.address}: {of.under_copied:,} of {of.records:,} records{spaces} lie on fewer nodes than they should, "
        f"up to {of.missing_max} {'copy' if of.missing_max == 1 else 'copies'} fewer"
    )
    short, mends_itself = copies.shortage_of(of), False
    if around.silent:
        to_do = f"{around.start}; then others get copies"
    elif short is not None:
        to_do = f"see above: there can be {short.possible} of them; as far as these are missing they are copied meanwhile"
    elif copies.full and of.copies != UNTOLD and not around.has_room(node, copies, of.copies - 1):
        to_do = f"no other node has room for them; of {some_text(copies.full)}: {MAKE_ROOM}"
    else:
        to_do, mends_itself = _WAIT, True
    return Ailment("under-copied", node.address, text, to_do, mends_itself=mends_itself)


def _owed(copies: CopiesReport, address: str, around: Surroundings) -> Ailment:
    """What is to come to nodes that do not answer. To those that were removed nothing comes any more: nobody has to start them."""
    text = f"{address}: {copies.owed_to_silent:,} records are still to come to {some_text(copies.silent)}, which it does not hear"
    members = {node.address for node in around.nodes}
    left = [silent for silent in copies.silent if silent in members]
    if left or not copies.silent:
        return Ailment("owed", address, text, f"start {some_text(left) or 'the nodes that are silent'}, or see what is between them")
    what = "was removed" if len(copies.silent) == 1 else "were removed"
    to_do = f"wait: what {some_text(copies.silent)}, which {what}, was to get is owed no longer once others hold its copies"
    return Ailment("owed", address, text, to_do, degrades=False, mends_itself=True)


def _forbidden(copies: CopiesReport, address: str, around: Surroundings) -> Iterable[Ailment]:
    if not copies.forbidden.records:
        return
    kept = sum(of.forbidden for of in copies.by_copies if _stays(copies, of))
    where = f"lie on {some_text(copies.forbidden_on)}, where its blacklist forbids it"
    if kept:
        text = f"{address}: copies of {kept:,} records {where}, and stay there: nobody may take their place"
        yield Ailment("forbidden", address, text, "see above: once its blacklist allows enough others, they go there")
    if going := copies.forbidden.records - kept:
        to_do = f"{around.start}; then they go to others" if around.silent else _WAIT
        yield Ailment("forbidden", address, f"{address}: copies of {going:,} records {where}", to_do, mends_itself=not around.silent)


def _stays(copies: CopiesReport, of: CopiesOf) -> bool:
    return any(short.keeps_forbidden for short in copies.shortages if of.copies in (UNTOLD, short.copies))


def _rotten(copies: CopiesReport, address: str) -> Ailment:
    healing = copies.rotten - copies.unhealed
    counts = [f"{healing:,} are being fetched from others"] if healing else []
    counts += [f"{copies.unhealed:,} could not be had from others, at the last try"] if copies.unhealed else []
    if copies.rotten_more:
        known = f"; of those that it knows {', '.join(counts)}" if counts else ""
        text = f"{address}: more records have rotted on its disk than it can remember, so it is not known how many are not healed{known}"
        return Ailment("rotten", address, text, _REPLACE_DISK)
    text = f"{address}: {copies.rotten:,} records have rotted on its disk: {', '.join(counts)}"
    anew = "write what is lost anew, or restore it; then look at the disk: scenectl node verify"
    return Ailment("rotten", address, text, anew if copies.unhealed else "wait; then look at its disk", mends_itself=not copies.unhealed)


def _on_their_way(node: NodeState, copies: CopiesReport, around: Surroundings) -> Iterable[Ailment]:
    """What costs no copy, and ends by itself, but for what keeps it from that."""
    address = node.address

    def mending(kind: str, text: str, keeps: str = "") -> Ailment:
        return Ailment(kind, address, f"{address}: {text}", keeps or "wait", degrades=False, mends_itself=not keeps)

    silent = f"{around.start}: it may need their answers" if around.silent else ""
    too_few = "see above: it waits until more nodes may hold copies for {}"
    if any(of.missing_max and not of.under_copied and not copies.is_explained(of) for of in copies.by_copies):
        text = "who is to hold copies of a part of its arc, where there are no records yet, is being settled"
        yield mending("placing", text, silent)
    if copies.mis_placed.records:
        text = f"copies of {copies.mis_placed.records:,} records move to other nodes; until then the former ones count"
        yield mending("mis-placed", text, silent)
    if copies.comparing.records:
        yield mending("comparing", f"{copies.comparing.records:,} records that it took over are being compared with their copies", silent)
    if copies.owed > copies.owed_to_silent:
        full = f"what is to come to {some_text(copies.full_owed)} has no room there: {MAKE_ROOM}" if copies.full_owed else ""
        yield mending("pending", f"{copies.owed - copies.owed_to_silent:,} copies are on their way", full)
    if copies.unsettled:
        keeps = too_few.format(address) if address in around.refusing else silent
        yield mending("unsettled", f"{copies.unsettled:,} records wait until enough nodes have them", keeps)
    if node.report is not None and node.report.strays:
        # Who owns these places takes them for good once so many have them as a write needs.
        keeps = f"{too_few.format(some_text(around.refusing))}, as far as they belong there" if around.refusing else silent
        yield mending("strays", f"{strays_text(node.report)} records that belong elsewhere are being brought home", keeps)
