"""A public key by its id, from whoever has it: packets 3 and 4 (thesis C.2).

The id is the beginning of the key's hash, so no node can tell any key that it likes. But it has 32 bits, and whoever tries four
thousand million keys finds one with a given id: who somebody is, and who may write, say cards and verified scene headers alone.
"""

from __future__ import annotations

from collections.abc import Sequence

from scenefold.base.errors import DamagedData, PeerFault, Refused, ScenefoldError, Unreachable
from scenefold.base.ids import KeyId
from scenefold.client.calls import Calls, no_answer
from scenefold.crypto import SUITES, PublicKey
from scenefold.wire import PublicKeyInfo, RequestPublicKey, RespondPublicKey
from scenefold.world import Priority

KEY_ASKED_MAX = 16
"""Nodes that are asked for a key until one knows it: what a scene's header or the log says comes to all of them in time."""


async def find_public_key(calls: Calls, addresses: Sequence[str], wanted: KeyId) -> PublicKey | None:
    """The key with this id, from the first of these nodes that knows it; None if none does. Unreachable if none answers."""
    is_unknown = False
    problem: ScenefoldError | None = None
    for address in addresses[:KEY_ASKED_MAX]:
        try:
            reply = await calls.ask(address, RequestPublicKey(key=wanted), RespondPublicKey, priority=Priority.HIGH)
            if reply.answer is not None:
                return believed(reply.answer, wanted, address)
            is_unknown = True
        except (Unreachable, Refused, PeerFault) as error:
            problem = error
    if is_unknown:
        return None
    raise problem if isinstance(problem, PeerFault) else no_answer(addresses, problem)


def believed(info: PublicKeyInfo, wanted: KeyId, address: str) -> PublicKey:
    """The key that a node has told; PeerFault if it is not the wanted one, or none."""
    try:
        key = PublicKey(info.raw, info.suite)
    except DamagedData as problem:
        raise PeerFault(f"a node told a key that is none: {problem.what}", where=address) from problem
    if (key.key_id, info.key, info.exponent) != (wanted, wanted, SUITES[key.suite].exponent):
        raise PeerFault(f"a node was asked for key {wanted:08x} and told another one", where=address)
    return key
