"""A classifier of scikit-learn, tuned by cross-validation on the training records."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from sklearn.ensemble import (
    ExtraTreesClassifier,
    HistGradientBoostingClassifier,
    RandomForestClassifier,
)
from sklearn.model_selection import RandomizedSearchCV, StratifiedKFold

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

_SEARCHES: Final[tuple[tuple[Any, dict[str, list[Any]], int], ...]] = (
    (
        HistGradientBoostingClassifier(random_state=0),
        {
            "learning_rate": [0.03, 0.06, 0.1, 0.2],
            "max_iter": [60, 120],
            "max_leaf_nodes": [7, 15, 31],
            "min_samples_leaf": [5, 10, 20],
            "l2_regularization": [0.0, 0.1, 1.0],
        },
        4,
    ),
    (
        RandomForestClassifier(random_state=0),
        {
            "n_estimators": [200],
            "max_features": [0.2, 0.4, 0.7],
            "min_samples_leaf": [1, 2, 4],
            "criterion": ["gini", "entropy"],
        },
        8,
    ),
    (
        ExtraTreesClassifier(random_state=0),
        {
            "n_estimators": [200],
            "max_features": [0.2, 0.4, 0.7, 1.0],
            "min_samples_leaf": [1, 2, 4],
            "criterion": ["gini", "entropy"],
        },
        8,
    ),
)


def fit(rows: NDArray[Any], labels: Sequence[str]) -> tuple[Any, str]:
    """Fit the best of some kinds of ensembles and parameters; gives it, and its name and score."""
    folds = StratifiedKFold(3, shuffle=True, random_state=0)
    found = []
    for model, space, tries in _SEARCHES:
        search = RandomizedSearchCV(model, space, n_iter=tries, cv=folds, random_state=0)
        found.append(search.fit(rows, labels))
    best = max(found, key=lambda search: search.best_score_)
    name = type(best.best_estimator_).__name__
    return best.best_estimator_, f"{name} {best.best_params_}, {best.best_score_:.4f} by folds"
