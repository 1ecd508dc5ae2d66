"""Exact nearest neighbours of many queries at once, where each query weighs the features in its own way.

A k-d tree is of no help here: a query asks for a goal that no clip fulfils, so it lies far from all keys, and in 32
dimensions a tree then visits nearly every leaf, and is slower than comparing with all keys, which is one matrix product.
What saves a part of that: the keys are divided into a few dozen cells, and a cell is left out for the queries that are
farther from its bounding box than from the best key so far. `benchmarks/retrieval_search.py` times all three.
"""

from functools import cached_property

import numpy as np

_CELLS = 32
_SMALLEST_CELL = 1024
"""Keys. In a smaller one, the product would cost less than the visit around it."""


class NearestKeys:
    """Finds the nearest of some keys, with no approximation but float32 arithmetic.

    Args:
        keys: Standardised keys, ``(k, d)``, k at least 1.
    """

    def __init__(self, keys: np.ndarray):
        keys = np.ascontiguousarray(keys, np.float32)
        cells = _divide(keys, max(_SMALLEST_CELL, -(-len(keys) // _CELLS)))
        self._order = np.concatenate(cells)
        self._starts = np.cumsum([0] + [len(cell) for cell in cells])
        self._keys = [keys[cell] for cell in cells]
        self._low = np.stack([part.min(0) for part in self._keys])
        self._high = np.stack([part.max(0) for part in self._keys])
        # |q - k|^2 / 2 = |q|^2 / 2 - (q . k - |k|^2 / 2): the nearest key has the highest score q . k - |k|^2 / 2
        self._score_rows = [np.concatenate([part.T, -0.5 * (part**2).sum(1)[None]]) for part in self._keys]

    @cached_property
    def _weighted_rows(self) -> list[np.ndarray]:
        return [np.concatenate([part.T, -0.5 * (part**2).T]) for part in self._keys]

    def query(self, queries: np.ndarray, weights: np.ndarray | None = None) -> np.ndarray:
        """The key with the smallest distance to each query; of equally near ones any.

        Args:
            queries: Standardised queries, ``(n, d)``.
            weights: Weights w of the metric: the distance is |w (q - k)|, ``(n, d)``; 1 if None.

        Returns:
            Indices of keys, ``(n,)``.
        """
        queries = np.asarray(queries, np.float32)
        if weights is None:
            factors = np.concatenate([queries, np.ones((len(queries), 1), np.float32)], 1)
            constant = (queries**2).sum(1)
            rows = self._score_rows
        else:
            squares = np.asarray(weights, np.float32) ** 2
            factors = np.concatenate([squares * queries, squares], 1)
            constant = (squares * queries**2).sum(1)
            rows = self._weighted_rows
        bounds = 0.5 * (constant[:, None] - self._box_distances(queries, weights))
        best = np.full(len(queries), -np.inf, np.float32)
        found = np.zeros(len(queries), np.int64)

        def visit(cell: int, which: np.ndarray) -> None:
            scores = factors[which] @ rows[cell]
            columns = scores.argmax(1)
            values = scores[np.arange(len(which)), columns]
            better = values > best[which]
            best[which[better]] = values[better]
            found[which[better]] = columns[better] + self._starts[cell]

        # The cell that promises most comes first; what is found there rules most others out.
        first = bounds.argmax(1)
        for cell in np.unique(first):
            visit(cell, np.flatnonzero(first == cell))
        bounds[np.arange(len(queries)), first] = -np.inf
        # Rounding of a bound must not rule out the cell of an equally near key.
        slack = 1e-5 * (1 + np.abs(constant))
        for cell in np.argsort(-bounds.max(0)):
            which = np.flatnonzero(bounds[:, cell] + slack > best)
            if len(which):
                visit(cell, which)
        return self._order[found]

    def _box_distances(self, queries: np.ndarray, weights: np.ndarray | None) -> np.ndarray:
        """Squared distances of the queries to the bounding boxes of the cells, ``(n, cells)``."""
        distances = np.empty((len(queries), len(self._low)), np.float32)
        for cell, (low, high) in enumerate(zip(self._low, self._high, strict=True)):
            outside = np.clip(queries, low, high) - queries
            if weights is not None:
                outside *= weights
            distances[:, cell] = np.einsum("ij,ij->i", outside, outside)
        return distances


def _divide(keys: np.ndarray, largest: int) -> list[np.ndarray]:
    """Halves the keys at the median of the feature that varies most until no part is larger."""
    waiting, cells = [np.arange(len(keys))], []
    while waiting:
        part = waiting.pop()
        if len(part) <= largest:
            cells.append(part)
            continue
        feature = keys[part].var(0).argmax()
        order = part[np.argsort(keys[part, feature], kind="stable")]
        waiting += [order[: len(order) // 2], order[len(order) // 2 :]]
    return cells
