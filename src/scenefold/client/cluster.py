"""A cluster as its user sees it: who is there, and which scenes it holds."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial, reduce
from typing import TypeVar, Unpack

import trio

from scenefold.base.errors import PeerFault, Refused, ScenefoldError, Unreachable, UsageFault
from scenefold.base.ids import KeyId, NodeId, address_of, node_id_of
from scenefold.base.limits import CLIENT_STATUS_S
from scenefold.base.location import FIRST, Arc
from scenefold.base.prefixes import AddressPrefix, Blacklist
from scenefold.client.calls import Calls, no_answer
from scenefold.client.cluster_health import ClusterHealth, health_of
from scenefold.client.contacts import contacts
from scenefold.client.health import NEVER_CAME, ClusterStatus, NodeState, judged
from scenefold.client.hedging import more_telling
from scenefold.client.known_log import NOTHING_KNOWN, Known, KnownLog
from scenefold.client.membership import Membership
from scenefold.client.orders import Orders
from scenefold.client.possible_copies import shortages_to_come
from scenefold.client.progress import ProgressCallback, callback_of
from scenefold.client.proof import Proof
from scenefold.client.proving import Proving
from scenefold.client.proving_reads import NodeReads
from scenefold.client.proving_scenes import shown_scenes
from scenefold.client.public_keys import find_public_key
from scenefold.client.reencryption import Pace
from scenefold.client.removals import RemovedNode, removed_nodes, still_gone
from scenefold.client.reports import DrainReport, NodeReport, read_drain_report, read_report
from scenefold.client.scenes import Scenes
from scenefold.client.shortages import Shortage
from scenefold.client.table import Owner
from scenefold.client.together import together
from scenefold.client.upkeep import Upkeep, UpkeepChanges, change_upkeep
from scenefold.client.voters import Voters
from scenefold.crypto import Card, MemberSecrets, PublicKey
from scenefold.scene.log import Decider
from scenefold.wire import AcknowledgeLosses, BlacklistChanged, ChangeBlacklist, DrainNode, LossesKept, RequestReport, RespondTable, Status
from scenefold.wire import NodeReport as Reported
from scenefold.wire.loss_packets import LOSSES_KEPT_MAX
from scenefold.world import Links, Priority, World
from scenefold.world.log_file import LogFile
from scenefold.world.profile import ClusterProfile

Result = TypeVar("Result")

LOOKS_MAX = 3
"""Looks at a cluster in which something seems off, before that is believed."""
LOOK_AGAIN_S = 0.7
"""Between them: a released piece is claimed by then, a new entry of the log has come round."""
ASKED_MAX = 64
"""Nodes that are asked for their report at a time."""


class Cluster:
    """Made by `connect`. `calls` and `links` are there for rooms above, such as the renderer's client; `log` is to be run."""

    def __init__(self, profile: ClusterProfile, world: World, links: Links, secrets: MemberSecrets, known: Known = NOTHING_KNOWN) -> None:
        """`known`: what the profile has kept of the cluster's log."""
        founders = [member for member in profile.members if member.node_id in profile.founders]
        self.profile = profile
        self.name = profile.name
        self.links = links
        self.calls = Calls(world, links, [m.address for m in founders], [m.node_id for m in founders], spares=contacts(profile, known[0]))
        member = f"user:{profile.user}"
        me, file = (member, secrets.signing.public.key_id), LogFile(profile.folder)
        self.log = KnownLog(self.calls, profile.genesis_header, profile.log_key, profile.voters[0], me, file, known, links.check_again)
        self.calls.check_own, self.calls.heard = self.log.check_own, self.log.heard
        links.refusal_of = self.log.refusal_of
        orders = Orders(self.calls, profile.cluster_id, member, secrets.signing, self.log)
        self.membership = Membership(self.calls, profile, secrets, self.log, orders)
        self.voters = Voters(self.log, orders, profile.voters[0], self.reports, self.calls.world.clock)
        voter = profile.voter
        origin = Decider(voter.node_id, voter.public_key.raw)
        card_of, newest = self.membership.card_of, self.log.newest
        self.scenes = Scenes(self.calls, profile.keyring, secrets, origin, member, card_of=card_of, cluster_log=newest)

    async def nodes(self) -> list[Owner]:
        """All nodes on the line with their right bounds, as one of them knows them; those that own nothing last."""
        await self.calls.refresh()
        return list(self.calls.table.owners)

    async def shortages(self, copies: int, copies_min: int) -> list[Shortage]:
        """Where a space with so many copies, of which so many must be there, lacks some with the nodes that there are; empty if nowhere.

        By what a node says, or, if none answers now, by what is known already.
        """
        with suppress(Unreachable, Refused, PeerFault):
            await self.calls.refresh()
        return shortages_to_come(self.calls.table.owners, copies, copies_min)

    async def card_of(self, name: str) -> Card:
        """The card of a member, "user:<name>" or "node:<id>", verified. LocalFault if there is no such member."""
        return await self.membership.card_of(name)

    async def public_key(self, key_id: KeyId) -> PublicKey | None:
        """The public key with this id, of a member or of a scene, from any node that knows it; None if none does.

        To look at, not to trust: keys of the same id can be searched for (client/public_keys.py).
        """
        return await find_public_key(self.calls, [owner.address for owner in await self.nodes()], key_id)

    async def status(self) -> ClusterStatus:
        """Ask every node on the line itself, all at once, and lay what they say side by side. Unreachable if none answers.

        What may look off only because bounds move while nodes are asked is looked at again, up to LOOKS_MAX times.
        """
        first: NodeId | None = None
        for look in range(LOOKS_MAX):
            if look:
                await self.calls.world.clock.sleep(LOOK_AGAIN_S)
            found = await self.look(first)
            if not found.is_unsteady:
                break
            first = found.best_informed
        # Nobody is asked once more for this: what those who answered claim to know of the log is learnt, as far as they show it.
        await self.log.settled()
        return replace(found, removed=still_gone(removed_nodes(self.log.view)))

    async def health(self) -> ClusterHealth:
        """How it stands with the copies of all records, by what the nodes say of what they own. Unreachable if none answers."""
        return health_of(await self.status())

    async def acknowledge_losses(self, health: ClusterHealth) -> None:
        """Let no node tell any more what may be lost as `health` has it. For administrators. A node that does not answer goes on telling it.

        Refused or PeerFault if one does not take it, as with a full disk, once all others were asked.
        """
        ids = [bytes.fromhex(loss.id) for loss in health.losses]
        # Each node keeps no more than that, but not all need keep the same.
        parts = [tuple(ids[first : first + LOSSES_KEPT_MAX]) for first in range(0, len(ids), LOSSES_KEPT_MAX)]
        failed: list[Refused | PeerFault] = []
        for node in health.status.nodes if ids else ():
            if node.alive:
                try:
                    for part in parts:
                        await self.calls.ask(node.address, AcknowledgeLosses(part), LossesKept, priority=Priority.HIGH)
                except Unreachable:
                    # One that has died since holds up none of the others: it tells it when it is back, and so does the health that is asked for next.
                    continue
                except (Refused, PeerFault) as problem:
                    failed.append(problem)
        if failed:
            raise failed[0]

    async def prove(
        self,
        health: ClusterHealth,
        scene: str | None = None,
        progress: ProgressCallback | bool = False,
        bytes_per_s: float | None = None,
        into: Proof | None = None,
    ) -> Proof:
        """Read all copies of all records, or of those of one scene, by its name or id, and see which are valid; no scene's key is needed.

        `health`: as it was just now, for who does not answer is not waited for again. May be cancelled at any time: `into` has then what was found so far.
        """
        shown = await shown_scenes(self.calls, self.scenes, scene)
        silent = [node_id_of(node.address) for node in health.status.nodes if not node.alive]
        reads = NodeReads(self.calls, Pace(bytes_per_s), silent)
        total = None if scene is not None else health.records
        return await Proving(self.calls, shown, reads, callback_of(progress), total, into).run()

    async def removed(self) -> tuple[RemovedNode, ...]:
        """All nodes that were ever taken off the line, and why, the newest first. Unreachable if no node shows the cluster's log."""
        return removed_nodes(await self.log.newest())

    async def reports(
        self, addresses: Sequence[str] | None = None, *, timeout_s: float = CLIENT_STATUS_S
    ) -> dict[str, NodeReport | ScenefoldError]:
        """What these nodes (all on the line, by the table of one of them) say of themselves; the error of one that does not answer."""
        if addresses is None:
            addresses = [owner.address for owner in await self.nodes()]
        found: dict[str, NodeReport | ScenefoldError] = {}
        slots = trio.CapacityLimiter(ASKED_MAX)

        async def ask(address: str) -> None:
            async with slots:
                try:
                    reply = await self.calls.ask(address, RequestReport(), Reported, priority=Priority.HIGH, timeout_s=timeout_s)
                    found[address] = read_report(reply.document, address)
                except (Unreachable, Refused, PeerFault) as error:
                    found[address] = error

        await together(partial(ask, address) for address in addresses)
        return found

    async def drain(self, address: str, *, check_only: bool = False, cancel: bool = False) -> DrainReport:
        """Tell a node to give everything away and leave, or ask how far it is; asking again does no harm.

        `check_only`: only say whether it may be switched off. `cancel`: stay after all. Not both:
        UsageFault. Refused (12) of a node that cannot leave.
        """
        if check_only and cancel:
            raise UsageFault("a node can be asked whether it may leave, or told to stay, not both at once", remedy="give one of them")
        packet = DrainNode(check_only=check_only, cancel=cancel)
        reply = await self.calls.ask(address, packet, Reported, priority=Priority.HIGH)
        return read_drain_report(reply.document, address)

    async def blacklist(
        self, address: str, *, add: Sequence[AddressPrefix] = (), remove: Sequence[AddressPrefix] = (), expected: int | None = None
    ) -> Blacklist:
        """Which nodes must hold no copies of what this node owns, after the change that is asked for, if any; for administrators, if any.

        What stands there already may be added again. `expected`: the version that is to be changed; Refused (8) if it is
        another by now. Refused (7) of what is to go and is not there, of the node's own address, and of more than fit.
        """
        both = [str(prefix) for prefix in add if prefix in remove]
        if both:
            raise UsageFault(f"{', '.join(both)} cannot be put on a blacklist and taken off it at once", remedy="choose")
        packet = ChangeBlacklist(tuple(add), tuple(remove), expected)
        reply = await self.calls.ask(address, packet, BlacklistChanged, priority=Priority.HIGH)
        return Blacklist(reply.version, reply.prefixes)

    async def upkeep(self, address: str, **changes: Unpack[UpkeepChanges]) -> Upkeep:
        """What of its upkeep a node has paused, and how fast it may go, after the change that is asked for, if any; for administrators, if any."""
        return await change_upkeep(self.calls, address, **changes)

    async def look(self, first: NodeId | None = None) -> ClusterStatus:
        """One look at the cluster by the table of `first` (any node); what seems off may be so only because bounds move."""
        table = await self.calls.refresh(first)
        line = self.line_of(table)
        reports = await self.reports([address for _, address in line])
        if not any(isinstance(report, NodeReport) for report in reports.values()):
            raise no_answer([address for _, address in line], _most_telling(reports.values()))
        return judged(self.name, *self.states(table, reports))

    def line_of(self, table: RespondTable) -> list[tuple[NodeId, str]]:
        """Who is on the line, and where to reach them."""
        statuses = [status.node for status in table.statuses]
        # A node that has just begun has an empty table: then the founders are who there may be.
        return [(node, self.calls.address_of(node)) for node in statuses or self.profile.founders]

    def states(self, table: RespondTable, reports: Mapping[str, NodeReport | ScenefoldError]) -> tuple[str, list[NodeState]]:
        """Whose table it is, and what it and the reports of all nodes on the line say of each."""
        statuses = {status.node: status for status in table.statuses}
        answered = [report for report in reports.values() if isinstance(report, NodeReport)]
        asked = _address_of_sender(table) or (answered[0].address if answered else next(iter(reports)))
        views = reports.get(asked)
        peers = views.peers if isinstance(views, NodeReport) else {}
        nodes = []
        for node, address in self.line_of(table):
            status, report = statuses.get(node), reports[address]
            heard_s = 0.0 if address == asked else peers[address].heard_s if address in peers else None
            told = ((), 0) if status is None else (tuple(map(str, status.blacklist)), status.blacklist_version)
            listed, version = (report.blacklist, report.blacklist_version) if isinstance(report, NodeReport) else told
            nodes.append(
                NodeState(
                    address=address,
                    incarnation=NEVER_CAME if status is None else status.incarnation,
                    is_voter=node in self.log.voters,
                    known_arc=None if status is None else _arc_of(status),
                    heard_s=heard_s,
                    report=report if isinstance(report, NodeReport) else None,
                    problem=report.what.removeprefix("no connection to the node: ") if isinstance(report, ScenefoldError) else "",
                    blacklist=listed,
                    blacklist_version=version,
                )
            )
        return asked, nodes

    async def in_worker(self, lane: str, function: Callable[..., Result], *arguments: object) -> Result:
        """Run what computes or blocks in a thread of this client's lane."""
        return await self.calls.world.workers.run(lane, function, *arguments)


def _most_telling(ends: Iterable[object]) -> ScenefoldError | None:
    """Of what nodes could not be asked for: the error that says most."""
    silences = [end for end in ends if isinstance(end, Unreachable)]
    return reduce(more_telling, silences) if silences else next((end for end in ends if isinstance(end, ScenefoldError)), None)


def _address_of_sender(table: RespondTable) -> str | None:
    return None if table.mini_status is None else address_of(table.mini_status.node)


def _arc_of(status: Status) -> Arc | None:
    """What a status claims to own."""
    if status.right_bound is None:
        return None
    first = FIRST if status.left_fence is None else status.left_fence.next()
    return None if first is None else Arc(first, status.right_bound)
