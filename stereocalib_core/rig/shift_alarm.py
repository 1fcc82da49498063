"""Mount shifts."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class MotionSeries:
    """What the car does, one entry a frame, NaN = unknown."""

    timestamps_s: NDArray[np.float64]
    speed: NDArray[np.float64]
    yaw_rate: NDArray[np.float64]
