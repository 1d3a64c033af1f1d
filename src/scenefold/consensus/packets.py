"""Messages as packets, and back (specs/25-consensus.md, Packets). Pure.

What comes in a packet is what somebody says: nothing of it is verified here, but that it is no more than a message can be.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from scenefold.base.ids import SceneId
from scenefold.base.limits import DECIDED_MAX, LOG_BYTES_MAX
from scenefold.consensus.certificates import Certificate
from scenefold.consensus.messages import Accepted, AskLog, Learn, Message, Propose, Rejected
from scenefold.wire import (
    AcceptValue,
    DecidedLog,
    DecidedValue,
    LogValue,
    Packet,
    ProposeValue,
    RejectValue,
    Release,
    RequestSceneLog,
    RespondSceneLog,
    Want,
)

_OVERHEAD_BYTES = 8_192
"""Of a value that is told: position, ballot, votes of 33 nodes."""
_RELEASE_BYTES = 128


def packet_of(message: Message) -> Packet:
    """The packet that says this. LocalFault comes from its encoding, if something in it is out of bounds."""
    match message:
        case AskLog(genesis, have):
            return RequestSceneLog(scene_of(genesis), genesis, have, nonce=0, want=Want.DECIDED)
        case Learn(genesis, position):
            return RespondSceneLog(None, DecidedLog(genesis, position, (decided_value(message),)))
        case Propose(genesis, proposal, route, facts, highest, value, takeover):
            return ProposeValue(genesis, proposal, route, facts, highest, value, takeover)
        case Accepted(genesis, proposal, digest, facts, highest):
            return AcceptValue(genesis, proposal, digest, facts, highest)
        case Rejected(genesis, proposal, digest, refusal, facts):
            return RejectValue(genesis, proposal, digest, refusal, facts)


def messages_of(packet: Packet) -> tuple[Message, ...]:
    """What a packet says to the protocol, in its order; nothing if it is about something else."""
    match packet:
        case RequestSceneLog(want=Want.DECIDED, genesis=genesis, have=have) if genesis:
            return (AskLog(genesis, have),)
        case RespondSceneLog(decided=DecidedLog(genesis, _, decided)):
            return tuple(Learn(genesis, it.position, it.value, Certificate(it.position, it.ballot, it.votes)) for it in decided)
        case ProposeValue(genesis, proposal, route, facts, highest, value, takeover):
            return (Propose(genesis, proposal, route, facts, highest, value, takeover),)
        case AcceptValue(genesis, proposal, digest, facts, highest):
            return (Accepted(genesis, proposal, digest, facts, highest),)
        case RejectValue(genesis, proposal, digest, refusal, facts):
            return (Rejected(genesis, proposal, digest, refusal, facts),)
        case _:
            return ()


def pages_of(learns: Sequence[Learn]) -> Iterator[Packet]:
    """Packets that tell these, which are of one log and follow each other."""
    while learns:
        page = decided_page(learns[0].genesis, learns[-1].position, map(decided_value, learns))
        learns = learns[len(page.decided) :]
        yield RespondSceneLog(None, page)


def decided_value(learn: Learn, releases: tuple[Release, ...] = ()) -> DecidedValue:
    """What is decided, as it is told; with releases of it that were seen."""
    return DecidedValue(learn.position, learn.value, learn.certificate.ballot, learn.certificate.votes, releases)


def decided_page(genesis: bytes, newest: int, decided: Iterable[DecidedValue]) -> DecidedLog:
    """The first of them, as many as fit, and one at least: who asked asks again for what lies behind. They come one after the other, and
    no more of them are taken than are told."""
    page: list[DecidedValue] = []
    size = 0
    for value in decided:
        size += _size_of(value)
        if page and size > LOG_BYTES_MAX:
            break
        page.append(value)
        if len(page) == DECIDED_MAX:
            break
    return DecidedLog(genesis, newest, tuple(page))


def scene_of(genesis: bytes) -> SceneId:
    """The id of a log, of a scene or of the cluster: the beginning of its genesis."""
    return SceneId(int.from_bytes(genesis[:4], "big"))


def _size_of(decided: DecidedValue) -> int:
    value: LogValue = decided.value
    return len(value.data) + len(value.body) + _OVERHEAD_BYTES + _RELEASE_BYTES * len(decided.releases)
