"""How lively is the car's body, and how noisy are the measurements? A bank of small filters decides.

Each axis runs a grid of three-state Kalman filters (mount, body, body's velocity) that differ in the size of
the body's motion and in a factor on the stated measurement variance. Their likelihoods, forgotten over some
seconds, weigh the grid; the weighted mean is what the rig filter then assumes (multiple-model adaptive
estimation).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from stereocalib_core.numeric.arrays import Array

BODY_FACTORS = (0.18, 0.35, 0.7, 1.4, 2.8)
"""On the nominal standard deviation of the body's motion."""
NOISE_FACTORS = (0.35, 0.6, 1.0, 1.7, 3.0)
"""On the stated standard deviation of the measurement."""


@njit(cache=True)
def step_bank(
    states: Array,
    covariances: Array,
    scores: Array,
    F: Array,
    Q_mount: float,
    Q_body: Array,
    z: float,
    variance: float,
    body_factors: Array,
    noise_factors: Array,
    forget: float,
) -> None:
    """One frame of one axis, in place. states (B, M, 3), covariances (B, M, 3, 3), scores (B, M) log-weights.

    F: (3, 3) transition. Q_body: (2, 2) for body factor 1. z NaN: predict only.
    """
    for i in range(len(body_factors)):
        for j in range(len(noise_factors)):
            x = F @ states[i, j]
            P = F @ covariances[i, j] @ F.T
            # The rest pose moves, the body stays where it is until its springs answer.
            P[0, 0] += Q_mount
            P[1, 1] += Q_mount
            P[0, 1] -= Q_mount
            P[1, 0] -= Q_mount
            for a in range(2):
                for b in range(2):
                    P[1 + a, 1 + b] += Q_body[a, b] * body_factors[i] ** 2
            if not np.isnan(z):
                R = variance * noise_factors[j] ** 2
                S = P[0, 0] + 2.0 * P[0, 1] + P[1, 1] + R
                nu = z - x[0] - x[1]
                # One wild frame must not rule out a model: beyond six sigma a surprise costs no more.
                surprise = min(nu * nu / S, 36.0)
                scores[i, j] = forget * scores[i, j] - 0.5 * np.log(S) - 0.5 * surprise
                K = (P[:, 0] + P[:, 1]) / S
                x = x + K * nu
                P = P - np.outer(K, K) * S
            states[i, j] = x
            covariances[i, j] = P


class NoiseBank:
    """The grid of one axis; `factors` gives the body and noise factors it believes in."""

    def __init__(self, z: float, variance: float, body_variance: float, velocity_variance: float) -> None:
        self._body = np.array(BODY_FACTORS)
        self._noise = np.array(NOISE_FACTORS)
        shape = (len(self._body), len(self._noise))
        self._states = np.zeros((*shape, 3))
        self._states[..., 0] = z
        self._covariances = np.zeros((*shape, 3, 3))
        self._covariances[..., 0, 0] = variance + body_variance
        self._covariances[..., 1, 1] = body_variance
        self._covariances[..., 2, 2] = velocity_variance
        # The stated values are believed until the data speak: a weak prior about the middle of the grid.
        lb, ln = np.log(self._body / 0.7)[:, None], np.log(self._noise)[None, :]
        self._prior = -0.5 * (lb / 0.8) ** 2 - 0.5 * (ln / 0.35) ** 2
        self._scores = np.zeros(shape)

    def step(self, F: Array, Q_mount: float, Q_body: Array, z: float, variance: float, forget: float) -> None:
        """One frame; `z` NaN predicts only."""
        step_bank(
            self._states,
            self._covariances,
            self._scores,
            F,
            Q_mount,
            Q_body,
            z,
            variance,
            self._body,
            self._noise,
            forget,
        )

    def factors(self) -> tuple[float, float]:
        """Geometric means, weighted by likelihood, of the body and noise factors."""
        log_weights = self._scores + self._prior
        weights = np.exp(log_weights - log_weights.max())
        weights /= weights.sum()
        body = float(np.exp((weights * np.log(self._body)[:, None]).sum()))
        return body, float(np.exp((weights * np.log(self._noise)[None, :]).sum()))
