"""Which models are explored, how far, and what each of their mutants must lose: the table of tools/check_models.py.

A run is a model of specs/models with definitions for its preprocessor. A mutant leaves out one rule, and an assertion MUST
fail then; of all other runs none may. Quick ones are those of continuous integration, 180 s of the processor in all at most.
"""

from __future__ import annotations

from dataclasses import dataclass

MEMBERS = "-DN=4 -DB=2 -DPOSITIONS=2 -DMEMBERS"


@dataclass(frozen=True)
class Run:
    """One exploration. `depth_max` bounds the search stack, which costs 28 bytes a step."""

    model: str
    flags: str = ""
    shows: str = ""
    quick: bool = True
    depth_max: int = 20_000

    @property
    def is_mutant(self) -> bool:
        """Whether a rule is left out, so that something must go wrong."""
        return "-DMUT_" in self.flags

    @property
    def name(self) -> str:
        """The run as one would type it."""
        return f"{self.model} {self.flags}".strip()


CORE = (
    Run("consensus", "-DB=3", "3 nodes, 3 ballots of 2 makers"),
    Run("consensus", "-DB=3 -DMAKERS=3", "3 nodes, 3 ballots of 3 makers"),
    Run("consensus", "-DB=4", "3 nodes, 4 ballots"),
    Run("consensus", "-DN=4 -DB=2", "4 nodes"),
    Run("consensus", "-DN=5 -DB=2", "5 nodes"),
    Run("consensus", "-DN=3 -DB=2 -DPOSITIONS=2 -DMEMBERS -DVALUES_FIRST=2", "a participant goes, or not; 2 positions"),
    Run("consensus", MEMBERS, "one goes, one comes, or neither; 2 positions", quick=False),
    Run("consensus", "-DB=3 -DHASTE", "the first ballot without promises: 3 nodes, 3 ballots"),
    Run("consensus", "-DB=4 -DMAKERS=3 -DHASTE", "likewise, 4 ballots of 3 makers"),
    Run("consensus", "-DN=5 -DB=2 -DHASTE", "likewise, 5 nodes"),
    Run("consensus", "-DN=3 -DB=2 -DPOSITIONS=2 -DMEMBERS -DVALUES_FIRST=2 -DHASTE", "likewise, a participant goes, or not; 2 positions"),
    Run("consensus", "-DB=3 -DHASTE -DMUT_FIRST -DONLY_AGREEMENT", "two ballots without promises"),
    Run("consensus", "-DB=3 -DHASTE -DMUT_VOTE -DONLY_AGREEMENT", "the first ballot without promises, and votes are not durable"),
    Run("consensus", "-DB=3 -DMUT_QUORUM -DONLY_AGREEMENT", "a quorum too small"),
    Run("consensus", "-DN=4 -DB=2 -DMUT_QUORUM -DONLY_AGREEMENT", "half of four is a quorum"),
    Run("consensus", "-DB=3 -DMUT_VOTE -DONLY_AGREEMENT", "votes are not durable"),
    Run("consensus", "-DB=3 -DMUT_PROMISE -DONLY_AGREEMENT", "promises are not durable"),
    Run("consensus", "-DB=3 -DMUT_BLIND -DONLY_AGREEMENT", "what promises name is ignored"),
    Run("consensus", "-DB=4 -DMUT_MIXED -DONLY_AGREEMENT", "votes of several ballots count together"),
    Run(
        "consensus",
        "-DB=2 -DPOSITIONS=2 -DMEMBERS -DVALUES_FIRST=2 -DMUT_TENTATIVE -DONLY_AGREEMENT",
        "participants by what was only accepted",
    ),
    Run("consensus", f"{MEMBERS} -DMUT_WIPED -DONLY_AGREEMENT", "a wiped node votes under its old name"),
)

CHAIN = (
    Run("chain", "", "3 nodes, both ends ask at once"),
    Run("chain", "-DLOSSES=2 -DCRASHES=1 -DEARLY=1", "3 nodes, faults"),
    Run("chain", "-DLOSSES=3 -DCRASHES=1 -DEARLY=1", "3 nodes, more faults", quick=False),
    Run("chain", "-DDEATHS=1 -DLOSSES=2 -DEARLY=1", "3 nodes, one dies for good"),
    Run("chain", "-DN=4 -DLOSSES=2 -DCRASHES=1", "4 nodes"),
    Run("chain", "-DN=5 -DLOSSES=1 -DDEATHS=1", "5 nodes"),
    Run("chain", "-DN=5 -DLOSSES=2 -DDEATHS=2", "5 nodes, two die", quick=False),
    Run("chain", "-DN=5 -DLOSSES=3 -DCRASHES=1 -DEARLY=1", "5 nodes, more faults", quick=False),
    Run("chain", "-DMUT_QUORUM -DLOSSES=2", "a quorum too small"),
    Run("chain", "-DMUT_HIGHEST -DLOSSES=4", "a hop does not pass on what it has accepted"),
    Run(
        "chain", "-DN=5 -DLOSSES=2 -DDEATHS=2 -DMUT_REFUSAL", "promises that come with a refusal count, without what they name", quick=False
    ),
    Run("chain", "-DMUT_ORPHAN -DLOSSES=1 -DCRASHES=1 -DASKERS=1", "nobody takes over"),
)

LEASES = (
    Run("leases", "", "a switch: one ballot"),
    Run("leases", "-DB=2 -DHOLDER=0 -DACTOR=1", "two ballots, the lease at 0, who acts at 1"),
    Run("leases", "-DB=2", "two ballots, the lease and who acts anywhere", quick=False),
    Run("leases", "-DB=3 -DHOLDER=0 -DACTOR=1", "three ballots, the lease at 0, who acts at 1", quick=False),
    Run("leases", "-DPOSITIONS=2 -DHOLDER=2 -DACTOR=0", "an entry or a removal before; the lease at who may be removed", quick=False),
    Run("leases", "-DPOSITIONS=2 -DHOLDER=3 -DACTOR=0", "the same, the lease at the observer"),
    Run("leases", "-DLATE -DPOSITIONS=2 -DHOLDER=3 -DACTOR=0", "the same, released behind the decision, and forgotten"),
    Run("leases", "-DPOSITIONS=2", "the same, the lease and who acts anywhere", quick=False),
    Run("leases", "-DB=3", "three ballots, the lease and who acts anywhere", quick=False),
    Run("leases", "-DOWNER -DPOSITIONS=2", "an owner's lease and its removal"),
    Run("leases", "-DMUT_WAIT", "no T_WAIT"),
    Run("leases", "-DMUT_GRANT", "leases are granted with a vote open"),
    Run("leases", "-DMUT_LENT", "a lent lease is ignored at the vote"),
    Run("leases", "-DMUT_OBSERVER", "observers are not asked"),
    Run("leases", "-DMUT_RELEASE", "releases are not durable"),
    Run("leases", "-DMUT_PARTICIPANT_RELEASE", "a participant releases while something that it lent is live"),
    Run("leases", "-DMUT_PARTICIPANT_EARLY", "a participant releases what it has not decided"),
    Run("leases", "-DPOSITIONS=2 -DHOLDER=2 -DACTOR=0 -DMUT_REMOVED", "who was removed just before is forgotten"),
    Run("leases", "-DPOSITIONS=2 -DHOLDER=2 -DACTOR=0 -DMUT_LEAVING", "a removal that is accepted keeps nobody from granting"),
    Run("leases", "-DPOSITIONS=2 -DHOLDER=3 -DACTOR=0 -DMUT_LEAVING", "likewise, that of the observer", quick=False),
    Run("leases", "-DPOSITIONS=2 -DHOLDER=2 -DACTOR=0 -DMUT_AHEAD", "granted whatever was decided since"),
    Run("leases", "-DB=3 -DHOLDER=0 -DACTOR=1 -DMUT_BALLOTS", "votes of ballots below that of the certificate count, too"),
    Run("leases", "-DOWNER -DMUT_WAIT", "an owner's lease, no T_WAIT"),
    Run("leases", "-DOWNER -DMUT_GRANT", "an owner's lease, granted with a vote open"),
)

LIVES = (
    Run("lives", "-DCHANGES=0 -DLATE", "3 voters, late requests"),
    Run("lives", "-DNUMBERS=2 -DBOTH", "a voter is replaced, two disks run from one life"),
    Run("lives", "-DNUMBERS=3 -DALONE", "a voter is replaced, one disk: it is never refused"),
    Run("lives", "-DNUMBERS=2", "a voter is replaced, the copy is made at any time", quick=False),
    Run("lives", "-DNUMBERS=2 -DBOTH -DCHANGES=2", "a voter goes, then another one comes", quick=False),
    Run("lives", "-DNUMBERS=2 -DBOTH -DCHANGES=2 -DADDS_FIRST", "a voter comes, then another one goes", quick=False),
    Run("lives", "-DCHANGES=0 -DMUT_UNORDERED", "lives without numbers: who has missed some refuses"),
    Run("lives", "-DCHANGES=0 -DMUT_LAGGARD", "lives without numbers: who has missed some grants"),
    Run("lives", "-DNUMBERS=2 -DBOTH -DMUT_UNTOLD", "a new voter grants without the lives of those before"),
    Run("lives", "-DNUMBERS=2 -DBOTH -DMUT_EARLY", "it takes them from voters that still grant as before"),
    Run("lives", "-DNUMBERS=2 -DBOTH -DMUT_TIE", "of two lives of one number it takes the first it hears of"),
)

RUNS = (*CORE, *CHAIN, *LEASES, *LIVES)
