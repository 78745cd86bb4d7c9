"""Mutants of the model: each breaks one guard, and names what must find it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class Mutant:
    """The model with one guard broken.

    Attributes:
        name: What is wrong with it.
        bounds: Name of the bounds within which it is found.
        broken: The invariant that finds it, or ``liveness``.
        changes: Texts of the module and what replaces them.
    """

    name: str
    bounds: str
    broken: str
    changes: tuple[tuple[str, str], ...]

    def apply(self, text: str) -> str:
        """Break a module.

        Raises:
            ValueError: A text does not occur exactly once.
        """
        for before, after in self.changes:
            if text.count(before) != 1:
                raise ValueError(f"{self.name}: occurs {text.count(before)} times: {before}")
            text = text.replace(before, after)
        return text


_ACKNOWLEDGE: Final = "    /\\ durable[g]\n    /\\ acks'"
_LOCK: Final = "    /\\ Unlocked(NextLock(c))\n"
_BARRIER: Final = "/\\ s \\notin erasure.passed /\\ Unlocked(s)"
_LOOK: Final = "![c].new = New(c), ![c].erased = erasure.known]"
_POSTED: Final = "!.from = g, !.messages = M]]"
_ROLLED_BACK: Final = """RollBack(c) == \\* a full disk, a timeout, a stuck writer that is ended
    /\\ tx[c].phase \\in {"locking", "read", "inserted"}
    /\\ tx' = [tx EXCEPT ![c] = Idle] /\\ cache' = [cache EXCEPT ![c] = Unknown]"""
_FAILED: Final = """    /\\ due[g] # {} /\\ ~durable[g]
    /\\ mem' = [mem EXCEPT ![g] = disk[g]]"""

MUTANTS: Final = (
    Mutant(
        "gateway acknowledges before the commit",
        "gateways",
        "AcknowledgedIsDurable",
        ((_ACKNOWLEDGE, "    /\\ due[g] # {}\n    /\\ acks'"),),
    ),
    Mutant(
        "acknowledged span ends one too high",
        "gateways",
        "AcknowledgedIsDurable",
        (("{<<m[1], m[2], m[3], l[3]>> :", "{<<m[1], m[2], m[3], l[3] + 1>> :"),),
    ),
    Mutant(
        "cut-off is one too high",
        "gateways",
        "CutOffIsTrue",
        (
            (
                "sent' = sent \\union {<<m, Held(m[1])>>}",
                "sent' = sent \\union {<<m, <<Held(m[1])[1], Held(m[1])[2] + 1>>>>}",
            ),
        ),
    ),
    Mutant(
        "gateway remembers what it failed to commit",
        "gateways",
        "AcknowledgedIsDurable",
        ((_FAILED, _FAILED.replace("mem' = [mem EXCEPT ![g] = disk[g]]", "UNCHANGED mem")),),
    ),
    Mutant(
        "gateway deletes more than it posted",
        "slots",
        "NothingIsLost",
        (("= @ \\ tx[c].messages]", "= {}]"),),
    ),
    Mutant(
        "flash evicts without a gap",
        "boots",
        "NothingIsLost",
        (("named' = named \\union {m}", "UNCHANGED named"),),
    ),
    Mutant(
        "duplicate is not acknowledged",
        "stored at last",
        "liveness",
        (
            (
                "due' = [due EXCEPT ![g] = @ \\union {m}]",
                "due' = IF new THEN [due EXCEPT ![g] = @ \\union {m}] ELSE due",
            ),
        ),
    ),
    Mutant(
        "cloud answers before the commit",
        "slots",
        "NothingIsLost",
        (
            (
                """hears the answer, and deletes what it posted
    /\\ tx[c].phase = "committed\"""",
                """hears the answer, and deletes what it posted
    /\\ tx[c] # Idle""",
            ),
        ),
    ),
    Mutant("slot is not locked", "slots", "LocksExclude", ((_LOCK, ""),)),
    Mutant(
        "slots are locked in no order",
        "slots",
        "NoDeadlock",
        (
            (
                "NextLock(c) == Min(Needed(c))",
                "NextLock(c) == IF erasure.known THEN Max(Needed(c)) ELSE Min(Needed(c))",
            ),
        ),
    ),
    Mutant(
        "cache is not dropped after another writer",
        "writers",
        "CacheIsTrue",
        (("IF writer[s] # c \\/ @[s] = None THEN", "IF @[s] = None THEN"),),
    ),
    Mutant(
        "cache is not dropped after a rollback",
        "writers",
        "CacheIsTrue",
        (
            (
                _ROLLED_BACK,
                _ROLLED_BACK.replace("cache' = [cache EXCEPT ![c] = Unknown]", "UNCHANGED cache"),
            ),
        ),
    ),
    Mutant(
        "ingest does not look for erased subjects",
        "slots",
        "ErasedIsGone",
        ((_LOOK, "![c].new = New(c)]"),),
    ),
    Mutant(
        "ingest looks for erased subjects before it locks",
        "slots",
        "ErasedIsGone",
        (
            (_LOOK, "![c].new = New(c)]"),
            (_POSTED, "!.from = g, !.messages = M, !.erased = erasure.known]]"),
        ),
    ),
    Mutant(
        "erasure passes no barrier",
        "slots",
        "ErasedIsGone",
        (("/\\ erasure.passed = AllSlots /\\ erasure.todo", "/\\ erasure.todo"),),
    ),
    Mutant(
        "barrier waits for no slot",
        "slots",
        "ErasedIsGone",
        ((_BARRIER, "/\\ s \\notin erasure.passed"),),
    ),
    Mutant(
        "number of an erased message is not kept",
        "slots",
        "AnsweredIsStored",
        (
            (
                "numbers' = numbers \\union tx[c].new",
                "numbers' = numbers \\union {m \\in tx[c].new : ~tx[c].erased}",
            ),
        ),
    ),
)
