"""From noisy samples of one vehicle to where it was, how fast, and how exactly that is known."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["roughness", "smoothed"]

_Values = NDArray[np.float64]


def roughness(times: _Values, values: _Values) -> float:
    """Return the standard deviation of the noise in samples of something smooth, from its third differences."""
    if len(times) < 5:
        return 0.0
    third = np.diff(values, n=3) / np.sqrt(20.0)  # 1, 3, 3, 1 squared add up to 20
    return float(np.median(np.abs(third)) / 0.6745)


def smoothed(times: _Values, station: _Values, speed: _Values | None, accuracy: float) -> tuple[_Values, _Values, _Values | None]:
    """Return stations [m], speeds [m/s] and spread [m] of one vehicle, each of shape ``(samples,)``.

    Args:
        times: of the samples, increasing [s].
        station: measured [m].
        speed: measured [m/s]; None where nobody measured it: it is then worked out from the stations.
        accuracy: standard deviation of a station [m]; 0 leaves the stations as they are, and their spread None.
    """
    fast = np.gradient(station, times) if speed is None else speed
    return station, fast, None if accuracy <= 0.0 else np.full(len(times), 3.0 * accuracy)
