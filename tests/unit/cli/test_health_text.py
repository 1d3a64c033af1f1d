"""If this fails, `cluster health` hides from people what is wrong, or what to do about it."""

from __future__ import annotations

import json
from typing import Any

from scenectl.health_text import health_text, proof_text, seen_text
from scenefold.base.ids import NodeId, SpaceId, node_id_of
from scenefold.base.location import FIRST, WHOLE_LINE
from scenefold.client.proof import Finding, Proof, Unlisted, Verdict
from unit.client.test_cluster_health import FEW, FILLING, LACKING, LOSS, copies, health, nodes
from unit.client.test_health import ADDRESSES, arc, missing, node


def test_a_healthy_cluster_is_said_to_be_and_nothing_else() -> None:
    text = health_text(health(*nodes()))
    assert (
        text.splitlines()[0] == "studio: healthy: 360 records, 300 of them in spaces with copies, all where they belong, as the nodes say"
    )
    assert len(text.splitlines()) == 2 + 1 + len(ADDRESSES)


def test_what_is_wrong_is_followed_by_what_to_do() -> None:
    text = health_text(health(*nodes(copies(**LACKING, **FILLING))))
    assert text.splitlines()[0].endswith("; healthy in about 3 s")
    assert "40 of 100 records lie on fewer nodes than they should, up to 1 copy fewer\n  -> wait" in text


def test_a_pause_is_told_also_of_a_healthy_cluster() -> None:
    text = health_text(health(*nodes(upkeep={"paused": ["repair"]})))
    assert "healthy" in text.splitlines()[0]
    assert text.endswith(f"{ADDRESSES[0]}: repair paused, by an administrator's order\n  -> scenectl node upkeep resume {ADDRESSES[0]}")


def test_all_that_is_paused_is_named() -> None:
    for paused, words in ((["repair", "balance"], "repair and balance"), (["repair", "scrub", "balance"], "repair, scrub and balance")):
        assert f"{ADDRESSES[0]}: {words} paused, by" in health_text(health(*nodes(upkeep={"paused": paused})))


def test_a_silent_node_has_its_line_and_the_time_is_not_known() -> None:
    first, second, _ = nodes(copies(**LACKING))
    text = health_text(health(first, second, missing(ADDRESSES[2], arc(0.5, 1))))
    assert "degraded" in text.splitlines()[0] and text.splitlines()[0].endswith("how long it takes is not known")
    assert any(line.startswith(ADDRESSES[2]) and "silent" in line for line in text.splitlines())
    assert f"{ADDRESSES[2]} does not answer" in text and "-> start it" in text


def test_what_is_owed_to_the_silent_stands_in_the_column_of_what_is_pending() -> None:
    owed = {"owed": {"records": 46, "records_to_silent": 46, "nodes": [{"address": ADDRESSES[1], "records": 46, "alive": False}]}}
    row = next(line for line in health_text(health(*nodes(copies(**owed)))).splitlines() if line.startswith(ADDRESSES[0]))
    assert row.split()[6] == "46"
    row = next(line for line in health_text(health(*nodes(strays=1_000, strays_more=True))).splitlines() if line.startswith(ADDRESSES[0]))
    assert "1000 or more" in row


def test_where_only_nodes_are_missing_the_first_line_says_so() -> None:
    text = health_text(health(node(ADDRESSES[0], arc(0, 1), copies=copies(**FEW))))
    few = "in spaces with 3 copies only 1 of them"
    assert text.splitlines()[0] == f"studio: degraded, {few}: 120 records, 100 of them in spaces with copies; nothing else is wrong"
    assert text.splitlines()[-1].startswith("  -> add 2 nodes")
    refusing = {"shortages": [{"copies": 3, "needed": 2, "possible": 1, "blacklist_of": ADDRESSES[0]}]}
    first = health_text(health(*nodes(copies(**refusing)))).splitlines()[0]
    assert first.endswith("; writes are refused where they need more"), "that is no small thing"
    assert first.startswith(f"studio: degraded, of what {ADDRESSES[0]} owns, in spaces with 3 copies only 1 of them: ")
    silent = health_text(health(node(ADDRESSES[0], arc(0, 0.5), copies=copies(**FEW)), missing(ADDRESSES[2], arc(0.5, 1))))
    assert "nothing else" not in silent.splitlines()[0]


def test_spaces_that_ask_for_different_numbers_of_copies_are_told_apart() -> None:
    row = {"records": 50, "under_copied": 0, "missing_max": 0, "forbidden": 0}
    told = [{**row, "copies": 2}, {**row, "copies": 5, "under_copied": 40, "missing_max": 2}]
    lines = health_text(health(*nodes(copies(by_copies=told)))).splitlines()
    begin = next(index for index, line in enumerate(lines) if "copies asked for" in line)
    assert [line.split() for line in lines[begin + 1 : begin + 3]] == [["2", "50", "0", "0"], ["5", "50", "40", "2"]]
    assert "copies asked for" not in health_text(health(*nodes(copies(by_copies=told[:1])))), "nothing to be told apart"


def test_the_first_line_goes_by_what_was_read() -> None:
    found = health(*nodes())
    assert not health_text(found).startswith("studio: degraded"), "else this test says nothing"
    first = health_text(found, Proof()).splitlines()[0]
    assert first.startswith("studio: degraded: ") and first.endswith("what was read says so, below"), "of an interrupted one, too"
    whole = Proof(ended=True)
    assert whole.is_sound and health_text(found, whole) == health_text(found)


def finding(*verdicts: Verdict, **changes: Any) -> Finding:
    nodes = [NodeId(node_id_of(address)) for address in (*ADDRESSES, "127.0.0.5")][: len(verdicts)]
    known: dict[str, Any] = {"scene": "kitchen", "key": (SpaceId(10), FIRST), "wanted": 3, "placed": tuple(nodes), "domains": 2}
    return Finding(**{**known, "verdicts": dict(zip(nodes, verdicts, strict=True)), **changes})


def test_a_proof_says_what_it_read_and_names_what_is_wrong_with_addresses() -> None:
    proof = Proof(("kitchen",), bytes=3 << 20, ended=True)
    for _ in range(5):
        proof.add(finding(Verdict.VALID, Verdict.VALID, Verdict.VALID))
    assert proof_text(proof).splitlines()[1:] == [
        "  5 with 3 valid of 3 copies, in 2 failure domains",
        "All copies of all records are valid, and where they belong.",
    ]
    proof.add(finding(Verdict.VALID, Verdict.CORRUPT, Verdict.SILENT))
    proof.unlisted.append(Unlisted("127.0.0.4", WHOLE_LINE, "it does not answer"))
    text = proof_text(proof)
    assert "Records short of copies: 1, with corrupt copies: 1." in text
    assert "127.0.0.2 valid, 127.0.0.3 corrupt, 127.0.0.4 silent" in text
    assert "which 127.0.0.4 owns: it does not answer" in text
    assert json.loads(json.dumps(proof.document()))["named"][0]["nodes"]["127.0.0.3"] == "corrupt"
    for _ in range(30):
        proof.add(finding(Verdict.SILENT, Verdict.SILENT, Verdict.SILENT))
    assert (len(proof.named), proof.lost) == (20, 30) and proof_text(proof).endswith("\nand more")


def test_copies_that_lie_elsewhere_are_not_hidden() -> None:
    proof = Proof(("kitchen",), ended=True)
    proof.add(finding(Verdict.VALID, Verdict.ELSEWHERE, Verdict.NOTHING, Verdict.ELSEWHERE))
    lines = proof_text(proof).splitlines()
    assert lines[1] == "  1 with 1 valid of 3 copies in place, in 2 failure domains; 2 more of each lie elsewhere"
    assert lines[2] == "Records short of copies: 1, with further copies elsewhere: 1."
    assert lines[3].startswith("Copies that lie elsewhere are brought home")
    assert "short: 1 of 3 valid in place, 2 more copies lie elsewhere on 127.0.0.3, 127.0.0.5 (" in lines[4]
    document = proof.document()
    assert (document["elsewhere"], document["copies"][0]["elsewhere"], document["lost"]) == (1, 2, 0)


def test_an_interrupted_proof_proves_nothing_of_the_rest() -> None:
    proof = Proof(("kitchen",))
    proof.add(finding(Verdict.VALID, Verdict.VALID, Verdict.VALID))
    assert not proof.is_sound and not proof.document()["complete"]
    assert "interrupted" in proof_text(proof) and "All copies" not in proof_text(proof)


def test_a_proof_does_not_say_that_all_is_well_where_something_may_be_lost() -> None:
    found = health(*nodes(copies(lost=[LOSS])))
    text = health_text(found)
    assert text.splitlines()[0] == "studio: degraded: 360 records, 300 of them in spaces with copies; others may be lost"
    assert "--acknowledge" in text.splitlines()[-1]
    assert seen_text(found.losses).endswith("acknowledged: what 127.0.0.2 noted, on 12.50% of the line") and seen_text([]) == ""
    whole = Proof(ended=True)
    assert proof_text(whole).endswith("All copies of all records are valid, and where they belong.")
    assert "Others may be lost" in proof_text(whole, found.losses).splitlines()[-1]
