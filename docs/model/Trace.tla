------------------------------- MODULE Trace --------------------------------
(* Whether what chaos recorded is a behaviour of Delivery. A window is what  *)
(* became of a few messages of one node: events <<what, gateway, boot,       *)
(* sequence>>, in order. Each event is the action that has this effect.      *)
(* Between events are steps that leave no trace, and of them those alone     *)
(* that the next event needs: envelopes and acknowledgements stay in the     *)
(* network, so saying them early permits no more than saying them late.      *)
(* Where no step explains an event, TLC reports a deadlock.                  *)
EXTENDS Delivery, Sequences, Windows

VARIABLES window, at

Log == Windows[window]
What == Log[at][1]
Gateway == Log[at][2]
Message == <<0, Log[at][3], Log[at][4]>>
Cloud == CHOOSE c \in Clouds : TRUE

Seen(step) == step /\ at' = at + 1
Unseen(step) == step /\ at' = at

Unsent == {m \in flash : \A e \in sent : e[1] # m}
Upload(g) == Unseen(Post(g, Cloud, {Message}))

Explain ==
    CASE What = "made" -> IF boot[0] < Message[2] THEN Unseen(Restart(0))
                          ELSE NextNumber(0) = Message[3] /\ Seen(Make(0))
      [] What = "evicted" -> Seen(Evict(Message))
      [] What = "freed" -> \E a \in acks : Message \in Covered(a) /\ Seen(Free(a))
      [] What = "spooled" ->
            IF Message \in batch[Gateway] THEN Seen(CommitSpool(Gateway))
            ELSE \E e \in sent : e[1] = Message /\ Unseen(Receive(Gateway, e))
      [] What = "stored" ->
            IF tx[Cloud] = Idle
            THEN Message \in Spooled /\ Upload(CHOOSE g \in Gateways : Message \in spool[g])
            ELSE Message \in tx[Cloud].new /\ Seen(CommitStore(Cloud))
      [] What = "settled" ->
            /\ Message \in numbers
            /\ IF tx[Cloud] = Idle THEN Upload(Gateway)
               ELSE IF tx[Cloud].phase = "inserted" THEN Unseen(CommitStore(Cloud))
               ELSE Seen(Settle(Cloud))
      [] What = "cut" -> \* the gateway wrote a cut-off, below which the flash holds nothing
            /\ \A m \in flash : ~(m[2] = Message[2] /\ m[3] < Message[3])
            /\ boot[0] = Message[2] => Message[3] <= NextNumber(0)
            /\ Seen(UNCHANGED vars)

Answered == tx[Cloud].phase = "committed"
            /\ ~(What = "settled" /\ tx[Cloud].from = Gateway /\ tx[Cloud].messages = {Message})

TraceNext ==
    /\ window' = window
    /\ IF at > Len(Log) THEN UNCHANGED <<vars, at>>
       ELSE IF Unsent # {} THEN \E m \in Unsent : Unseen(Send(m))
       ELSE IF \E g \in Gateways : durable[g] THEN \E g \in Gateways : Unseen(Acknowledge(g))
       ELSE IF Answered THEN Unseen(LoseAnswer(Cloud))
       ELSE IF tx[Cloud].phase \in {"locking", "read"}
            THEN Unseen(LockSlot(Cloud) \/ ReadNumbers(Cloud) \/ Insert(Cloud))
       ELSE Explain

TraceSpec == Init /\ window \in 1..Len(Windows) /\ at = 1
             /\ [][TraceNext]_<<vars, window, at>>
=============================================================================
