"""One place of the line, real values of custody and configurations, and all that may happen to them: a model to search for counterexamples.

Every operation is one atomic step of one node; what one node says to another lies about until it is delivered, in any order, again, or never.
Nodes lose their memory, are removed (and go on until their lease is over), come back with their disk or without it. What a
node keeps durably is read back from its notes. `Broken` is raised where an invariant of specs/20-copies.md does not hold.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import combinations
from random import Random

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId
from scenefold.base.location import FIRST
from scenefold.peer.copies.configurations import Configurations, Word
from scenefold.peer.copies.custody import Behind, Custody
from scenefold.peer.copies.entries import Entry
from scenefold.peer.copies.segment import Segment
from scenefold.wire import Member
from unit.peer.copies.copies_nodes import LAYOUT, NOTHING, PLACE, Broken, Message, Node, Reader, Recovery, Rules, Version

TERM = 1 << 32
MESSAGES_MAX = 40


class Model:
    """Operations answer True if they did something; whoever chooses them need not know what is possible."""

    def __init__(self, random: Random, rules: Rules, nodes: int, copies: int, needed: int) -> None:
        self.random, self.rules, self.copies, self.needed = random, rules, copies, needed
        self.nodes: dict[Member, Node] = {}
        self.log: list[tuple[str, Member]] = []
        self.messages: list[Message] = []
        self.readers: list[Reader] = []
        self.passing: tuple[Member, Member, int, tuple[Segment, ...]] | None = None
        self.acknowledged: set[Version] = {NOTHING}
        self.promised = NOTHING
        """The newest that was acknowledged and that a registered node still has."""
        self.told: dict[int, set[Version]] = {}
        """What readers took for read, acknowledged or not, by the number of the configuration: by that nobody may read anything older later."""
        self.deaf: set[Member] = set()
        """Whom no node reaches, though readers do."""
        self.counts: dict[str, int] = {}
        for number in range(1, nodes + 1):
            self._register(NodeId(number), NOTHING)
        first = self.registered()[0]
        first.owns = True

    # ------------------------------------------------------------------------------------------------------ the log

    def registered(self, position: int | None = None) -> list[Node]:
        found: dict[NodeId, Member] = {}
        for kind, member in self.log[:position]:
            if kind == "register":
                found[member.node] = member
            elif found.get(member.node) == member:
                del found[member.node]
        return [self.nodes[member] for member in found.values()]

    def removed(self, position: int | None = None) -> set[Member]:
        return {member for kind, member in self.log[:position] if kind == "remove"}

    def _register(self, node: NodeId, version: Version) -> None:
        member = Member(node, bytes([sum(known.node == node for known in self.nodes)]) * 16)
        self.log.append(("register", member))
        self.nodes[member] = Node(member, Configurations(member), version=version, known=len(self.log))

    def remove(self, node: Node) -> bool:
        if node not in self.registered() or len(self.registered()) < 3:
            return False
        self.log.append(("remove", node.member))
        self._rely()
        return True

    def lose_owner(self) -> bool:
        """The owner is removed, and so may be others at once; everybody learns it, and the leases end."""
        owner = next((node for node in self.registered() if node.owns), None)
        if owner is None or not self.remove(owner):
            return False
        if self.random.random() < 0.4:
            self.remove(self.random.choice(self.registered()))
        for node in self.nodes.values():
            node.known = len(self.log) if self.random.random() < 0.8 else node.known
            node.leased = node.leased and (node.member not in self.removed() or (node is not owner and self.random.random() < 0.5))
        return True

    def come_back(self, node: Node, *, with_disk: bool) -> bool:
        if node.member not in self.removed() or any(other.member.node == node.member.node for other in self.registered()):
            return False
        self._register(node.member.node, node.version if with_disk else NOTHING)
        return True

    def end_lease(self, node: Node) -> bool:
        if node.member not in self.removed() or not node.leased:
            return False
        node.leased = False
        return True

    def learn(self, node: Node) -> bool:
        if node.known == len(self.log):
            return False
        node.known += 1
        return True

    def learn_waited(self, node: Node) -> bool:
        """An owner knows of a removal, and T_wait has passed."""
        before = node.configurations
        for member in self.removed(node.known):
            if not self.nodes[member].leased:
                node.configurations = node.configurations.remove(member)
        return node.configurations is not before

    def _rely(self) -> None:
        reachable = max(node.version for node in self.registered())
        # What was lost with all that had it stays lost for readers, though some may come back with it.
        self.acknowledged = {version for version in self.acknowledged if version <= reachable}
        self.promised = max(self.acknowledged)
        self.told = {number: {version for version in found if version <= reachable} for number, found in self.told.items()}
        for reader in self.readers:
            reader.acknowledged = min(reader.acknowledged, self.promised)
            reader.told = {number: min(version, self._told(number)) for number, version in reader.told.items()}

    def _told(self, number: int) -> Version:
        return max(self.told.get(number, ()), default=NOTHING)

    # ------------------------------------------------------------------------------------------------------ the owner

    def _speaks(self, node: Node) -> bool:
        return node.owns and node.leased and node.recovery is None

    def write(self, node: Node) -> bool:
        if not self._speaks(node):
            return False
        node.take((node.version[0] + 1, self.random.randrange(2)), frozenset(node.segment.holders(node.member)))
        return True

    def send(self, node: Node) -> bool:
        """The newest version, to all that may not have it."""
        if not node.owns or node.recovery is not None or node.version == NOTHING:
            return False
        for holder in node.segment.holders(node.member):
            if holder not in node.holders_of_it():
                self._say(holder, lambda target, version=node.version: self._store(target, node, version))  # type: ignore[misc]
        return True

    def _store(self, target: Node, owner: Node, version: Version) -> None:
        if not target.custody.takes_from(owner.member, LAYOUT, FIRST):
            return
        target.version = max(target.version, version)

        def stored(owner: Node) -> None:
            if owner.version == version and owner.owns:
                owner.have.add(target.member)
                owner.debtors -= {target.member}

        self._say(owner.member, stored)

    def settle(self, node: Node) -> bool:
        """Acknowledge what is there, or answer a reader with it."""
        if not self._speaks(node):
            return False
        if not node.settled:
            node.settled = node.segment.is_settled(node.holders_of_it(), self.needed, node.member)
            if not node.settled:
                return False
            self._count("acknowledged")
        # Who asks again for a write that was in doubt is told that it is there.
        self.acknowledged.add(node.version)
        self._rely()
        if node.version < self.promised:
            raise Broken(f"the owner answers {node.version}, and {self.promised} was acknowledged")
        for number in self.told:
            if node.version < self._told(number):
                raise Broken(f"the owner answers {node.version}, and {self._told(number)} was read under {number}")
        return True

    def place(self, node: Node) -> bool:
        if not node.owns or node.recovery is not None:
            return False
        others = [other.member for other in self.registered(node.known) if other is not node]
        holders = tuple(self.random.sample(others, min(self.copies - 1, len(others))))
        before = node.configurations
        node.configurations = before.place(LAYOUT, [(PLACE, holders)], self.needed)
        return before is not node.configurations

    def say(self, node: Node) -> bool:
        words = node.configurations.untold() if node.owns and node.recovery is None else []
        for word in words:
            self._say(word.holder, lambda target, word=word: self._hear(target, node, word))  # type: ignore[misc]
        return bool(words)

    def _hear(self, target: Node, owner: Node, word: Word) -> None:
        if target.owns or owner.member in self.removed(target.known):
            return
        try:
            custody = target.custody.set(owner.member, word.number, word.scope, word.entries)
        except Behind as behind:
            highest = behind.highest
            self._say(owner.member, lambda owner: self._renumber(owner, word, highest))
            return
        target.custody = custody if self.rules.floors else Custody(custody.entries)
        self._say(owner.member, lambda owner: self._confirm(owner, word))

    def _renumber(self, owner: Node, word: Word, highest: int) -> None:
        if owner.owns:
            self._count("renumbered")
            owner.configurations = owner.configurations.met(word, highest)

    def _confirm(self, owner: Node, word: Word) -> None:
        if owner.owns and owner.recovery is None:
            owner.configurations = owner.configurations.confirm(word)

    def compare(self, node: Node) -> bool:
        """A holder with its owner: what it lacks it fetches, unless that is owed to it; what the owner lacks it gets first."""
        entry = node.entry
        owner = None if entry is None else self.nodes[entry.owner]
        if entry is None or owner is None or not owner.owns or owner.recovery is not None or entry.fenced or node.member in self.deaf:
            return False
        if node.version > owner.version:
            owner.take(node.version, frozenset(owner.segment.holders(owner.member)))
        if node.member not in owner.debtors or self.random.random() < 0.5:
            node.version = max(node.version, owner.version)

        def compared(owner: Node) -> None:
            if owner.owns and owner.recovery is None:
                owner.configurations = owner.configurations.compare(node.member, entry)

        self._say(owner.member, compared)
        return True

    def activate(self, node: Node) -> bool:
        before = node.configurations
        if not node.owns or node.recovery is not None or node.segment.change is None:
            return False
        if not self.rules.compared:
            segment = replace(node.segment, sound=node.segment.sound | set(node.segment.change.holders))
            node.configurations = replace(before, segments=(segment,))
        node.configurations = node.configurations.activate(lambda _: [node.debtors] if self.rules.debts else [])
        done = node.configurations.number != before.number
        if not done:
            node.configurations = before
        self.counts["activated"] = self.counts.get("activated", 0) + done
        return done

    # --------------------------------------------------------------------------------------------------- ownership

    def give(self, node: Node, receiver: Node) -> bool:
        if not self._speaks(node) or receiver is node or receiver not in self.registered(node.known) or receiver not in self.registered():
            return False
        if self.rules.settled_when_given and not (node.settled or node.version == NOTHING):
            return False
        node.configurations, number, segments = node.configurations.give(PLACE)
        node.custody = node.custody.promise(PLACE, number)
        node.owns = False
        receiver.version = max(receiver.version, node.version)
        self.passing = node.member, receiver.member, number, segments
        return True

    def claim(self) -> bool:
        if self.passing is None:
            return False
        _, receiver, number, segments = self.passing
        node = self.nodes[receiver]
        if not node.leased:
            return False
        node.custody = node.custody.claim(PLACE)
        node.configurations = node.configurations.take(number, segments)
        node.owns, node.debtors, node.have, node.settled = True, frozenset(), set(), True
        self.passing = None
        self._count("claimed")
        return True

    def adopt(self, node: Node) -> bool:
        """After the owner, or who was on the way to become it, is removed, and its lease is over."""
        if (
            node not in self.registered()
            or not node.leased
            or any(other.owns and (other.leased or other in self.registered()) for other in self.nodes.values())
        ):
            return False
        if self.passing is not None:
            giver, receiver = self.nodes[self.passing[0]], self.nodes[self.passing[1]]
            if giver in self.registered() and giver is not node:
                return False
            if receiver in self.registered() or receiver.leased:
                return False
            self.passing = None
        if self.removed() - self.removed(node.known):
            return False
        for other in self.nodes.values():
            other.owns, other.formerly = False, None
        node.owns, node.settled = True, False
        node.configurations = Configurations(node.member, node.configurations.number)
        node.formerly = node.custody.answers(LAYOUT, FIRST)
        node.custody = node.custody.claim(PLACE)
        node.recovery = Recovery(node.known * TERM, [other.member for other in self.registered(node.known)])
        return True

    def ask(self, node: Node) -> bool:
        """One node more says what it has of a gap, once its log is as new as the asker's."""
        recovery = node.recovery
        rest = [] if recovery is None else [member for member in recovery.asked if member not in recovery.entries]
        if recovery is None or not node.owns or not rest:
            return False
        other = self.nodes[self.random.choice(rest)]
        if other not in self.registered():
            return False
        other.known = max(other.known, node.known)
        if self.rules.promises and other is not node:
            try:
                other.custody = other.custody.promise(PLACE, recovery.number)
            except Refused:
                raise Broken("a promise was broken off") from None
        recovery.entries[other.member] = other.custody.within(PLACE)
        if other.version > node.version:
            node.version = other.version
        return True

    def recover(self, node: Node) -> bool:
        recovery = node.recovery
        if recovery is None or not node.owns:
            return False
        gone = self.removed(node.known)
        for member in recovery.asked:
            if member not in recovery.entries and member not in gone:
                return False
        if self.rules.leases_of_unheard and any(self.nodes[member].leased for member in gone):
            return False
        node.configurations = node.configurations.adopt(PLACE, recovery.entries, recovery.number)
        node.take(node.version, frozenset())
        node.recovery = node.formerly = None
        self._count("recovered")
        return True

    # -------------------------------------------------------------------------------------------------------- strays

    def offer_stray(self, node: Node, owner: Node) -> bool:
        """What lies here without right may go, if the owner says that enough others have it."""
        if node.owns or node.entry is not None or node.version == NOTHING or not self._speaks(owner) or node not in self.registered():
            return False
        if self._is_passing(node):
            return False
        if node.version > owner.version:
            owner.take(node.version, frozenset(owner.segment.holders(owner.member)))
            return True
        holders = owner.holders_of_it() & {owner.member, *owner.segment.holders(owner.member)} - {node.member}
        if not owner.settled or len(holders) < self.needed:
            return False
        version = node.version

        def may_go(node: Node) -> None:
            if not node.owns and node.entry is None and node.version == version and not self._is_passing(node):
                node.version = NOTHING
                self._count("deleted")

        self._say(node.member, may_go)
        return True

    def _is_passing(self, node: Node) -> bool:
        return self.passing is not None and node.member in self.passing[:2]

    # ------------------------------------------------------------------------------------------------------- readers

    def begin_reading(self) -> bool:
        self.readers.append(Reader(self.promised, {number: self._told(number) for number in self.told}))
        del self.readers[:-3]
        return True

    def read(self, reader: Reader, node: Node) -> bool:
        entry = node.formerly if node.owns else node.custody.answers(LAYOUT, FIRST)
        if not node.leased or entry is None:
            return False
        reader.answers[node.member] = entry, node.version
        self._conclude(reader, entry)
        return True

    def heal(self, reader: Reader, node: Node) -> bool:
        """The reader gives the newest it was told to one that has less."""
        mine = reader.answers.get(node.member)
        if mine is None or node.entry is None or node.entry != mine[0] or node.entry.fenced or not node.leased:
            return False
        newest = max(version for entry, version in reader.answers.values() if entry.says(mine[0]))
        node.version = max(node.version, newest)
        reader.answers[node.member] = node.entry, node.version
        self._conclude(reader, node.entry)
        return True

    def _conclude(self, reader: Reader, entry: Entry) -> None:
        """Whichever of those that have answered are heard: the newest that enough of them have must do."""
        holders = {found.node for found in entry.members[1:]}
        said = {
            member.node: version
            for member, (other, version) in reader.answers.items()
            if (other.number, other.members, other.needed) == (entry.number, entry.members, entry.needed) and member.node in holders
        }
        having = max(1, entry.needed - 1)
        for some in combinations(sorted(said), max(1, entry.quorum, having)):
            newest = max(said[node] for node in some)
            if sum(said[node] == newest for node in some) >= having:
                self._count("read")
                before = max(reader.acknowledged, reader.told.get(entry.number, NOTHING))
                if newest < before:
                    raise Broken(f"{some} say {newest} under {entry.number}, and {before} was acknowledged or read by that before")
                disks = sum(node.version >= newest for node in self.nodes.values())
                if newest != NOTHING and disks < entry.needed:
                    raise Broken(f"{newest} is read under {entry.number} and lies on {disks} disks")
                self.told.setdefault(entry.number, set()).add(newest)

    # --------------------------------------------------------------------------------------------------- the weather

    def deliver(self, index: int, *, keep: bool) -> bool:
        if not self.messages:
            return False
        index %= len(self.messages)
        message = self.messages[index]
        if message.target in self.deaf:
            return False
        if not keep:
            del self.messages[index]
        target = self.nodes[message.target]
        if not self.rules.incarnations:
            target = next((node for node in self.registered() if node.member.node == target.member.node), target)
        message.deliver(target)
        return True

    def crash(self, node: Node) -> bool:
        node.have, node.settled, node.formerly = set(), False, None
        return True

    def _say(self, target: Member, deliver: Callable[[Node], None]) -> None:
        self.messages.append(Message(target, deliver))
        if len(self.messages) > MESSAGES_MAX:
            del self.messages[self.random.randrange(len(self.messages))]

    def _count(self, what: str) -> None:
        self.counts[what] = self.counts.get(what, 0) + 1

    def check(self) -> None:
        """C2: nothing but the loss of nodes takes an acknowledged version from a disk that it needs."""
        disks = sum(node.version >= self.promised for node in self.nodes.values())
        if self.promised != NOTHING and disks < self.needed:
            raise Broken(f"{self.promised} lies on {disks} disks")
        owners = [node for node in self.nodes.values() if node.owns and node.leased]
        if len(owners) > 1:
            raise Broken("two owners")
