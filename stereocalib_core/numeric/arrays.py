"""Names of the arrays that are everywhere; shapes and units stand where they are used."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Grey = NDArray[np.uint8]
"""(H, W) grey levels 0...255."""
Mask = NDArray[np.bool_]
