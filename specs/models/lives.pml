/* Lives (26-modes): a node's disk that was put back to an older state gets no lease again, from a majority of voters.
 *
 * One node, and one copy of its disk, made at any moment and started at any later one, as often as one likes; with -DBOTH before the first life was granted, with -DALONE never. A life is
 * (number, mark): the node draws the numbers one after the other; the mark stands for the random bits, and is 0 until
 * the copy is made, then 1 at the node and 2 at the copy. With -DLATE every request that
 * was ever made may still come to a voter.
 *
 * The voters change: 0, 1, 2, then 0, 1, 3 at once, of which majorities need not meet; with -DCHANGES=2 they are without 2
 * in between, or (-DADDS_FIRST) with both. When a change is decided, and who
 * learns of it when, is free. That who has voted grants nothing is not needed here, and not in the model.
 *
 * Checked: once a majority holds a life, whoever asks under an older one, or another of its number, gets no majority; no
 * number has two such lives; and as long as no copy was started, no voter ever refuses the node.
 */
#ifndef NUMBERS
#define NUMBERS 3           /* the highest number of a life */
#endif
#ifndef CHANGES
#define CHANGES 1           /* of voters */
#endif
#define V 4
#define NODE 0
#define COPY 1
#define LIFE(number, mark) ((number) * 4 + (mark))      /* 0: none */
#define NOBODYS 3           /* the mark that a voter holds where it cannot tell whose life was granted: it takes none of that number */
#define NUMBER(life) ((life) / 4)
#define MARK(life) ((life) % 4)

#define BIT(n) (1 << (n))
#define HAS(set, n) (((set) >> (n)) & 1)
#define SIZE(set) (HAS(set, 0) + HAS(set, 1) + HAS(set, 2) + HAS(set, 3))
#define MAJORITY(set) (SIZE(set) / 2 + 1)

#if CHANGES == 1
#define SET(l) ((l) == 0 -> 7 : 11)
#elif defined(ADDS_FIRST)
#define SET(l) ((l) == 0 -> 7 : ((l) == 2 -> 11 : 15))
#else
#define SET(l) ((l) == 0 -> 7 : ((l) == 2 -> 11 : 3))
#endif
byte decided;               /* how many of the changes */

/* Voters, all of it durable */
byte c[V];
byte held[V];               /* the life that it granted last */
byte ready[V];              /* 1 + the position as of which its lives are those of a majority before; 0: it grants nothing */
byte heard[V];              /* whose lives it has taken for that, so far */

/* The node and the copy */
byte now[2];                /* durable: the life */
bit running[2], copied;
byte have_[2], granted[2];  /* of the open request; 0 granted and `asked` off: none */
bit asked[2], late[2], known[2];
int requests;               /* every life that was ever asked under, by number and mark */

byte newest;                /* the highest life that a majority held at one position at some time */

#define OLDER(life) (NUMBER(newest) > NUMBER(life) || NUMBER(newest) == NUMBER(life) && newest != (life))

#ifdef MUT_UNORDERED        /* as with one voter: it holds the life that is asked under, or the one drawn before it */
#define TAKES(life) (held[me] == 0 || held[me] == (life) || NUMBER(held[me]) + 1 == NUMBER(life) && (MARK(held[me]) == 0 || MARK(held[me]) == MARK(life)))
#else
#ifdef MUT_LAGGARD          /* it grants what it cannot tell: a life with a number that it does not hold */
#define TAKES(life) (NUMBER(held[me]) != NUMBER(life) || held[me] == (life))
#else
#define TAKES(life) (NUMBER(held[me]) < NUMBER(life) || held[me] == (life))
#endif
#endif
#define GRANT(p) \
        :: d_step { asked[p] && c[me] == have_[p] && HAS(SET(c[me]), me) && ready[me] > c[me] && !HAS(granted[p], me) && TAKES(now[p]) -> \
                held[me] = now[p]; granted[p] = granted[p] | BIT(me); \
                if \
                :: SIZE(granted[p]) >= MAJORITY(SET(have_[p])) -> \
                        assert(!late[p]); \
                        assert(NUMBER(newest) != NUMBER(now[p]) || newest == now[p]); \
                        if :: NUMBER(newest) < NUMBER(now[p]) -> newest = now[p] :: else fi; \
                        known[p] = 1; asked[p] = 0; granted[p] = 0; have_[p] = 0; late[p] = 0 \
                :: else \
                fi } \
        :: d_step { asked[p] && c[me] == have_[p] && HAS(SET(c[me]), me) && ready[me] > c[me] && !TAKES(now[p]) && !running[COPY] && !late[p] -> \
                assert(false) }
#define COMES_LATE(number, mark) \
        :: d_step { HAS(requests, LIFE(number, mark)) && ready[me] > c[me] && NUMBER(held[me]) < number -> held[me] = LIFE(number, mark) }

/* Lives of the voters before: of a majority that grants no more as of then. */
#ifdef MUT_EARLY
#define GRANTS_NO_MORE(u) true
#else
#define GRANTS_NO_MORE(u) (c[u] >= c[me])
#endif
#define TAKE(u) \
        :: d_step { c[me] && ready[me] <= c[me] && HAS(SET(c[me]), me) && HAS(SET(c[me] - 1), u) && !HAS(heard[me], u) && \
                ready[u] >= c[me] && GRANTS_NO_MORE(u) -> \
                heard[me] = heard[me] | BIT(u); \
                if :: NUMBER(held[u]) > NUMBER(held[me]) -> held[me] = held[u] \
                   :: TIED(u) -> held[me] = LIFE(NUMBER(held[me]), NOBODYS) \
                   :: else fi; \
                if :: SIZE(heard[me]) >= MAJORITY(SET(c[me] - 1)) -> ready[me] = c[me] + 1; heard[me] = 0 :: else fi }
#ifdef MUT_TIE
#define TIED(u) false
#else
#define TIED(u) (NUMBER(held[u]) == NUMBER(held[me]) && held[u] != held[me])
#endif
#ifdef MUT_UNTOLD
#define UNTOLD :: d_step { ready[me] <= c[me] -> ready[me] = c[me] + 1; heard[me] = 0 }
#else
#define UNTOLD
#endif

active [V] proctype Voter() {
        byte me = _pid;
end:    do
        GRANT(NODE) GRANT(COPY)
#ifdef LATE
        COMES_LATE(1, 0) COMES_LATE(2, 0) COMES_LATE(2, 1) COMES_LATE(2, 2)
#if NUMBERS > 2
        COMES_LATE(3, 0) COMES_LATE(3, 1) COMES_LATE(3, 2)
#endif
#endif
        TAKE(0) TAKE(1) TAKE(2) TAKE(3) UNTOLD
        :: d_step { c[me] < decided -> c[me] = c[me] + 1; heard[me] = 0 }
        od
}

#define DRAWS(p) LIFE(NUMBER(now[p]) + 1, (!copied -> 0 : (p) + 1))
#ifdef LATE
#define REMEMBER(p) requests = requests | BIT(now[p])
#else
#define REMEMBER(p) skip
#endif
#define ASK(p, l) \
        :: d_step { running[p] && !known[p] && l <= decided && (!asked[p] || have_[p] < l) -> \
                asked[p] = 1; granted[p] = 0; have_[p] = l; late[p] = (OLDER(now[p])); REMEMBER(p) }
#define PROCESS(p) \
        ASK(p, 0) ASK(p, 1) ASK(p, 2) \
        :: d_step { running[p] && known[p] && NUMBER(now[p]) < NUMBERS -> known[p] = 0; now[p] = DRAWS(p) } \
        AGAIN(p)
#if defined(BOTH) || defined(ALONE)     /* who asks once more under a life that was granted is as one who had not asked yet */
#define AGAIN(p)
#else
#define AGAIN(p) :: d_step { running[p] && known[p] -> known[p] = 0 }            /* starts anew, or renews */
#endif

active proctype Disks() {
        d_step {
                ready[0] = 1; ready[1] = 1; ready[2] = 1; now[NODE] = LIFE(1, 0); running[NODE] = 1;
#ifdef BOTH
                copied = 1; now[COPY] = LIFE(1, 0); running[COPY] = 1
#else
                skip
#endif
        }
end:    do
        PROCESS(NODE)
        PROCESS(COPY)
#ifndef ALONE
        :: d_step { !copied -> copied = 1; now[COPY] = now[NODE] }
        :: d_step { copied && !running[COPY] -> running[COPY] = 1 }
#endif
        :: d_step { decided < CHANGES -> decided++ }
        od
}
