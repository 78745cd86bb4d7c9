"""Monitors: formulas of signal temporal logic with three verdicts, over tubes."""

from __future__ import annotations

from eskin.errors import MonitorError
from eskin.monitor.checks import Exactness, Horizon, check, horizon, is_exact
from eskin.monitor.evaluation import evaluate
from eskin.monitor.formula import (
    Absolute,
    Add,
    Always,
    And,
    Atom,
    Channel,
    Comparison,
    Constant,
    Count,
    Deviation,
    Divide,
    Eventually,
    Expression,
    Fall,
    Formula,
    Historically,
    Implies,
    Maximum,
    Minimum,
    Multiply,
    Negate,
    Not,
    Once,
    Or,
    Rise,
    Since,
    Subtract,
    Until,
    channel,
)
from eskin.monitor.online import Monitor
from eskin.monitor.parser import parse
from eskin.monitor.prediction import Prediction, PredictionParameter
from eskin.monitor.shared import SharedError
from eskin.monitor.signal import Signal
from eskin.monitor.verdicts import Because, Piece, Verdicts

__all__ = [
    "Absolute",
    "Add",
    "Always",
    "And",
    "Atom",
    "Because",
    "Channel",
    "Comparison",
    "Constant",
    "Count",
    "Deviation",
    "Divide",
    "Eventually",
    "Exactness",
    "Expression",
    "Fall",
    "Formula",
    "Historically",
    "Horizon",
    "Implies",
    "Maximum",
    "Minimum",
    "Monitor",
    "MonitorError",
    "Multiply",
    "Negate",
    "Not",
    "Once",
    "Or",
    "Piece",
    "Prediction",
    "PredictionParameter",
    "Rise",
    "SharedError",
    "Signal",
    "Since",
    "Subtract",
    "Until",
    "Verdicts",
    "channel",
    "check",
    "evaluate",
    "horizon",
    "is_exact",
    "parse",
]
