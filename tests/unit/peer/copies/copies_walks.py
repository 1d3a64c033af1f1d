"""Random walks through the model of copies, weighted so that configurations change and places pass between the faults."""

from __future__ import annotations

from random import Random

from unit.peer.copies.copies_model import Model
from unit.peer.copies.copies_nodes import Node, Rules

_TABLE = {
    "deliver": 60, "newest": 40, "write": 12, "send": 24, "settle": 24, "place": 5, "say": 24, "compare": 30, "activate": 24, "give": 2,
    "claim": 6, "adopt": 8, "ask": 30, "recover": 16, "stray": 8, "begin": 8, "read": 60, "heal": 8, "crash": 2, "remove": 1, "back": 2,
    "end lease": 5, "learn": 12, "waited": 12, "lose owner": 1, "change": 6, "tell": 8, "read all": 24, "deafen": 5,
}  # fmt: skip
OPERATIONS, WEIGHTS = list(_TABLE), list(_TABLE.values())


def step(model: Model, operation: str) -> bool:
    random = model.random
    everybody = list(model.nodes.values())
    here = model.registered()
    node = random.choice(everybody if random.random() < 0.3 else here)
    owner = next((found for found in here if found.owns), node)
    acting = owner if random.random() < 0.8 else node
    reader = random.choice(model.readers) if model.readers else None
    match operation:
        case "deliver":
            return model.deliver(random.randrange(256), keep=random.random() < 0.2)
        case "newest":
            return model.deliver(-1, keep=random.random() < 0.1)
        case "give":
            return model.give(acting, node)
        case "lose owner":
            return model.lose_owner()
        case "deafen":
            model.deaf = {random.choice(here).member} if random.random() < 0.7 else set()
            return True
        case "read all":
            model.begin_reading()
            return sum(model.read(model.readers[-1], found) for found in everybody if random.random() < 0.8) > 0
        case "change":
            return change(model, owner)
        case "tell":
            return tell(model, owner)
        case "claim":
            return model.claim()
        case "stray":
            return model.offer_stray(node, owner)
        case "begin":
            return model.begin_reading()
        case "read" | "heal":
            return reader is not None and getattr(model, operation)(reader, node)
        case "back":
            return model.come_back(node, with_disk=random.random() < 0.5)
        case "end lease":
            return model.end_lease(node)
        case "waited":
            return model.learn_waited(acting)
        case "compare" | "adopt" | "crash" | "remove" | "learn":
            return bool(getattr(model, operation)(node))
        case _:
            return bool(getattr(model, operation)(acting))


def tell(model: Model, owner: Node) -> bool:
    """What the owner has to say reaches most, and most answer."""
    said = model.say(owner) | model.send(owner)
    for _ in range(2):
        for index in reversed(range(len(model.messages))):
            if model.random.random() < 0.7:
                model.deliver(index, keep=model.random.random() < 0.1)
    return said


def change(model: Model, owner: Node) -> bool:
    """A change of the configuration, at once up to some step."""
    for _ in range(model.random.randrange(1, 3)):
        model.place(owner)
        tell(model, owner)
        for node in model.registered():
            if model.random.random() < 0.8:
                model.compare(node)
        tell(model, owner)
    return model.activate(owner)


def walk(seed: int, rules: Rules, steps: int = 400) -> Model:
    """Each walk has its own weather: some operations are rare or never happen, some come again and again."""
    random = Random(seed)
    copies = random.choice((2, 3, 3, 4))
    model = Model(random, rules, nodes=random.randrange(copies, 6), copies=copies, needed=random.randrange(1, copies + 1))
    weights = [weight * random.choice((0.1, 0.5, 1, 1, 2, 4)) for weight in WEIGHTS]
    for operation in random.choices(OPERATIONS, weights, k=steps):
        step(model, operation)
        model.check()
    return model
