"""What several experiments draw alike."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from stereocalib_core.numeric.arrays import Array


def histogram(axes: Axes, values: Array, colour: str, label: str) -> None:
    """Histogram as a density with the normal distribution of the same mean and sigma over it."""
    values = values[np.isfinite(values)]
    if len(values) < 2:
        return
    mean, std = float(values.mean()), max(float(values.std()), 1e-9)
    x = np.linspace(mean - 4 * std, mean + 4 * std, 200)
    axes.hist(values, bins=40, density=True, color=colour, alpha=0.35)
    density = np.exp(-0.5 * ((x - mean) / std) ** 2) / (std * np.sqrt(2 * np.pi))
    axes.plot(x, density, color=colour, label=f"{label}: {mean:.4f} ± {std:.4f}")
