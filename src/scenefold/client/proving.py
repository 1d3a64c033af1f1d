"""All copies of all records are read, and what is missing, mis-placed or corrupt is named (specs/20-copies.md, Health).

What each node that should have a record answers is verified; if that is not enough, all others are asked. What seems off is looked at again
at the end: bounds and records move while they are read.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping, Sequence
from contextlib import aclosing
from functools import partial

import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId, SpaceId
from scenefold.base.limits import CLIENT_GET_KEYS
from scenefold.client.calls import Calls
from scenefold.client.progress import ProgressCallback, ProgressState, no_progress
from scenefold.client.proof import Finding, Proof, Unlisted, Verdict, domains_of, newest_alone
from scenefold.client.proving_reads import NodeReads, Said, Stray, record_of
from scenefold.client.proving_scenes import Checked, ShownScene, check_all, newer_scene
from scenefold.client.ranging import entries
from scenefold.client.split import frames
from scenefold.client.table import RoutingTable
from scenefold.client.together import together, worked_off
from scenefold.client.verifying import Key
from scenefold.crypto import wanted_place
from scenefold.wire import RecordBytes

LOOKS_MAX = 3
LOOK_AGAIN_S = 1.0
"""Before what seems off is looked at again: a piece that is on its way has been claimed by then."""
SUSPECTS_MAX = 65_536
"""Records that are looked at again; of more what was seen first counts."""
OTHERS_MAX = 64
"""Nodes that are asked besides those that should have a record."""

Batch = tuple[int, list[Key]]
"""Of which scene, by number."""


class Proving:
    """One proof. `total`: how many records there may be, for whoever waits."""

    def __init__(
        self,
        calls: Calls,
        scenes: Sequence[ShownScene],
        reads: NodeReads,
        progress: ProgressCallback = no_progress,
        total: int | None = None,
        proof: Proof | None = None,
    ) -> None:
        """`proof`: filled as it goes on, for whoever interrupts it."""
        self._calls = calls
        self._scenes = list(scenes)
        self._reads = reads
        self._progress = progress
        self._total = total
        self._suspects: list[tuple[int, Key]] = []
        self._told = 0
        self._proof = Proof() if proof is None else proof
        self._proof.scenes = tuple(scene.name for scene in scenes)

    async def run(self) -> Proof:
        """Read everything once, and what seems off again."""
        clock = self._calls.world.clock
        begun = clock.now()
        await self._calls.learn()
        await self._over(self._list)
        for look in range(1, LOOKS_MAX):
            suspects, self._suspects = self._suspects, []
            if not suspects:
                break
            await clock.sleep(LOOK_AGAIN_S)
            await self._calls.refresh()
            await self._over(partial(self._again, suspects), is_last=look == LOOKS_MAX - 1)
        self._proof.seconds, self._proof.ended = clock.now() - begun, True
        self._tell()
        return self._proof

    # -------------------------------------------------------------------------------------------------- what there is

    async def _over(self, source: Callable[[trio.MemorySendChannel[Batch]], Awaitable[None]], *, is_last: bool = False) -> None:
        await worked_off(source, partial(self._work, is_last))

    async def _list(self, send: trio.MemorySendChannel[Batch]) -> None:
        for index, scene in enumerate(self._scenes):
            for space in scene.spaces:
                await self._list_space(send, index, space)

    async def _list_space(self, send: trio.MemorySendChannel[Batch], index: int, space: SpaceId) -> None:
        """By the arcs of owners, so that one that is silent keeps nobody from the others."""
        scene, keys = self._scenes[index], list[Key]()
        for owner, arc in self._calls.table.arcs():
            if self._reads.is_silent(owner.node_id):
                self._not_listed(Unlisted(owner.address, arc, "it does not answer"))
                continue
            try:
                async with aclosing(entries(self._calls, scene.scene, space, arc.first, arc.last, stale_ok=False)) as listed:
                    async for location, object_id in listed:
                        keys.append((space, location, object_id) if object_id else (space, location))
                        if len(keys) == CLIENT_GET_KEYS:
                            await send.send((index, keys))
                            keys = []
            except Unreachable as silence:
                self._reads.fell_silent(owner.node_id)
                self._not_listed(Unlisted(owner.address, arc, silence.what))
            except (Refused, PeerFault) as problem:
                self._not_listed(Unlisted(owner.address, arc, problem.what, scene.name, space))
        if keys:
            await send.send((index, keys))

    def _not_listed(self, what: Unlisted) -> None:
        if not any(known[:2] == what[:2] and known[3:] in ((what.scene, what.space), ("", None)) for known in self._proof.unlisted):
            self._proof.unlisted.append(what)

    async def _again(self, suspects: Sequence[tuple[int, Key]], send: trio.MemorySendChannel[Batch]) -> None:
        for index in range(len(self._scenes)):
            keys = [key for number, key in suspects if number == index]
            for part in frames(range(len(keys)), [1] * len(keys), CLIENT_GET_KEYS):
                await send.send((index, [keys[place] for place in part]))

    async def _work(self, is_last: bool, batch: Batch) -> None:
        index, keys = batch
        for finding in await self._look(index, keys):
            if finding.is_worth_another_look and not is_last and len(self._suspects) < SUSPECTS_MAX:
                self._suspects.append((index, finding.key))
            else:
                self._proof.add(finding)
        self._proof.bytes = self._reads.bytes
        self._tell()

    def _tell(self) -> None:
        proof = self._proof
        # What is looked at again was looked at, and so was what has gone since: never less than was told before.
        self._told = done = max(self._told, proof.records + len(self._suspects))
        # That these are all is known at the end alone: what seems off is looked at again, and there may be more than nodes have counted.
        total = done if proof.ended else self._total if self._total is None or self._total > done else None
        self._progress(ProgressState("prove", done, total, f"records, {proof.bytes / 2**20:.1f} MiB read"))

    # ------------------------------------------------------------------------------------------------ what each node has

    async def _look(self, index: int, keys: Sequence[Key]) -> list[Finding]:
        table, layouts = self._calls.table, self._scenes[index].layouts
        homes = [wanted_place(key[2]) if len(key) == 3 else key[1] for key in keys]
        offsets = [layouts.offsets.get(key[0], ()) for key in keys]
        placed = [
            (table.owner_of(home).node_id, *(table.holders_of(layout, home, layouts.needed[key[0]]) if layout else ()))
            for key, home, layout in zip(keys, homes, offsets, strict=True)
        ]
        said: list[dict[NodeId, Said]] = [{} for _ in keys]
        sure = [False] * len(keys)

        async def ask_owner(node: NodeId, numbers: list[int]) -> None:
            answers, arc = await self._reads.owned(node, self._scenes[index], [keys[number] for number in numbers])
            for number, answer in zip(numbers, answers, strict=True):
                sure[number] = arc is not None and homes[number] in arc
                # Else another node's record was handed on, perhaps.
                said[number][node] = answer if sure[number] else Verdict.SILENT

        async def ask_holder(node: NodeId, numbers: list[int]) -> None:
            answers = await self._reads.held(node, self._scenes[index], [keys[number] for number in numbers])
            for number, answer in zip(numbers, answers, strict=True):
                said[number][node] = answer

        everything = range(len(keys))
        owners = _grouped({number: placed[number][:1] for number in everything})
        holders = _grouped({number: placed[number][1:] for number in everything})
        await together(
            [
                *(partial(ask_owner, node, numbers) for node, numbers in owners.items()),
                *(partial(ask_holder, node, numbers) for node, numbers in holders.items()),
            ]
        )
        findings = await self._findings(index, table, keys, placed, said, sure)
        # Who holds more than it should by now may have what others lack.
        short = [number for number in everything if offsets[number] and findings[number].is_short]
        if short:
            nodes = [owner.node_id for owner in table.owners]
            others = {number: [node for node in nodes if node not in said[number]][:OTHERS_MAX] for number in short}
            await together(partial(ask_holder, node, numbers) for node, numbers in _grouped(others).items())
            findings = await self._findings(index, table, keys, placed, said, sure)
        return findings

    async def _findings(
        self,
        index: int,
        table: RoutingTable,
        keys: Sequence[Key],
        placed: Sequence[tuple[NodeId, ...]],
        said: Sequence[dict[NodeId, Said]],
        sure: Sequence[bool],
    ) -> list[Finding]:
        shown = [(number, node, record) for number, told in enumerate(said) for node, one in told.items() if (record := record_of(one))]
        checked = await self._checked(index, [(keys[number], record) for number, _, record in shown])
        known = {(number, node): found for (number, node, _), found in zip(shown, checked, strict=True)}
        findings = []
        for number, key in enumerate(keys):
            verdicts: dict[NodeId, Verdict] = {}
            for node, one in said[number].items():
                if isinstance(one, Stray) and known[number, node].version is None:
                    # What no writer has signed is no copy of anything, and belongs to nobody here.
                    one = None
                if isinstance(one, Stray):
                    verdicts[node] = Verdict.ELSEWHERE
                elif isinstance(one, RecordBytes):
                    verdicts[node] = Verdict.CORRUPT if known[number, node].version is None else Verdict.VALID
                elif one is not None or node in placed[number]:
                    verdicts[node] = Verdict.NOTHING if one is None else one
            sound = (Verdict.VALID, Verdict.ELSEWHERE)
            versions = {node: known[number, node].version for node, verdict in verdicts.items() if verdict in sound}
            verdicts = newest_alone(verdicts, versions)
            valid = [node for node, verdict in verdicts.items() if verdict is Verdict.VALID]
            findings.append(
                Finding(
                    scene=self._scenes[index].name,
                    key=key,
                    wanted=self._scenes[index].layouts.wanted.get(key[0], 1),
                    placed=placed[number],
                    verdicts=verdicts,
                    domains=domains_of(valid, partial(_keeps_away, table)),
                    forbidden=frozenset(
                        node for node in verdicts if node != placed[number][0] and _keeps_away(table, placed[number][0], node)
                    ),
                    is_opened=any(known[number, node].is_opened for node in valid),
                    is_owner_sure=sure[number],
                )
            )
        return findings

    async def _checked(self, index: int, pairs: Sequence[tuple[Key, RecordBytes]]) -> list[Checked]:
        run, scene = self._calls.world.workers.run, self._scenes[index]
        found = await run("crypto", check_all, scene, pairs)
        epochs = [checked.epoch for checked in found if checked.epoch is not None]
        if epochs:
            newer = await newer_scene(self._calls, scene, max(epochs))
            if newer is not scene:
                self._scenes[index] = newer
                found = await run("crypto", check_all, newer, pairs)
        return found


def _grouped(nodes: Mapping[int, Sequence[NodeId]]) -> dict[NodeId, list[int]]:
    """Which of the records each node is asked for."""
    found: dict[NodeId, list[int]] = {}
    for number, wanted in nodes.items():
        for node in wanted:
            found.setdefault(node, []).append(number)
    return found


def _keeps_away(table: RoutingTable, owner: NodeId, other: NodeId) -> bool:
    known = table.by_id(owner)
    return known is not None and not known.may_be_held_by(other)
