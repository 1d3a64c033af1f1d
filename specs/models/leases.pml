/* Leases against the entry that ends them (26-modes): a switch of a scene's mode, or with -DOWNER a node's removal.
 *
 * One lease and one node that goes by the entry, each anywhere: leases do nothing to each other, and nodes that act by
 * the entry nothing to the lease. So this is every pair of them. The lease may be lent on, once. With -DOWNER the
 * lease is that of an owner, who takes no part in the log, and the entry the RemoveNode of it.
 *
 * Time goes in steps that all clocks feel alike; T_LEASE and T_WAIT are T of them. What clocks that run at different
 * rates need is the difference of T_WAIT and T_LEASE, and arithmetic. T is 2, so that a lease which is asked for a step
 * after somebody began to wait is alive when that wait is over.
 *
 * The log is decided as in consensus.pml, but a ballot is opened in one step: a majority promises and its value is known.
 * Promises and leases do nothing to each other, votes do.
 *
 * Checked: while somebody acts by the entry, nobody can use the lease (I7).
 */
#define N 3                 /* participants 0 to 2 */
#define OBSERVER 3          /* holds the key, or (-DOWNER) is the owner of something */
#ifndef B
#define B 1
#endif
#ifndef POSITIONS
#define POSITIONS 1
#endif
#define T 2
#define LAST_POSITION (POSITIONS - 1)

/* Values. SWITCH ends the lease; the others go before it. */
#define SWITCH 1
#define OTHER 2
#define LESS 3              /* participant 2 is removed, the first position only */
#define UNWATCHED 4         /* the observer is, the first position only */
#ifdef OWNER
#define VALUES_FIRST 3
#define IS_OWNER true
#else
#define VALUES_FIRST 4
#define IS_OWNER false
#endif

#define BIT(n) (1 << (n))
#define HAS(set, n) (((set) >> (n)) & 1)
#define SIZE(set) (HAS(set, 0) + HAS(set, 1) + HAS(set, 2))
#define MAJORITY(set) (SIZE(set) / 2 + 1)
#define ALL 7
#define AT(l, b) ((l) * B + (b) - 1)

/* The log */
byte c[4];                  /* how many positions are decided here */
byte promised[N], accepted[N];          /* accepted: the ballot */
byte value[POSITIONS * B];
byte voters[POSITIONS * B];
byte chosen[POSITIONS];

/* The lease */
byte holder = 9;            /* nobody yet */
byte left_;                 /* steps until it ends, by the moment of asking */
byte have_, granted;        /* the asker's position, and who has granted so far */
byte lent;                  /* steps that whoever borrowed it may use it */
bit remembered;             /* the lender knows that it lent it; gone at a crash */
byte careful;               /* after a start the lender takes for so long that it did */
byte released;              /* durable, at the observer: 1 + the position that it released */
byte said;                  /* the fact that it signed of that */
bit parted;                 /* likewise a participant that holds the lease: it releases the switch */

/* Who acts by the entry */
byte actor = 9;
byte since, since_removal;  /* steps that it still waits, and those in which a removal counts as new */
bit active_;

#define SET(l) ((l) > 0 && chosen[0] == LESS -> 3 : ALL)
#define WATCHED(l) (!((l) > 0 && chosen[0] == UNWATCHED))
#define DECIDED(l, b) (value[AT(l, b)] && SIZE(voters[AT(l, b)] & SET(l)) >= MAJORITY(SET(l)))
#define USABLE (left_ && SIZE(granted & SET(have_)) >= MAJORITY(SET(have_)))
#define SAFE assert(!(active_ && (USABLE || lent)))
#define ENDED (chosen[LAST_POSITION] == SWITCH || (POSITIONS > 1 && chosen[0] == SWITCH))
#define WHERE (POSITIONS > 1 && chosen[0] == SWITCH -> 0 : LAST_POSITION)        /* the entry's position */
#define IS_SWITCH(l, b) (value[AT(l, b)] == SWITCH)

#define drop left_ = 0; granted = 0; have_ = 0

/* A majority promises ballot b at position l; the value is the highest's that they accepted, or free. */
#define OPEN(l, b, q, v) \
        :: d_step { !value[AT(l, b)] && (q & SET(l)) == q && SIZE(q) >= MAJORITY(SET(l)) && READY(l, b, q, 0) && READY(l, b, q, 1) && READY(l, b, q, 2) && \
                ((v) <= ((l) == 0 && POSITIONS > 1 -> VALUES_FIRST : 2)) -> \
                h = 0; \
                n = 0; \
                do \
                :: n < N && HAS(q, n) -> promised[n] = b; if :: accepted[n] > h -> h = accepted[n] :: else fi; n++ \
                :: n < N && !HAS(q, n) -> n++ \
                :: n == N -> break \
                od; \
                value[AT(l, b)] = (h -> value[AT(l, h)] : v); \
                n = 0; h = 0 }
#define READY(l, b, q, n) (!HAS(q, n) || (c[n] == (l) && promised[n] < (b)))

#ifdef MUT_LENT
#define MAY_VOTE(l, b) true
#else
#define MAY_VOTE(l, b) (!(IS_SWITCH(l, b) && me == holder && ((lent && remembered) || careful)))
#endif
#define VOTE(l, b) \
        :: d_step { c[me] == (l) && HAS(SET(l), me) && value[AT(l, b)] && b >= promised[me] && !HAS(voters[AT(l, b)], me) && MAY_VOTE(l, b) -> \
                promised[me] = b; accepted[me] = b; voters[AT(l, b)] = voters[AT(l, b)] | BIT(me); \
                if :: IS_SWITCH(l, b) && me == holder -> drop :: else fi; \
                if :: DECIDED(l, b) && !chosen[l] -> chosen[l] = value[AT(l, b)] :: else fi }

#define LEARN(l) \
        :: d_step { c[me] == (l) && chosen[l] -> \
                c[me] = (l) + 1; \
                if :: me < N -> promised[me] = 0; accepted[me] = 0 :: else fi; \
                if :: me == holder && chosen[l] == SWITCH && !IS_OWNER -> drop :: else fi; \
                if :: me == actor && ENDED && c[me] > WHERE -> since = T :: else fi; \
                if :: me == actor && (chosen[l] == LESS || chosen[l] == UNWATCHED) -> since_removal = T :: else fi }

/* What is accepted ends no lease: it is no switch, and removes nobody. An owner's voters accept nothing. */
#ifdef MUT_GRANT
#define CLOSED true
#else
#ifdef OWNER
#define CLOSED (accepted[me] == 0)
#else
#ifdef MUT_LEAVING                      /* a removal that is accepted does not count */
#define CLOSED (accepted[me] == 0 || !IS_SWITCH(c[me], accepted[me]))
#else
#define CLOSED (accepted[me] == 0 || value[AT(c[me], accepted[me])] == OTHER)
#endif
#endif
#endif
/* Who grants may be ahead of the asker, if those who decide are the same, and the mode (or the owner is still there). */
#ifdef MUT_AHEAD
#define STEADY true
#else
#define STEADY (SET(c[me]) == SET(have_) && !(ENDED && c[me] > WHERE))
#endif
#define POSITION (c[me] >= have_ && c[me] <= LAST_POSITION && STEADY)
#define GRANT \
        :: d_step { left_ && me < N && POSITION && CLOSED && HAS(SET(c[me]), me) && !HAS(granted, me) && ADMITTED -> \
                granted = granted | BIT(me); SAFE }
#ifdef OWNER
#define ADMITTED true                   /* who is asked at a position behind the removal refuses; so the owner is not let ask there */
#else
#define ADMITTED (holder == OBSERVER -> WATCHED(c[me]) : HAS(SET(c[me]), holder))
#endif

/* Who holds a switch accepted, or has released the position, asks for none. */
#ifdef OWNER
#define MAY_ASK true
#else
#define MAY_ASK (holder == OBSERVER -> released <= c[me] : accepted[holder] == 0 || !IS_SWITCH(c[me], accepted[holder]))
#endif
#define ASK \
        :: d_step { me == holder && c[me] <= LAST_POSITION && !(ENDED && c[me] > WHERE) && MAY_ASK -> \
                left_ = T; granted = 0; have_ = c[me] }

/* (a) of the page: of each participant a vote in a ballot not below that of a certificate, or a release; the observer's release; nobody was
 * removed lately; (b) the wait. Any facts may be known, and more of them only allow more: so all that there are count, from any certificate on. */
#define VOTES_OF(b) ((b) <= B && value[AT(WHERE, ((b) <= B -> (b) : 1))] == SWITCH -> voters[AT(WHERE, ((b) <= B -> (b) : 1))] & SET(WHERE) : 0)
#define VOTES_FROM_3 VOTES_OF(3)
#define VOTES_FROM_2 (VOTES_OF(2) | VOTES_FROM_3)
#define VOTES_FROM_1 (VOTES_OF(1) | VOTES_FROM_2)
#define CERTIFIED(b) (SIZE(VOTES_OF(b)) >= MAJORITY(SET(WHERE)))
/* Who never holds the lease has nothing of before, and may release the switch as soon as it has decided it. */
#define PARTED(n) ((n) == holder -> parted : ENDED && c[n] > WHERE)
#define RELEASED ((PARTED(0) -> 1 : 0) | (PARTED(1) -> 2 : 0) | (PARTED(2) -> 4 : 0))
#define COVERED(votes) ((((votes) | RELEASED) & SET(WHERE)) == SET(WHERE))
#ifdef MUT_BALLOTS                      /* votes of ballots below that of the certificate count, too */
#define ALL_PARTED COVERED(VOTES_FROM_1)
#else
#define ALL_PARTED ((CERTIFIED(1) && COVERED(VOTES_FROM_1)) || (CERTIFIED(2) && COVERED(VOTES_FROM_2)) || (CERTIFIED(3) && COVERED(VOTES_FROM_3)))
#endif
#ifdef MUT_OBSERVER
#define ALL_RELEASED true
#else
#define ALL_RELEASED (!WATCHED(WHERE) || said > WHERE)
#endif
#ifdef MUT_REMOVED
#define NOBODY_LEFT true
#else
#define NOBODY_LEFT (since_removal == 0)
#endif
#ifdef OWNER
#define SHORT false
#else
#define SHORT (ALL_PARTED && ALL_RELEASED && NOBODY_LEFT)
#endif
#ifdef MUT_WAIT
#define WAITED true
#else
#define WAITED (since == 0)
#endif

/* Somebody has voted for a switch at this position: then an observer releases it. */
#define VOTED_IN(l, b) ((b) <= B && voters[AT(l, ((b) <= B -> (b) : 1))] && IS_SWITCH(l, ((b) <= B -> (b) : 1)))
#define BEGUN(l) (VOTED_IN(l, 1) || VOTED_IN(l, 2) || VOTED_IN(l, 3))
#if POSITIONS > 1
#define ENDING (BEGUN(1) -> 2 : (BEGUN(0) -> 1 : 0))
#else
#define ENDING (BEGUN(0) -> 1 : 0)
#endif
#if defined(MUT_RELEASE) || defined(LATE)       /* a release is not durable */
#define LOSE released = 0
#else
#define LOSE skip
#endif
#ifdef LATE                             /* an observer releases what it has learnt to be decided, and no sooner */
#define KNOWN (ENDED && c[me] > WHERE)
#else
#define KNOWN true
#endif

/* A participant releases what it has decided, once nothing of before is held or lent there. */
#ifdef MUT_PARTICIPANT_RELEASE          /* whatever it has lent */
#define NOTHING_LEFT true
#else
#define NOTHING_LEFT (left_ == 0 && !(lent && remembered) && !careful)
#endif
#ifdef MUT_PARTICIPANT_EARLY            /* shown a vote, as an observer does, but not durably */
#define MAY_PART (ENDING != 0)
#else
#define MAY_PART (ENDED && c[me] > WHERE)
#endif

#define less(x) x = (x > 0 -> x - 1 : 0)

active [4] proctype Node() {
        byte me = _pid, h, n;
end:    do
        VOTE(0, 1) LEARN(0)
#if B > 1
        VOTE(0, 2)
#endif
#if B > 2
        VOTE(0, 3)
#endif
#if POSITIONS > 1
        VOTE(1, 1) LEARN(1)
#endif
        GRANT
        ASK
#ifndef OWNER
        :: d_step { me == holder && me < N && USABLE && !lent && !careful ->              /* a client borrows it */
                lent = left_; remembered = 1; SAFE }
        :: d_step { me == holder && lent && remembered -> lent = 0; remembered = 0 }      /* and gives it back */
        :: d_step { me == OBSERVER && ENDING && released <= c[me] && KNOWN ->             /* shown a vote for a switch, it releases */
                released = ENDING; said = ENDING; if :: me == holder -> drop :: else fi }
        :: d_step { me == holder && me < N && !parted && MAY_PART && NOTHING_LEFT -> parted = 1 }
        :: d_step { me == holder && me < N && (left_ || remembered) -> drop; remembered = 0; careful = T }      /* crashes */
        :: d_step { me == holder && me == OBSERVER && (left_ || released) -> drop; LOSE }
#endif
        :: d_step { me == actor && ENDED && c[me] > WHERE && !active_ && (WAITED || SHORT) -> active_ = 1; SAFE }
        :: d_step { me == actor && (since < T || active_) && ENDED && c[me] > WHERE -> active_ = 0; since = T; since_removal = T }
        od
}
/* Proposers, and time. */
#define EACH_MAJORITY(l, b, v) OPEN(l, b, 3, v) OPEN(l, b, 5, v) OPEN(l, b, 6, v)
active proctype Rest() {
        byte h, n;
        atomic {
#ifdef OWNER
                holder = OBSERVER; actor = 0
#else
#ifdef HOLDER
                holder = HOLDER; actor = ACTOR
#else
                if :: holder = 0 :: holder = 2 :: holder = OBSERVER fi;
                if :: actor = 0 :: actor = 1 :: actor = OBSERVER fi
#endif
#endif
        }
end:    do
        EACH_MAJORITY(0, 1, SWITCH) EACH_MAJORITY(0, 1, OTHER)
#if B > 1
        EACH_MAJORITY(0, 2, SWITCH) EACH_MAJORITY(0, 2, OTHER)
#endif
#if B > 2
        EACH_MAJORITY(0, 3, SWITCH) EACH_MAJORITY(0, 3, OTHER)
#endif
#if POSITIONS > 1
        EACH_MAJORITY(0, 1, LESS)
        EACH_MAJORITY(1, 1, SWITCH) EACH_MAJORITY(1, 1, OTHER)
#ifndef OWNER
        EACH_MAJORITY(0, 1, UNWATCHED)
#endif
#endif
        :: d_step { left_ || lent || since || since_removal || careful ->
                less(left_); less(lent); less(since); less(since_removal); less(careful);
                if :: left_ == 0 -> drop :: else fi;
                if :: lent == 0 -> remembered = 0 :: else fi }
        od
}
