"""Set-membership identification: what a taxel's own history says of its parameters.

Each sample that certainly holds is a *constraint*: an interval in which a positive parameter lay at
the sample's instant. The parameter drifts, within stated bounds of its rate ``d ln p/dt``; so a
constraint of some age is widened by what the parameter may have drifted since. The widened ones are
intersected, all but some *outliers*: the q-relaxed intersection of N intervals holds each point
that lies in N - q of them at least. So it encloses the parameter as long as no more than q are
wrong. It shrinks with data, and widens with time.

`rest_capacitance` and `stiffness` make constraints of a pad's samples, `SetMembershipEstimator`
collects them, `estimate` does the same for a whole record. `find_wear` compares the parameter with
its data sheet, and `remaining_time` encloses when it leaves its limits. docs/wear.md says what is
identifiable, and on which assumptions all this stands.

Sources: Jaulin, Kieffer, Didrit, Walter, *Applied Interval Analysis*, Springer 2001, chapter 6;
Jaulin, "Robust set-membership state estimation; application to underwater robotics", Automatica 45
(2009), for the q-relaxed intersection.
"""

from __future__ import annotations

from eskin.identification.coverage import independent_coverage, relaxed_coverage
from eskin.identification.estimator import SetMembershipEstimator, estimate
from eskin.identification.pad import rest_capacitance, stiffness
from eskin.identification.relaxed import relaxed_intersection
from eskin.identification.wear import find_wear, mean_drift, remaining_time

__all__ = [
    "SetMembershipEstimator",
    "estimate",
    "find_wear",
    "independent_coverage",
    "mean_drift",
    "relaxed_coverage",
    "relaxed_intersection",
    "remaining_time",
    "rest_capacitance",
    "stiffness",
]
