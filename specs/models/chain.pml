/* Packets 7, 8 and 9 along the chain (25-consensus): two arms, facts gathered hop by hop, answers that turn round.
 *
 * Two nodes are joined by a connection each way, which keeps the order of what it carries and may lose it. A hop that
 * knows that the next one is dead goes on to the one behind it; one whose packet was lost turns round once its timer says
 * so, or never; one whose timer ran out too early does both, and the late answer comes all the same. Pushes of a certificate come, or do not, whatever was said before. Faults
 * are so many: LOSSES, CRASHES with a start after it, DEATHS without, EARLY timers.
 *
 * Other timers are longer than a pass: they fire only when nothing is under way. Then a proposer goes by what it has, a
 * participant that holds something accepted takes over, one that lacks what another one knows asks for it.
 *
 * Checked: no two nodes decide differently; and every run ends, with all who live agreed or nothing left to be decided.
 * It ends since each step uses up a packet or a fault, or begins a higher ballot, and no run comes to BALLOT_MAX; it
 * ends well since whenever nothing is under way, and something is to be decided, somebody's timer runs.
 */
#ifndef N
#define N 3
#endif
#ifndef ASKERS
#define ASKERS 2            /* the ends of the chain ask for something, or node 0 alone */
#endif
#ifndef LOSSES
#define LOSSES 0
#endif
#ifndef CRASHES
#define CRASHES 0
#endif
#ifndef DEATHS
#define DEATHS 0
#endif
#ifndef EARLY
#define EARLY 0
#endif
#define BALLOT_MAX 60
#define PREPARE 1
#define ACCEPT 2

#define BIT(n) (1 << (n))
#define HAS(set, n) (((set) >> (n)) & 1)
#define SIZE(set) (HAS(set, 0) + HAS(set, 1) + HAS(set, 2) + HAS(set, 3) + HAS(set, 4))
#ifdef MUT_QUORUM
#define MAJORITY (N / 2)
#else
#define MAJORITY (N / 2 + 1)
#endif
#define MAKER(b) (((b) - 1) % N)
#define OLD(b, v) ((b) * 4 + (v))       /* a ballot and its value; 0: none */
#define ASKS_FOR(n) ((n) == 0 -> 1 : 2)

mtype = { propose, accept, reject };
/* kind, who sent it, phase, ballot, facts, highest accepted (PREPARE) or value (ACCEPT); of a reject the hint, or 0 and the decided value */
chan from_left[N] = [4] of { mtype, byte, byte, byte, byte, byte };
chan from_right[N] = [4] of { mtype, byte, byte, byte, byte, byte };

byte promised[N], accepted[N], decided[N];              /* durable */
bit wants[N];
byte gone;                              /* who has died */
byte pushed;                            /* to whom a certificate is on its way */
byte truth;                             /* what was decided */
byte losses = LOSSES, crashes = CRASHES, deaths = DEATHS, early = EARLY;
bit begun;
byte fresh;                             /* who asks, and has not begun yet: they all begin at once */

#define LIVES(n) (!HAS(gone, n))
#if N == 3
#define UNDER_WAY (len(from_left[1]) + len(from_left[2]) + len(from_right[0]) + len(from_right[1]))
#define LEFT(n) ((n) > 0 && LIVES((n) - 1) -> (n) - 1 : ((n) > 1 && LIVES((n) - 2) -> (n) - 2 : N))
#define RIGHT(n) ((n) + 1 < N && LIVES((n) + 1) -> (n) + 1 : ((n) + 2 < N && LIVES((n) + 2) -> (n) + 2 : N))
#define ANY(x) (x(0) || x(1) || x(2))
#else
#define UNDER_WAY (len(from_left[1]) + len(from_left[2]) + len(from_left[3]) + len(from_left[N - 1]) + len(from_right[0]) + len(from_right[1]) + len(from_right[2]) + len(from_right[N - 2]))
#define LEFT(n) ((n) > 0 && LIVES((n) - 1) -> (n) - 1 : ((n) > 1 && LIVES((n) - 2) -> (n) - 2 : ((n) > 2 && LIVES((n) - 3) -> (n) - 3 : N)))
#define RIGHT(n) ((n) + 1 < N && LIVES((n) + 1) -> (n) + 1 : ((n) + 2 < N && LIVES((n) + 2) -> (n) + 2 : ((n) + 3 < N && LIVES((n) + 3) -> (n) + 3 : N)))
#if N == 4
#define ANY(x) (x(0) || x(1) || x(2) || x(3))
#else
#define ANY(x) (x(0) || x(1) || x(2) || x(3) || x(4))
#endif
#endif
#define QUIET (begun && UNDER_WAY == 0 && pushed == 0 && fresh == 0)
#define KNOWS(n) (LIVES(n) && decided[n] != 0)
#define LACKS(n) (LIVES(n) && decided[n] == 0)
#define HOLDS(n) (LIVES(n) && decided[n] == 0 && accepted[n] != 0)
#define ASKS(n) (LIVES(n) && wants[n])
#ifdef MUT_ORPHAN                       /* nobody takes over */
#define TAKES_OVER(n) false
#else
#define TAKES_OVER(n) (accepted[n] != 0)
#endif

inline put() {
        if :: to > me -> from_left[to]!kind, me, phase, b, facts, v
           :: to < me -> from_right[to]!kind, me, phase, b, facts, v
        fi
}
inline send() {                         /* what the fields say goes to `to`; N is nobody */
        if :: to == N || HAS(gone, to) -> skip
           :: !(to == N || HAS(gone, to)) -> if :: put() :: losses > 0 -> losses-- fi
        fi
}
inline stop() { mine = 0; doing = 0; got = 0; best = 0; arms = 0; hint = 0 }
inline settle(x) {
        assert(truth == 0 || truth == x);
        truth = x; decided[me] = x; wants[me] = 0; fresh = fresh & ~BIT(me); promised[me] = 0; accepted[me] = 0;
        stop()
}
inline both_arms() {
        kind = propose; phase = doing; b = mine; facts = BIT(me); v = best;
        got = facts; arms = 0;
        to = LEFT(me); arms = arms + (to < N); send();
        to = RIGHT(me); arms = arms + (to < N); send()
}
inline start() {
        b = me + 1;
        do :: b <= promised[me] || b <= hint -> b = b + N :: else -> break od;
        assert(b <= BALLOT_MAX);
        mine = b; promised[me] = b; doing = PREPARE; best = accepted[me]; hint = 0;
        both_arms()
}
inline rest() { hint = (hint > mine -> hint : mine); doing = 0; mine = 0; got = 0; best = 0; arms = 0 }
inline go_on() {                        /* all arms are back, or the pass took too long */
        if
        :: doing == PREPARE && SIZE(got) >= MAJORITY && promised[me] == mine && (best || wants[me]) ->
                doing = ACCEPT;
                if :: best -> best = best & 3 :: else -> best = ASKS_FOR(me) fi;
                accepted[me] = OLD(mine, best);
                both_arms()
        :: doing == ACCEPT && SIZE(got) >= MAJORITY ->
                v = best; settle(v); pushed = (BIT(N) - 1) & ~BIT(me) & ~gone
        :: else -> rest()
        fi
}
inline on_propose() {                   /* `to`: away from the maker */
        if
        :: decided[me] -> kind = reject; v = decided[me]; to = from
        :: !decided[me] && b < promised[me] -> kind = reject; v = OLD(promised[me], 0); to = from
        :: else ->
                if :: b > promised[me] -> promised[me] = b; stop() :: else fi;
                facts = facts | BIT(me);
                if
#ifndef MUT_HIGHEST                     /* a hop does not put in what it has accepted */
                :: phase == PREPARE && accepted[me] > v -> v = accepted[me]
#endif
                :: phase == ACCEPT -> accepted[me] = OLD(b, v)
                :: else
                fi;
                if
                :: to == N -> kind = accept; to = from
                :: to < N
                :: to < N && early > 0 -> early--; put(); kind = accept; to = from
                :: to < N && losses > 0 -> losses--; kind = accept; to = from
                fi
        fi;
        send()
}
#ifdef MUT_REFUSAL                      /* promises that come with a refusal count, without what they name */
#define ENDS false
#else
#define ENDS (kind == reject && phase == PREPARE)
#endif
inline on_answer() {                    /* `to`: towards the maker */
        if
        :: kind == reject && v < 4 && !decided[me] -> settle(v)
        :: kind == accept && phase == ACCEPT && SIZE(facts) >= MAJORITY && !decided[me] && me != MAKER(b) -> settle(v)
        :: else
        fi;
        if
        :: me != MAKER(b) -> send()
        :: me == MAKER(b) && b == mine && phase == doing && ENDS ->
                if :: v / 4 > hint -> hint = v / 4 :: else fi;
                rest()
        :: me == MAKER(b) && b == mine && phase == doing && !ENDS ->
                arms = (arms > 0 -> arms - 1 : 0);
                got = got | facts;
                if :: kind == reject && v / 4 > hint -> hint = v / 4
                   :: kind == accept && phase == PREPARE && v > best -> best = v
                   :: else
                fi;
                if :: arms == 0 -> go_on() :: else fi
        :: else                         /* of a pass that is over */
        fi
}

proctype Node(byte me) {
        mtype kind; byte from, phase, b, facts, v, to;
        byte mine, doing, got, best, arms, hint;
#define FORGET kind = 0; from = 0; phase = 0; b = 0; facts = 0; v = 0; to = 0
end:    do
        :: atomic {
                LIVES(me) && (nempty(from_left[me]) || nempty(from_right[me])) ->
                if :: from_left[me]?kind, from, phase, b, facts, v -> to = RIGHT(me)
                   :: from_right[me]?kind, from, phase, b, facts, v -> to = LEFT(me)
                fi;
                if :: kind == propose -> on_propose() :: else -> on_answer() fi; FORGET }
        :: atomic { HAS(pushed, me) ->
                pushed = pushed & ~BIT(me);
                if :: LIVES(me) && !decided[me] -> settle(truth)
                   :: losses > 0 -> losses--
                   :: !LIVES(me) || decided[me]
                fi; FORGET }
        :: atomic { LACKS(me) && doing == 0 && (HAS(fresh, me) || QUIET && (wants[me] || TAKES_OVER(me)) || early > 0 && wants[me] && begun) ->
                if :: HAS(fresh, me) -> fresh = fresh & ~BIT(me) :: else -> if :: QUIET :: !QUIET -> early-- fi fi;
                start(); FORGET }
        :: atomic { LACKS(me) && doing != 0 && QUIET -> go_on(); FORGET }
        :: atomic { LACKS(me) && QUIET && ANY(KNOWS) -> settle(truth); FORGET }
        :: atomic { LIVES(me) && crashes > 0 && (doing || wants[me]) -> crashes--; wants[me] = 0; fresh = fresh & ~BIT(me); stop() }
        :: atomic { LIVES(me) && deaths > 0 && begun ->
                deaths--; gone = gone | BIT(me); wants[me] = 0; fresh = fresh & ~BIT(me); promised[me] = 0; accepted[me] = 0; decided[me] = 0;
                stop();
                do :: from_left[me]?_, _, _, _, _, _
                   :: from_right[me]?_, _, _, _, _, _
                   :: empty(from_left[me]) && empty(from_right[me]) -> break
                od }
        od
}

init {
        byte n;
        atomic {
                wants[0] = 1; fresh = BIT(0);
                if :: ASKERS > 1 -> wants[N - 1] = 1; fresh = fresh | BIT(N - 1) :: else fi;
                do :: n < N -> run Node(n); n++ :: else -> break od;
                n = 0; begun = 1
        }
        timeout;                        /* nothing can go on: all who live agree, or there is nothing to agree on */
        assert(!ANY(LACKS) || truth == 0 && !ANY(HOLDS) && !ANY(ASKS))
}
