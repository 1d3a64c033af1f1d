"""If this fails, a log that does not hold together is believed, or one that is long, or claims much, holds up whoever reads it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest
from trio.testing import MockClock

from scenectl.program import main
from scenefold.base.errors import LocalFault, PeerFault, Refused
from scenefold.base.ids import NodeId, SpaceId, node_id_of
from scenefold.base.reasons import RejectReason
from scenefold.client.grants import grant_of
from scenefold.client.offers import proposal_of
from scenefold.client.scene import Scene
from scenefold.crypto import SigningKey
from scenefold.peer.scene_log.proposals import rejection
from scenefold.scene.log import SceneKeys, decided_by_votes, follow, seal_private, sign_record, signed_header, value_of
from scenefold.simulation.clients import secrets_of
from scenefold.wire import (
    AcceptSceneProposal,
    Ballot,
    LogRecord,
    Packet,
    RequestSceneLog,
    RespondSceneLog,
    Role,
    SceneLogPublic,
    SignedRecord,
    TranslateSpace,
    digest_of_header,
)
from scenefold.world.keyring import Keyring
from unit.client.fake_council import FIVE, FakeCouncil
from unit.client.test_participants import STEP, hall_of
from unit.scene.log.council import vote

A, B, C, D, E = FIVE
OTHER = SigningKey(bytes(31) + b"\7")
NONCE = bytes(12)
FUTURE = 2**63
LONG = 10_000


@dataclass
class Owner:
    """One who has all that an owner has, and proposes what nobody should: who decides cannot read it."""

    council: FakeCouncil
    scene: Scene

    async def record(self) -> LogRecord:
        """One that fits."""
        state = (await self.scene.access.read_log()).state
        return state.next_record(TranslateSpace(SpaceId(2), STEP), b"r" * 16, NodeId(1))

    async def decide(self, records: list[SignedRecord], **changes: Any) -> None:
        """These are the scene's log from now on."""
        header, keys = (await self.scene.access.read_log()).header, self.keys
        public: SceneLogPublic = replace(
            header, position=header.position + 1, request=b"r" * 16, previous=digest_of_header(header), **changes
        )
        private = seal_private(records, genesis=header.genesis, symmetric_key=keys.epochs[0], key_epoch=0, nonce=NONCE)
        answer = self.council.propose(A, proposal_of(signed_header(public, private, self.signer), private))
        assert isinstance(answer, AcceptSceneProposal), answer

    def let_be(self, records: list[SignedRecord], known: SceneLogPublic) -> None:
        """These are the log, whatever was decided on the way there."""
        position, keys = len(records), self.keys
        private = seal_private(records, genesis=known.genesis, symmetric_key=keys.epochs[0], key_epoch=0, nonce=NONCE)
        public = signed_header(replace(known, position=position, previous=bytes(32), request=b"r" * 16), private, self.signer)
        value, ballot = value_of(public, private, known), Ballot(1, NodeId(1))
        votes = [vote(entry, value, position, known.genesis, ballot) for entry in known.participants]
        self.council.tell(decided_by_votes(public, known, ballot, votes), private)

    @property
    def keys(self) -> SceneKeys:
        return self.scene.access.log_or_fault().keys

    @property
    def signer(self) -> SigningKey:
        assert self.keys.header_seed is not None
        return SigningKey.from_seed(self.keys.header_seed)


def unknown_kind(record: LogRecord) -> bytes:
    """The entry's number is one that no program knows yet."""
    entry = record.encode().rindex(b"\x93\x02")
    return record.encode()[: entry + 1] + b"\x63" + record.encode()[entry + 2 :]


Bend = Callable[[LogRecord, SigningKey], SignedRecord]
BENT: dict[str, tuple[Bend, str]] = {
    "a broken link": (lambda record, key: sign_record(replace(record, prev_hash=bytes(32)), key), "does not follow position 2"),
    "a position left out": (lambda record, key: sign_record(replace(record, position=4), key), "does not follow position 2"),
    "another's signature": (lambda record, _: sign_record(record, OTHER), "signature"),
    "no signature": (lambda record, _: SignedRecord(record.encode(), bytes(64)), "signature"),
    "a request twice": (sign_record, "in the log already"),
}


@pytest.mark.parametrize("what", BENT)
async def test_a_decided_log_that_does_not_hold_together_is_told_as_that(autojump_clock: MockClock, tmp_path: Path, what: str) -> None:
    council = FakeCouncil()
    scene, hall = await hall_of(council, tmp_path)
    owner = Owner(council, scene)
    log = (await scene.access.read_log()).log
    bend, why = BENT[what]
    record = await owner.record()
    if what == "a request twice":
        record = replace(record, request_id=log.records[1].decoded().request_id)
    await owner.decide([*log.records, bend(record, owner.signer)])
    for reader in (scene, await council.scenes(Keyring(tmp_path)).open("kitchen")):
        with pytest.raises(PeerFault, match=f"does not hold together.*{why}"):
            await reader.spaces()
    with pytest.raises(PeerFault, match="does not hold together"):
        await hall.translate(STEP)


async def test_who_meets_an_entry_that_it_does_not_know_hears_that_its_program_is_old(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    scene, hall = await hall_of(council, tmp_path)
    owner = Owner(council, scene)
    records = (await scene.access.read_log()).log.records
    record = unknown_kind(await owner.record())
    await owner.decide([*records, SignedRecord(record, owner.signer.sign(b"scenefold/log", record))])
    for reader in (scene, await council.scenes(Keyring(tmp_path)).open("kitchen")):
        with pytest.raises(PeerFault, match=r"entry of a kind that this program does not know \(99\), so a newer program wrote it") as told:
            await reader.spaces()
        assert told.value.remedy == "update this program" and "malformed" not in str(told.value)
    with pytest.raises(PeerFault, match="newer program"):
        await hall.translate(STEP)


async def test_a_header_that_names_others_than_its_log_is_told_as_that(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    scene, _ = await hall_of(council, tmp_path)
    owner = Owner(council, scene)
    log = (await scene.access.read_log()).log
    others = (*council.newest(scene.id).participants, council.entry(node_id_of(D)))
    await owner.decide([*log.records, sign_record(await owner.record(), owner.signer)], participants=others)
    with pytest.raises(PeerFault, match="its header name others who take part"):
        await scene.spaces()


async def test_a_log_of_ten_thousand_entries_is_read_told_and_goes_on(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    scene, hall = await hall_of(council, tmp_path)
    owner, read = Owner(council, scene), await scene.access.read_log()
    records, head = list(read.log.records), read.state.head
    for position in range(len(records) + 1, LONG + 1):
        record = LogRecord(position, head, position.to_bytes(16, "big"), NodeId(1), TranslateSpace(hall.id, STEP))
        records.append(sign_record(record, owner.signer))
        head = record.hash()
    began = time.process_time()
    owner.let_be(records, read.header)
    added = LONG - len(read.log.records)
    assert (await hall.info()).transform.offset[0] == added
    story = await scene.log()
    assert (story.position, len(story.entries) + story.before) == (LONG, LONG)
    moved = await hall.translate(STEP)
    assert (moved.transform.offset[0], council.newest(scene.id).position) == (added + 1.0, LONG + 1)
    assert time.process_time() - began < 60.0


async def test_who_was_revoked_proposes_nothing_any_more(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    scene, _ = await hall_of(council, tmp_path)
    secrets = secrets_of(OTHER)
    entry = grant_of("user:ada", Role.OWNER, secrets.signing.public, secrets.sealing.public)
    await scene.access.change_log(lambda _: entry)
    ada = await council.scenes(Keyring(tmp_path / "ada"), OTHER).open("kitchen")
    hall = await ada.space_named("hall")
    await hall.translate(STEP)
    before, keys = await ada.access.read_log(), ada.access.log_or_fault().keys
    await scene.revoke("user:ada")
    with pytest.raises(Refused) as refused:
        await hall.translate(STEP)
    assert refused.value.reason is RejectReason.KEY_REVOKED
    # By hand, from what she knew, and under the key that she had.
    after = council.newest(scene.id)
    record = before.state.next_record(TranslateSpace(hall.id, STEP), bytes(16), NodeId(1))
    made = follow(before.header, before.log, record, keys, OTHER, ada.access.calls.world.entropy.token).sealed()
    stale = council.propose(A, proposal_of(made.header, made.private))
    assert stale == rejection(RejectReason.POSITION_TAKEN, node_id_of(A))
    next_one = signed_header(
        replace(after, position=after.position + 1, request=bytes(16), previous=digest_of_header(after)), made.private, owner_key(keys)
    )
    refusal = council.propose(A, proposal_of(next_one, made.private))
    assert refusal == rejection(RejectReason.SIGNATURE_INVALID, node_id_of(A))
    assert council.newest(scene.id) == after


def owner_key(keys: SceneKeys) -> SigningKey:
    assert keys.header_seed is not None
    return SigningKey.from_seed(keys.header_seed)


async def test_a_position_from_the_future_counts_for_nothing(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    scene, hall = await hall_of(council, tmp_path)
    header, private = council.has[B, scene.id]
    council.has[B, scene.id] = replace(header, position=FUTURE), private
    await hall.translate(STEP)
    council.has[B, scene.id] = replace(header, position=FUTURE), private
    reader = await council.scenes(Keyring(tmp_path)).open("kitchen")
    assert reader.access.identity.position == 3
    assert (await (await reader.space_named("hall")).info()).transform.offset[0] == 1.0

    plain = council.request

    async def request(address: str, priority: object, packet: Packet, timeout: float) -> Packet:
        reply = await plain(address, priority, packet, timeout)  # type: ignore[arg-type]
        if isinstance(packet, RequestSceneLog) and isinstance(reply, RespondSceneLog) and reply.answer is not None:
            return replace(reply, answer=replace(reply.answer, position=FUTURE))
        return reply

    council.request = request  # type: ignore[method-assign]
    assert (await (await reader.space_named("hall")).info()).transform.offset[0] == 1.0, (
        "what a packet says beside the header counts for nothing"
    )
    assert (await reader.standing(bytes(16), FUTURE)).is_over is False


NAMES = {
    "64 KiB": "k" * 65_536,
    "a line": "kit\nchen",
    "a bell": "kit\achen",
    "an escape": "\x1b[2Jkitchen",
    "a null": "kit\0chen",
    "none": "",
}


@pytest.mark.parametrize("name", NAMES)
async def test_no_scene_has_such_a_name(autojump_clock: MockClock, tmp_path: Path, name: str) -> None:
    scenes = FakeCouncil().scenes(Keyring(tmp_path))
    for call in (scenes.create, scenes.open, scenes.open_or_create):
        with pytest.raises(LocalFault, match="cannot be the name of a scene") as told:
            await call(NAMES[name])
        assert len(str(told.value)) < 500


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("verb", [["create"], ["log"], ["participants"], ["add-participant", A], ["status", "0" * 32]])
def test_scenectl_refuses_such_a_name_as_wrong_usage(capsys: pytest.CaptureFixture[str], name: str, verb: list[str]) -> None:
    assert main(["scene", verb[0], NAMES[name], *verb[1:], "--profile", "studio"]) == 2
    told = capsys.readouterr()
    assert "cannot be the name of a scene" in told.err and len(told.err) < 1_000 and not told.out
    assert all(character.isprintable() or character == "\n" for character in told.err)
