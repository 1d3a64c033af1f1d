"""The end of each run of the model of the line (line_model): no more faults, and everything must come to rest."""

from __future__ import annotations

from itertools import pairwise

from scenefold.base.location import FIRST, LAST
from scenefold.peer.line.ends import Side
from scenefold.peer.line.holding import Step
from unit.peer.line.line_model import Model
from unit.peer.line.line_nodes import CELLS, Node, cells_of


def calm(model: Model, rounds: int = 60) -> None:
    """No more faults: everybody learns, is leased, goes on. The line must be tiled and quiet in bounded time."""
    model.messages.clear()
    model.end_leases()
    for _ in range(rounds):
        for node in model.registered():
            model.learn(node, model.head.position)
            model.grant(node)
            for side in Side:
                _go_on(model, node, side)
            for which in range(len(Side)):
                node.search = None
                for _ in range(2 * len(model.head.order) + 2):
                    model.seek(node, which)
                    _deliver_all(model)
        if _is_quiet(model):
            break
    model.check()
    arcs = [node.holding.arc for node in model.registered() if node.holding.arc is not None]
    assert arcs, "nobody owns anything"
    assert arcs[0].first == FIRST, "the line has no beginning"
    assert arcs[-1].last == LAST, "the line has no end"
    assert all(left.last.next() == right.first for left, right in pairwise(arcs)), "the line has a gap"
    assert _is_quiet(model), "a handover never ends"


def _go_on(model: Model, node: Node, side: Side) -> None:
    handover = node.holding.on(side)
    if handover is None:
        return
    if model.take_back(node, side):
        return
    model.prod(node, side)
    _deliver_all(model)
    if handover.step is Step.OFFERED:
        peer = model.nodes[handover.peer].holding.find(handover.id)
        if peer is None:
            model.withdraw(node, side)
        else:
            for cell in cells_of(handover.piece):
                model.copy(node, side, cell)
                _deliver_all(model)
            node.frozen.add(handover.id)
            model.release(node, side)
    elif handover.step is Step.GIVEN:
        while model.delete(node, side):
            pass
    _deliver_all(model)


def _deliver_all(model: Model) -> None:
    while model.messages:
        model.deliver(0, keep=False)


def _is_quiet(model: Model) -> bool:
    nodes = model.registered()
    tiled = sum(len(cells_of(node.holding.arc)) for node in nodes) == CELLS
    return tiled and not any(node.holding.handovers for node in nodes)
