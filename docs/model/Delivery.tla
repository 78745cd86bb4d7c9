------------------------------ MODULE Delivery ------------------------------
(* How messages travel from a node's flash over gateways' spools to the      *)
(* cloud's store, with each failure at each point. Laws 2 and 3 of           *)
(* docs/architecture.md are invariants; "what is durable is stored at last"  *)
(* is a property. README.md maps each action to a function of the code.      *)
(*                                                                           *)
(* A message is <<node, boot, sequence>>. The network keeps what was ever    *)
(* said and delivers it never, late, often, in any order. Several clouds     *)
(* share a store, whose slots are locked apart; one slot is one writer.      *)
EXTENDS Naturals, FiniteSets, TLC

CONSTANTS Nodes, Gateways, Clouds,  \* nodes are numbers: n is of slot n % Slots
          Slots, Boots, Sequences,  \* how many there are
          Worn,                     \* nodes that the subject to be erased wears
          MostNamed,                \* most messages that full flashes evict
          MostBatch,                \* most messages of a batch and of an upload
          Loaded,                   \* whether all begins with messages in spools, and none elsewhere
          Whole,                    \* whether a transaction's steps run as one, as of a lone cloud
          None                      \* no value

Messages == Nodes \X (1..Boots) \X (0..Sequences - 1)
SlotOf(n) == n % Slots
AllSlots == 0..Slots - 1
InSlot(m, s) == SlotOf(m[1]) = s
Before(p, q) == p[1] < q[1] \/ (p[1] = q[1] /\ p[2] < q[2])
Position(m) == <<m[2], m[3]>>
Min(S) == CHOOSE x \in S : \A y \in S : x <= y
Max(S) == CHOOSE x \in S : \A y \in S : x >= y

VARIABLES
    boot,       \* node -> number of its boot
    made,       \* messages that were ever durable in a flash
    flash,      \* messages that are in a flash now
    named,      \* messages that a gap names as lost: a full flash evicted them
    sent,       \* envelopes that nodes ever published: <<message, held>>
    acks,       \* spans that gateways ever acknowledged: <<node, boot, first, last>>
    mem, disk,  \* gateway -> accepted messages and cut-offs, in memory and in the spool
    batch, due, \* gateway -> new messages of the open batch; what it will acknowledge
    durable,    \* gateway -> whether the open batch is committed
    spool,      \* gateway -> messages that wait for the cloud
    tx,         \* cloud -> its open transaction
    cache,      \* cloud -> slot -> numbers as the writer remembers them, or None
    writer,     \* slot -> the cloud that wrote it last
    numbers,    \* messages whose numbers are stored; they stay for ever
    rows,       \* messages that are stored
    doubled,    \* messages that were stored once more
    erasure     \* the erasure of the subject

nodeVars == <<boot, made, flash, named>>
netVars == <<sent, acks>>
gatewayVars == <<mem, disk, batch, due, durable>>
storeVars == <<writer, numbers, rows, doubled>>
cloudVars == <<tx, cache, storeVars>>
before == <<nodeVars, netVars, gatewayVars>>
vars == <<before, spool, cloudVars, erasure>>

Idle == [phase |-> "idle", from |-> None, messages |-> {}, locked |-> {},
         new |-> {}, erased |-> FALSE]
Unknown == [s \in AllSlots |-> None]
Fresh == [seen |-> {}, held |-> [n \in Nodes |-> <<0, 0>>]]

Init ==
    /\ boot = [n \in Nodes |-> 1]
    /\ made = IF Loaded THEN Messages ELSE {}
    /\ flash = {} /\ named = {} /\ sent = {} /\ acks = {}
    /\ mem = [g \in Gateways |-> Fresh] /\ disk = mem
    /\ batch = [g \in Gateways |-> {}] /\ due = batch
    /\ spool \in {f \in [Gateways -> SUBSET made] : UNION {f[g] : g \in Gateways} = made}
    /\ durable = [g \in Gateways |-> FALSE]
    /\ tx = [c \in Clouds |-> Idle]
    /\ cache = [c \in Clouds |-> Unknown]
    /\ writer = [s \in AllSlots |-> None]
    /\ numbers = {} /\ rows = {} /\ doubled = {}
    /\ erasure = [known |-> FALSE, passed |-> {}, todo |-> None, done |-> FALSE]

-----------------------------------------------------------------------------
(* Node *)

InFlash(n) == {m \in flash : m[1] = n}
NextNumber(n) == Cardinality({m \in made : m[1] = n /\ m[2] = boot[n]})
Held(n) == Position(CHOOSE m \in InFlash(n) :
    \A other \in InFlash(n) : ~Before(Position(other), Position(m)))

Make(n) == \* a message is committed to flash
    LET m == <<n, boot[n], NextNumber(n)>> IN
    /\ NextNumber(n) < Sequences
    /\ made' = made \union {m} /\ flash' = flash \union {m}
    /\ UNCHANGED <<boot, named, netVars, gatewayVars, spool, cloudVars, erasure>>

Restart(n) == \* numbers begin anew in another boot
    /\ boot[n] < Boots /\ NextNumber(n) > 0
    /\ boot' = [boot EXCEPT ![n] = @ + 1]
    /\ UNCHANGED <<made, flash, named, netVars, gatewayVars, spool, cloudVars, erasure>>

Evict(m) == \* a full flash gives up a message, and a gap names it
    /\ m \in flash /\ Cardinality(named) < MostNamed
    /\ flash' = flash \ {m} /\ named' = named \union {m}
    /\ UNCHANGED <<boot, made, netVars, gatewayVars, spool, cloudVars, erasure>>

Send(m) == \* the envelope states the lowest position that the flash still holds
    /\ m \in flash /\ <<m, Held(m[1])>> \notin sent
    /\ sent' = sent \union {<<m, Held(m[1])>>}
    /\ UNCHANGED <<nodeVars, acks, gatewayVars, spool, cloudVars, erasure>>

Covered(a) == {m \in Messages : m[1] = a[1] /\ m[2] = a[2] /\ m[3] >= a[3] /\ m[3] <= a[4]}

Free(a) == \* an acknowledgement, perhaps an old one, deletes its span from flash
    /\ a \in acks
    /\ Covered(a) \intersect flash # {} /\ flash' = flash \ Covered(a)
    /\ UNCHANGED <<boot, made, named, netVars, gatewayVars, spool, cloudVars, erasure>>

-----------------------------------------------------------------------------
(* Gateway *)

BelowCutOff(state, m) ==
    LET held == state.held[m[1]] IN m[2] = held[1] /\ Before(Position(m), held)
IsDuplicate(state, m) == m \in state.seen \/ BelowCutOff(state, m)

(* Boots below the cut-off are closed up to their last number; what lies below
   the cut-off in its boot needs no range. *)
Released(state, n, held) ==
    IF ~Before(state.held[n], held) THEN state
    ELSE LET old == state.held[n]
             of(b) == {m[3] : m \in {x \in state.seen : x[1] = n /\ x[2] = b}}
                      \union (IF b = old[1] /\ old[2] > 0 THEN {old[2] - 1} ELSE {})
             closed == {m \in Messages : m[1] = n /\ m[2] < held[1] /\ of(m[2]) # {}
                                         /\ m[3] <= Max(of(m[2]))}
             open == {m \in state.seen : ~(m[1] = n /\ m[2] <= held[1]
                                           /\ Before(Position(m), held))}
         IN [seen |-> open \union closed, held |-> [state.held EXCEPT ![n] = held]]

Receive(g, e) == \* validate a message: new, or accepted before
    LET m == e[1]
        new == ~IsDuplicate(mem[g], m)
        added == IF new THEN [mem[g] EXCEPT !.seen = @ \union {m}] ELSE mem[g]
    IN
    /\ e \in sent /\ ~durable[g] /\ m \notin due[g] /\ Cardinality(due[g] \union {m}) <= MostBatch
    /\ batch' = IF new THEN [batch EXCEPT ![g] = @ \union {m}] ELSE batch
    /\ due' = [due EXCEPT ![g] = @ \union {m}]
    /\ mem' = [mem EXCEPT ![g] = Released(added, m[1], e[2])]
    /\ UNCHANGED <<nodeVars, netVars, disk, durable, spool, cloudVars, erasure>>

CommitSpool(g) == \* messages and the state of their nodes become durable together
    /\ due[g] # {} /\ ~durable[g]
    /\ spool' = [spool EXCEPT ![g] = @ \union batch[g]]
    /\ disk' = [disk EXCEPT ![g] = mem[g]]
    /\ durable' = [durable EXCEPT ![g] = TRUE]
    /\ UNCHANGED <<nodeVars, netVars, mem, batch, due, cloudVars, erasure>>

(* Neighbours melt into one span. *)
Spans(S) == {<<m[1], m[2], m[3], l[3]>> : <<m, l>> \in {<<m, l>> \in S \X S :
    /\ m[1] = l[1] /\ m[2] = l[2] /\ m[3] <= l[3]
    /\ \A k \in m[3]..l[3] : <<m[1], m[2], k>> \in S
    /\ <<m[1], m[2], m[3] - 1>> \notin S /\ <<m[1], m[2], l[3] + 1>> \notin S}}

Closed(g) == batch' = [batch EXCEPT ![g] = {}] /\ due' = [due EXCEPT ![g] = {}]

Acknowledge(g) ==
    /\ durable[g]
    /\ acks' = acks \union Spans(due[g])
    /\ Closed(g) /\ durable' = [durable EXCEPT ![g] = FALSE]
    /\ UNCHANGED <<nodeVars, sent, mem, disk, spool, cloudVars, erasure>>

FailCommit(g) == \* nothing of the batch is acknowledged, nor remembered
    /\ due[g] # {} /\ ~durable[g]
    /\ mem' = [mem EXCEPT ![g] = disk[g]]
    /\ Closed(g)
    /\ UNCHANGED <<nodeVars, netVars, disk, durable, spool, cloudVars, erasure>>

GatewayDies(g) == \* others receive; it starts again on its spool
    /\ due[g] # {}
    /\ mem' = [mem EXCEPT ![g] = disk[g]]
    /\ Closed(g) /\ durable' = [durable EXCEPT ![g] = FALSE]
    /\ UNCHANGED <<nodeVars, netVars, disk, spool, cloudVars, erasure>>

ForgetRanges(g) == \* its memory is bounded; then the cloud alone detects duplicates
    /\ due[g] = {} /\ mem[g].seen # {}
    /\ mem' = [mem EXCEPT ![g].seen = {}] /\ disk' = [disk EXCEPT ![g].seen = {}]
    /\ UNCHANGED <<nodeVars, netVars, batch, due, durable, spool, cloudVars, erasure>>

-----------------------------------------------------------------------------
(* Cloud *)

Needed(c) == {SlotOf(m[1]) : m \in tx[c].messages} \ tx[c].locked
NextLock(c) == Min(Needed(c))
Unlocked(s) == \A c \in Clouds : s \notin tx[c].locked

Post(g, c, M) == \* an upload, perhaps while an earlier one of it is still under way
    /\ tx[c] = Idle /\ M # {} /\ M \subseteq spool[g] /\ Cardinality(M) <= MostBatch
    /\ tx' = [tx EXCEPT ![c] = [Idle EXCEPT !.phase = "locking", !.from = g, !.messages = M]]
    /\ UNCHANGED <<before, spool, cache, storeVars, erasure>>

LockSlot(c) == \* in ascending order, until the end of the transaction
    /\ tx[c].phase = "locking" /\ Needed(c) # {}
    /\ Unlocked(NextLock(c))
    /\ tx' = [tx EXCEPT ![c].locked = @ \union {NextLock(c)}]
    /\ UNCHANGED <<before, spool, cache, storeVars, erasure>>

ReadNumbers(c) == \* what is remembered of a slot is good if nobody else wrote since
    /\ tx[c].phase = "locking" /\ Needed(c) = {}
    /\ tx' = [tx EXCEPT ![c].phase = "read"]
    /\ cache' = [cache EXCEPT ![c] = [s \in AllSlots |->
          IF s \notin tx[c].locked THEN @[s]
          ELSE IF writer[s] # c \/ @[s] = None THEN {m \in numbers : InSlot(m, s)}
          ELSE @[s]]]
    /\ UNCHANGED <<before, spool, storeVars, erasure>>

New(c) == {m \in tx[c].messages : m \notin cache[c][SlotOf(m[1])]}

Insert(c) == \* what is new, but for what is erased; the cache knows it before the commit
    /\ tx[c].phase = "read"
    /\ tx' = [tx EXCEPT ![c].phase = "inserted", ![c].new = New(c), ![c].erased = erasure.known]
    /\ cache' = [cache EXCEPT ![c] = [s \in AllSlots |->
          IF s \in tx[c].locked THEN @[s] \union {m \in New(c) : InSlot(m, s)} ELSE @[s]]]
    /\ UNCHANGED <<before, spool, storeVars, erasure>>

CommitStore(c) == \* numbers are kept also of what is erased
    /\ tx[c].phase = "inserted"
    /\ tx' = [tx EXCEPT ![c] =
          [Idle EXCEPT !.phase = "committed", !.from = tx[c].from, !.messages = tx[c].messages]]
    /\ numbers' = numbers \union tx[c].new
    /\ doubled' = doubled \union (tx[c].new \intersect numbers)
    /\ rows' = rows \union {m \in tx[c].new : ~(tx[c].erased /\ m[1] \in Worn)}
    /\ writer' = [s \in AllSlots |->
          IF \E m \in tx[c].new : InSlot(m, s) THEN c ELSE writer[s]]
    /\ UNCHANGED <<before, spool, cache, erasure>>

Settle(c) == \* the gateway hears the answer, and deletes what it posted
    /\ tx[c].phase = "committed"
    /\ spool' = [spool EXCEPT ![tx[c].from] = @ \ tx[c].messages]
    /\ tx' = [tx EXCEPT ![c] = Idle]
    /\ UNCHANGED <<before, cache, storeVars, erasure>>

LoseAnswer(c) == \* a timeout, a cut cable, a gateway that died
    /\ tx[c].phase = "committed"
    /\ tx' = [tx EXCEPT ![c] = Idle]
    /\ UNCHANGED <<before, spool, cache, storeVars, erasure>>

RollBack(c) == \* a full disk, a timeout, a stuck writer that is ended
    /\ tx[c].phase \in {"locking", "read", "inserted"}
    /\ tx' = [tx EXCEPT ![c] = Idle] /\ cache' = [cache EXCEPT ![c] = Unknown]
    /\ UNCHANGED <<before, spool, storeVars, erasure>>

CloudDies(c) ==
    /\ tx[c] # Idle
    /\ tx' = [tx EXCEPT ![c] = Idle] /\ cache' = [cache EXCEPT ![c] = Unknown]
    /\ UNCHANGED <<before, spool, storeVars, erasure>>

-----------------------------------------------------------------------------
(* Erasure *)

OnlyErasure == UNCHANGED <<before, spool, tx, cache, writer, numbers, doubled>>

NoteErasure == \* a row of the subjects that are erased
    /\ ~erasure.known /\ Worn # {}
    /\ erasure' = [erasure EXCEPT !.known = TRUE]
    /\ OnlyErasure /\ UNCHANGED rows

PassBarrier(s) == \* lock a slot and let it go: who had not read of the erasure is done then
    /\ erasure.known /\ s \notin erasure.passed /\ Unlocked(s)
    /\ erasure' = [erasure EXCEPT !.passed = @ \union {s}]
    /\ OnlyErasure /\ UNCHANGED rows

ListErased == \* without a lock
    /\ erasure.known /\ erasure.passed = AllSlots /\ erasure.todo = None
    /\ erasure' = [erasure EXCEPT !.todo = {n \in Worn : \E m \in rows : m[1] = n}]
    /\ OnlyErasure /\ UNCHANGED rows

DeleteErased(n) == \* the numbers stay: what is sent again is a duplicate
    /\ erasure.todo # None /\ n \in erasure.todo /\ Unlocked(SlotOf(n))
    /\ rows' = {m \in rows : m[1] # n}
    /\ erasure' = [erasure EXCEPT !.todo = @ \ {n}]
    /\ OnlyErasure

FinishErasure == \* the outcome in the audit log
    /\ erasure.todo = {} /\ ~erasure.done
    /\ erasure' = [erasure EXCEPT !.done = TRUE]
    /\ OnlyErasure /\ UNCHANGED rows

EraserDies == \* another cloud begins anew
    /\ erasure.passed # {} /\ ~erasure.done
    /\ erasure' = [erasure EXCEPT !.passed = {}, !.todo = None]
    /\ OnlyErasure /\ UNCHANGED rows

-----------------------------------------------------------------------------
InTheCloud ==
    \/ \E c \in Clouds :
          \/ LockSlot(c) \/ ReadNumbers(c) \/ Insert(c) \/ CommitStore(c)
          \/ Settle(c) \/ LoseAnswer(c) \/ RollBack(c) \/ CloudDies(c)
    \/ NoteErasure \/ ListErased \/ FinishErasure \/ EraserDies
    \/ \E s \in AllSlots : PassBarrier(s)
    \/ \E n \in Nodes : DeleteErased(n)

BeforeTheCloud ==
    \/ \E n \in Nodes : Make(n) \/ Restart(n)
    \/ \E m \in flash : Evict(m) \/ Send(m)
    \/ \E a \in acks : Free(a)
    \/ \E g \in Gateways :
          \/ \E e \in sent : Receive(g, e)
          \/ CommitSpool(g) \/ Acknowledge(g) \/ FailCommit(g) \/ GatewayDies(g) \/ ForgetRanges(g)
          \/ \E c \in Clouds : \E M \in SUBSET spool[g] : Post(g, c, M)

Next == InTheCloud \/ ((Whole => \A c \in Clouds : tx[c] = Idle) /\ BeforeTheCloud)

(* However often parts die, they come again, and what can happen again and again happens. *)
Fairness ==
    /\ \A m \in Messages :
          /\ WF_vars(\E a \in acks : m \in Covered(a) /\ Free(a))
          /\ WF_vars(m \in flash /\ Send(m))
          /\ SF_vars(\E g \in Gateways : \E e \in sent : e[1] = m /\ Receive(g, e))
          /\ \A g \in Gateways :
                /\ SF_vars(m \in due[g] /\ CommitSpool(g))
                /\ SF_vars(m \in due[g] /\ Acknowledge(g))
                /\ SF_vars(\E c \in Clouds : \E M \in SUBSET spool[g] : m \in M /\ Post(g, c, M))
          /\ \A c \in Clouds : SF_vars(m \in tx[c].messages /\ CommitStore(c))
    /\ \A c \in Clouds :
          SF_vars(LockSlot(c)) /\ SF_vars(ReadNumbers(c)) /\ SF_vars(Insert(c))
          /\ WF_vars(Settle(c))
    /\ \A s \in AllSlots : SF_vars(PassBarrier(s))
    /\ \A n \in Nodes : SF_vars(DeleteErased(n))
    /\ SF_vars(ListErased) /\ SF_vars(FinishErasure)

Spec == Init /\ [][Next]_vars
FairSpec == Spec /\ Fairness
Symmetry == Permutations(Gateways) \union Permutations(Clouds)

-----------------------------------------------------------------------------
(* Law 2: acknowledge only what is durable *)

Spooled == UNION {spool[g] : g \in Gateways}
Kept == Spooled \union numbers \union named

AcknowledgedIsDurable == \A a \in acks : Covered(a) \subseteq Kept
AnsweredIsStored == \A c \in Clouds : tx[c].phase = "committed" => tx[c].messages \subseteq numbers
NothingIsLost == made \subseteq flash \union Kept
NumberedIsStored == \A m \in numbers : m \in rows \/ (m[1] \in Worn /\ erasure.known)

(* Law 3: once *)

Once == doubled = {}
CutOffIsTrue == \A g \in Gateways : \A m \in flash : ~BelowCutOff(mem[g], m)
CacheIsTrue == \A c \in Clouds : tx[c].phase = "read" =>
    \A s \in tx[c].locked : cache[c][s] = {m \in numbers : InSlot(m, s)}

(* Slots and erasure *)

LocksExclude == \A c, d \in Clouds : c # d => tx[c].locked \intersect tx[d].locked = {}
WaitsFor(c, d) == c # d /\ tx[c].phase = "locking" /\ Needed(c) # {}
                  /\ NextLock(c) \in tx[d].locked
NoDeadlock == \A c, d \in Clouds : ~(WaitsFor(c, d) /\ WaitsFor(d, c))
ErasedIsGone == erasure.done => \A m \in rows : m[1] \notin Worn

StoredAtLast == \A m \in Messages : m \in flash ~> m \in numbers \union named
FreedAtLast == \A m \in Messages : m \in flash ~> m \notin flash
ErasedAtLast == \* an eraser that dies again and again begins again and again
    <>[][~EraserDies]_vars => (erasure.known ~> erasure.done)
=============================================================================
