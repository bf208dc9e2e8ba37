"""The damped normal equations of a least-squares problem whose errors depend only on neighbouring unknowns.

The last bits of the results of numpy's solvers depend on the number of threads, but runs have to be bit-identical.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

BAND = 5
"""Number of unknowns on which the errors of a row depend: the unknown of the row and two on either side."""


def normal_bands(slopes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the bands of the normal matrix: entry (k, k + m) at ``[m, k]``, shape ``(BAND, unknowns)``.

    `slopes` are the derivatives of the errors of every row by the unknowns of its band, shape ``(unknowns, errors, BAND)``.
    """
    count, half = len(slopes), BAND // 2
    products = np.einsum("nca,ncb->nab", slopes, slopes)
    padded = np.zeros((BAND, count + 2 * half))
    for a in range(BAND):
        for b in range(a, BAND):
            padded[b - a, a : a + count] += products[:, a, b]
    return padded[:, half : half + count]


def pull(slopes: NDArray[np.float64], errors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the derivatives of half the sum of the squared errors ``(unknowns, errors)`` by every unknown."""
    count, half = len(slopes), BAND // 2
    padded = np.zeros(count + 2 * half)
    for a in range(BAND):
        padded[a : a + count] += (slopes[:, :, a] * errors).sum(axis=1)
    return padded[half : half + count]


def solved(bands: NDArray[np.float64], damping: float, right: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the solution of the damped normal equations, by elimination within their bands."""
    count = len(right)
    rows = [list(row) for row in zip(*bands.tolist(), strict=True)]
    x = right.tolist() + [0.0] * (BAND - 1)
    for k in range(count):
        row = rows[k]
        row[0] += damping
        for m in range(1, BAND):
            if row[m]:
                share, below = row[m] / row[0], rows[k + m]
                for q in range(m, BAND):
                    below[q - m] -= share * row[q]
                x[k + m] -= share * x[k]
    for k in range(count - 1, -1, -1):
        row = rows[k]
        x[k] = (x[k] - sum(row[m] * x[k + m] for m in range(1, BAND))) / row[0]
    return np.array(x[:count])
