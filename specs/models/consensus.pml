/* The core of 25-consensus: ballots, facts, positions, participants. Safety only.
 *
 * There is no network here. A fact that was signed is there for ever, and whoever acts may go by any set of the
 * facts that there are: so every loss, delay, repetition, order, route and partition is among the runs. A promise
 * holds the ballot that it names; since a ballot has one value, `value` of it says the rest.
 *
 * Of the sets of promises that make a majority only this counts: which ballot is the highest that they name. So a
 * proposer does not pick a set, but the highest one, h: there is a set for it if a majority names h or less, and
 * one of these names h. That is the same for all sets, and far fewer steps.
 *
 * Checked after every step: nobody's decided values differ (I1), and what was chosen is accepted or decided at a
 * majority of its participants (I2; -DONLY_AGREEMENT looks for a mutant's two histories instead).
 */
#ifndef N
#define N 3                 /* nodes, 0 and up */
#endif
#ifndef B
#define B 3                 /* ballots of a position, 1 and up; the node (b - 1) % MAKERS makes ballot b */
#endif
#ifndef MAKERS
#define MAKERS 2
#endif
#ifndef POSITIONS
#define POSITIONS 1
#endif

#define BIT(n) (1 << (n))
#define ALL (BIT(N) - 1)
#define HAS(set, n) (((set) >> (n)) & 1)
#define SIZE(set) (HAS(set, 0) + HAS(set, 1) + HAS(set, 2) + HAS(set, 3) + HAS(set, 4))
#ifdef MUT_QUORUM
#define MAJORITY(set) (SIZE(set) / 2)   /* of those believed alive on each side */
#else
#define MAJORITY(set) (SIZE(set) / 2 + 1)
#endif
#define AT(l, b) ((l) * B + (b) - 1)
#define MAKER(b) (((b) - 1) % MAKERS)

/* What the value of the first position does to the participants of the second. */
#ifdef MEMBERS
#define FIRST 7             /* nodes 0, 1, 2 */
#define KEEP 1
#define REMOVE 2            /* node 2 goes */
#define ADD 3               /* node 3 comes */
#define AFTER(v) ((v) == REMOVE -> 3 : ((v) == ADD -> 15 : FIRST))
#ifndef VALUES_FIRST
#define VALUES_FIRST 3
#endif
#else
#define FIRST ALL
#define AFTER(v) FIRST
#define VALUES_FIRST 2
#endif
#define VALUES(l) ((l) == 0 -> VALUES_FIRST : 2)

byte c[N];                  /* durable: how many positions are decided here */
byte promised[N], accepted[N];
byte first[N];              /* durable: the first position's value, as this node takes it */
byte open_[N];              /* the ballot that its maker collects promises for; gone at a crash */

byte promisers[POSITIONS * B];          /* facts: who promised, the ballot that each promise names, who voted */
byte named[POSITIONS * B * N];
byte voters[POSITIONS * B];
byte value[POSITIONS * B];              /* of a ballot's ACCEPT */
byte chosen[POSITIONS];                 /* what an observer of everything knows */

#define SET(n, l) ((l) == 0 -> FIRST : AFTER(first[n]))
#define TRUE_SET(l) ((l) == 0 -> FIRST : AFTER(chosen[0]))
#define LIVE(n) (c[n] < POSITIONS && HAS(SET(n, c[n]), n))
#define SLOT(b) AT(c[me], b)

#define NAMES(n, h) (HAS(promisers[SLOT(open_[me])] & SET(me, c[me]), n) && named[SLOT(open_[me]) * N + (n)] == (h))
#define UP_TO(n, h) (HAS(promisers[SLOT(open_[me])] & SET(me, c[me]), n) && named[SLOT(open_[me]) * N + (n)] <= (h))
#if N == 3
#define SOME(h) (NAMES(0, h) || NAMES(1, h) || NAMES(2, h))
#define COUNT(h) (UP_TO(0, h) + UP_TO(1, h) + UP_TO(2, h))
#elif N == 4
#define SOME(h) (NAMES(0, h) || NAMES(1, h) || NAMES(2, h) || NAMES(3, h))
#define COUNT(h) (UP_TO(0, h) + UP_TO(1, h) + UP_TO(2, h) + UP_TO(3, h))
#else
#define SOME(h) (NAMES(0, h) || NAMES(1, h) || NAMES(2, h) || NAMES(3, h) || NAMES(4, h))
#define COUNT(h) (UP_TO(0, h) + UP_TO(1, h) + UP_TO(2, h) + UP_TO(3, h) + UP_TO(4, h))
#endif

#ifdef MUT_MIXED                        /* votes for one value count together, whatever their ballots */
#define SAME(l, b, a) ((a) <= B && value[AT(l, a)] == value[AT(l, b)] -> voters[AT(l, a)] : 0)
#if B == 4
#define VOTED(l, b) (SAME(l, b, 1) | SAME(l, b, 2) | SAME(l, b, 3) | SAME(l, b, 4))
#else
#define VOTED(l, b) (SAME(l, b, 1) | SAME(l, b, 2) | SAME(l, b, 3))
#endif
#else
#define VOTED(l, b) voters[AT(l, b)]
#endif
#define DECIDED(set, l, b) (value[AT(l, b)] && SIZE(VOTED(l, b) & (set)) >= MAJORITY(set))

#define KEEPS(n, l) (HAS(TRUE_SET(l), n) && (c[n] > (l) || (c[n] == (l) && accepted[n] && value[AT(l, accepted[n])] == chosen[l])))
inline look() {
#ifndef ONLY_AGREEMENT
        l = 0;
        do
        :: l < POSITIONS && chosen[l] ->
                k = 0; n = 0;
                do :: n < N -> k = k + (KEEPS(n, l)); n++ :: else -> break od;
                assert(k >= SIZE(TRUE_SET(l)) / 2 + 1);                 /* I2 */
                l++
        :: else -> break
        od;
        k = 0; l = 0; n = 0
#else
        skip
#endif
}

inline decide(v) {
        assert(chosen[c[me]] == 0 || chosen[c[me]] == v);               /* I1 */
        chosen[c[me]] = v
}

/* Promises of a ballot that nobody collects any more are facts that nobody will go by: they are left out. */
#define COLLECTED(b) (open_[MAKER(b)] == b && c[MAKER(b)] == c[me])
inline close() {
        if
        :: open_[me] ->
                promisers[SLOT(open_[me])] = BIT(me);
                n = 0;
                do :: n < N -> named[SLOT(open_[me]) * N + n] = 0; n++ :: else -> break od;
                n = 0; open_[me] = 0
        :: else
        fi
}

/* A node takes part in ballot b: its maker opens it, or its PREPARE comes. The own promise is durable before it is sent. */
#define PROMISE(b) \
        :: d_step { LIVE(me) && b > promised[me] && (me == MAKER(b) -> promisers[SLOT(b)] == 0 : promisers[SLOT(b)] != 0) -> \
                promised[me] = b; \
                if :: me == MAKER(b) -> open_[me] = b; promisers[SLOT(b)] = BIT(me) :: else fi; \
                if :: COLLECTED(b) -> promisers[SLOT(b)] = promisers[SLOT(b)] | BIT(me); named[SLOT(b) * N + me] = accepted[me] :: else fi }

/* The maker has promises of a majority of which h is the highest ballot that any names. */
#ifdef MUT_BLIND                        /* it does not look at what they name */
#define CHOOSE(h)
#define NONE B
#else
#define CHOOSE(h) \
        :: d_step { open_[me] > h && SOME(h) && COUNT(h) >= MAJORITY(SET(me, c[me])) -> \
                value[SLOT(open_[me])] = value[SLOT(h)]; close() }
#define NONE 0
#endif
/* None names any: the value is free. (Two values that do nothing are alike, so the first to be used is 1.) */
#if B == 2
#define USED (value[SLOT(1)] || value[SLOT(2)])
#elif B == 3
#define USED (value[SLOT(1)] || value[SLOT(2)] || value[SLOT(3)])
#else
#define USED (value[SLOT(1)] || value[SLOT(2)] || value[SLOT(3)] || value[SLOT(4)])
#endif
#define BEGIN(v) \
        :: d_step { open_[me] && v <= VALUES(c[me]) && (v == 1 || VALUES(c[me]) > 2 || USED) && COUNT(NONE) >= MAJORITY(SET(me, c[me])) -> \
                value[SLOT(open_[me])] = v; close() }

/* The first ballot, that of the lowest number, goes without promises: its maker votes in it if it has promised and voted for nothing. */
#define HURRY(b, v) \
        :: d_step { LIVE(me) && me == MAKER(b) && promised[me] == 0 && v <= VALUES(c[me]) && (v == 1 || VALUES(c[me]) > 2 || USED) -> \
                value[SLOT(b)] = v; promised[me] = b; accepted[me] = b; voters[SLOT(b)] = voters[SLOT(b)] | BIT(me); \
                if :: DECIDED(SET(me, c[me]), c[me], b) -> decide(value[SLOT(b)]) :: else fi; look() }

#define VOTE(b) \
        :: d_step { LIVE(me) && value[SLOT(b)] && b >= promised[me] && !HAS(voters[SLOT(b)], me) -> \
                promised[me] = b; accepted[me] = b; voters[SLOT(b)] = voters[SLOT(b)] | BIT(me); \
                if :: DECIDED(SET(me, c[me]), c[me], b) -> decide(value[SLOT(b)]) :: else fi; look() }

/* Whoever meets a certificate knows that it is one: the vote's answer, a push, or a neighbour's log. */
#define LEARN(b) \
        :: d_step { c[me] < POSITIONS && DECIDED(SET(me, c[me]), c[me], b) -> \
                decide(value[SLOT(b)]); close(); \
                if :: c[me] == 0 -> first[me] = value[SLOT(b)] :: else fi; \
                c[me] = c[me] + 1; promised[me] = 0; accepted[me] = 0; look() }

active [N] proctype Node() {
        byte me = _pid, k, l, n;
end:    do
#ifdef HASTE
        HURRY(1, 1) HURRY(1, 2)
#else
        PROMISE(1)
#endif
#ifdef MUT_FIRST                                                        /* a second one goes without promises, too */
        HURRY(2, 1) HURRY(2, 2)
#endif
        PROMISE(2)
        VOTE(1) VOTE(2)
        LEARN(1) LEARN(2)
        CHOOSE(1)
        BEGIN(1) BEGIN(2)
#if B > 2
        PROMISE(3) VOTE(3) LEARN(3) CHOOSE(2)
#endif
#if B > 3
        PROMISE(4) VOTE(4) LEARN(4) CHOOSE(3)
#endif
#ifdef MEMBERS
        BEGIN(3)
#ifdef HASTE
        HURRY(1, 3)
#endif
#endif
        :: d_step { open_[me] -> close() }                               /* a crash, and the start after it */
#ifdef MUT_VOTE                                                         /* votes are not durable */
        :: d_step { promised[me] || accepted[me] -> close(); promised[me] = 0; accepted[me] = 0; look() }
#endif
#ifdef MUT_PROMISE                                                      /* promises are not */
        :: d_step { promised[me] > accepted[me] -> close(); promised[me] = accepted[me] }
#endif
#ifdef MUT_TENTATIVE                                                    /* what it voted for counts as decided */
        :: d_step { c[me] == 0 && POSITIONS > 1 && accepted[me] ->
                decide(value[AT(0, accepted[me])]); close(); first[me] = value[AT(0, accepted[me])];
                c[me] = 1; promised[me] = 0; accepted[me] = 0 }
#endif
#ifdef MUT_WIPED                                                        /* node 2 lost its disk, and keeps its name */
        :: d_step { me == 2 && c[me] ->
                close(); first[me] = 0; c[me] = 0; promised[me] = 0; accepted[me] = 0 }
#endif
        od
}
