"""A line of nodes that balance by the policy alone: no packets, but old news, settling times, and pieces in flight.

Each node holds runs of bytes from left to right, each with the time from which it may move again. In each second a node
looks at what it believes of the others and gives what the policy says, as far as its outermost runs have settled. News
of a node reach another one by chance, so that no two are equally old, and when its fill has changed; neighbours in a
handover hear of each other.
"""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

from scenefold.base.ids import NodeId
from scenefold.peer.balance.news import News
from scenefold.peer.balance.policy import Give, NodeFill, gives, imbalance
from scenefold.peer.line.ends import Side
from scenefold.peer.membership.status import is_news

SETTLING = 10
TOLD_S = 5


@dataclass
class Crowd:
    """Times are seconds; `news` is the chance that a node hears of another one within a second, as it was up to `age` ago.

    Besides, whose fill has changed tells everybody at once; `loss` is the chance that one of them does not hear it.
    """

    used: Sequence[int]
    capacity: Sequence[int]
    news: float = 1.0
    age: int = 0
    loss: float = 0.0
    seed: int = 0
    bytes_per_s: int = 1 << 60
    now: int = 0
    handovers: int = 0
    moved: int = 0
    crossed: list[int] = field(default_factory=list)
    """Bytes that crossed each bound, in either direction."""

    def __post_init__(self) -> None:
        self._dice = random.Random(self.seed)
        count = len(self.used)
        self._runs: list[deque[tuple[int, int]]] = [deque([(used, 0)] if used else []) for used in self.used]
        self._past = deque([self.truth()], maxlen=self.age + 1)
        self._news = [News(NodeId(me), self.age) for me in range(count)]
        for news in self._news:
            for node, fill in enumerate(self.truth()):
                news.hear(NodeId(node), 0, fill.used, fill.capacity, 0.0)
        self._said = list(self.used)
        self._busy_until = [0] * (count + 1)
        self.crossed = [0] * max(0, count - 1)

    def truth(self) -> list[NodeFill]:
        return [NodeFill(sum(size for size, _ in runs), capacity) for runs, capacity in zip(self._runs, self.capacity, strict=True)]

    def imbalance(self) -> float:
        return imbalance(self.truth())

    def write(self, node: int, size: int) -> None:
        """Somebody stores new records there."""
        self._runs[node].append((size, 0))

    def step(self) -> None:
        """One second passes."""
        self.now += 1
        self._past.append(self.truth())
        nodes = [NodeId(node) for node in range(len(self.used))]
        for me, news in enumerate(self._news):
            for node in nodes:
                if node != me and self._dice.random() < self.news:
                    back = self._dice.randrange(len(self._past))
                    fill = self._past[-1 - back][node]
                    news.hear(node, self.now - back, fill.used, fill.capacity, self.now)
        self._tell()
        order = list(range(len(nodes)))
        self._dice.shuffle(order)
        for me in order:
            news = self._news[me]
            news.measure(sum(size for size, _ in self._runs[me]), self.capacity[me], self.now)
            for give in gives([news.fill(node, takes=True) for node in nodes], me, news.changes(nodes, self.now - TOLD_S)):
                self._hand_over(me, give)

    def _tell(self) -> None:
        for node, fill in enumerate(self.truth()):
            if not is_news(self._said[node], fill.used):
                continue
            self._said[node] = fill.used
            for me, news in enumerate(self._news):
                if me != node and self._dice.random() >= self.loss:
                    news.hear(NodeId(node), self.now, fill.used, fill.capacity, self.now)

    def _hand_over(self, me: int, give: Give) -> None:
        bound = me if give.side is Side.RIGHT else me - 1
        if self._busy_until[bound] > self.now:
            return
        other = me + 1 if give.side is Side.RIGHT else me - 1
        source, target = self._runs[me], self._runs[other]
        left = give.bytes
        while left and source:
            size, movable_at = source[-1] if give.side is Side.RIGHT else source[0]
            if movable_at > self.now:
                break
            part = min(size, left)
            (source.pop if give.side is Side.RIGHT else source.popleft)()
            if size > part:
                (source.append if give.side is Side.RIGHT else source.appendleft)((size - part, movable_at))
            received = (part, self.now + SETTLING)
            (target.appendleft if give.side is Side.RIGHT else target.append)(received)
            left -= part
        if left == give.bytes:
            return
        self.handovers += 1
        self.moved += give.bytes - left
        self.crossed[bound] += give.bytes - left
        self._busy_until[bound] = self.now + 1 + (give.bytes - left) // self.bytes_per_s
        for news in (self._news[me], self._news[other]):
            news.book(NodeId(me), NodeId(other), give.bytes - left)


def needed(used: Sequence[int], capacity: Sequence[int]) -> list[float]:
    """What must cross each bound at least, until all are equally full."""
    total, room = sum(used), sum(capacity)
    flow, flows = 0.0, []
    for held, size in zip(used[:-1], capacity[:-1], strict=True):
        flow += held - total * size / room
        flows.append(abs(flow))
    return flows
