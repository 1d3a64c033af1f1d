"""The times of membership (design: consensus §5; specs/15-cluster-log.md, Lease), each with its reason.

Only the three of the lease carry safety; all others only say how soon something is tried again. No two clocks are
compared anywhere: a time is measured on one clock, and of two clocks only their rates are assumed to agree within 1 %.
"""

from __future__ import annotations

T_LEASE_S = 12.0
"""An owner lease, from the moment of *asking* on: three renewals may be lost in a row before anybody notices."""
RENEW_S = 4.0
"""Between two renewals: a third of the lease, so that one lost answer costs nothing."""
T_WAIT_S = 1.05 * T_LEASE_S
"""After this time on any clock, a lease that was asked for before is over on every other clock: rates differ by 1 %
at most, and four more percent are free."""

LIFE_S = 60.0
"""The voter tells a restored backup from the node itself if it was made this long, and a lease, before the node's last
acknowledged write (specs/15-cluster-log.md, Lives). Each time costs a durable write here and one at the voter."""

LEASE_ASK_S_MAX = 2.0
"""For the voter to answer; half of RENEW_S, so that a lost answer is asked for again while the lease lives."""
LEASE_RETRY_S = 0.5
"""After a lease was not granted, or nobody answered: soon enough that a restarted voter is found again at once."""
SYNC_S = 10.0
"""A node that has heard nothing new asks anyway (consensus §5, T_sync): a lost push is mended by then."""
LOG_ASK_S_MAX = 3.0
"""For one node to answer with a part of the log; the next one is asked then."""
PULL_PAUSE_S = 0.2
"""Between two pulls, so that a node that claims a position which it does not have cannot keep us busy."""
PUSH_S_MAX = 2.0
"""For a pushed entry to leave; who is away pulls it later."""
PUSH_PAUSE_S = 0.05
"""Between two pushes to one node: entries that are made meanwhile, as when a cluster starts, travel together."""
PUSH_PAUSE_EACH_S = 0.001
"""The same for each node that is told: a thousand that register at once would make the voter send a million packets."""
PROPOSE_S_MAX = 30.0
"""The deadline of a proposal (consensus §5, request deadline)."""
PROPOSE_ASK_S_MAX = 15.0
"""For the voter to answer a proposal: before a removal it probes who is to be removed."""
PROPOSE_RETRY_S = 0.5
"""Between two tries of one proposal while the voter is away."""
VOTER_PATIENCE_S = 1.5
"""For other nodes to say that they hold a log which the voter lacks, before it begins one."""
ENROL_RETRY_S = 1.0
"""Between two looks at how to become a member, where nothing else wakes us."""
REMOVE_AFTER_S = 120.0
"""Nobody is removed who was heard within this time (a setting): a reboot takes about a minute."""

T_EVICT_S = 600.0
"""A voter that was not heard for so long is removed as one: each that is away is one fewer that may be lost."""

assert LEASE_ASK_S_MAX + LEASE_RETRY_S < RENEW_S < T_LEASE_S < T_WAIT_S
assert LIFE_S > T_LEASE_S
assert REMOVE_AFTER_S > T_WAIT_S
