"""How lively is the car's body, and how noisy are the measurements? A bank of small filters decides.

Each axis runs a grid of three-state Kalman filters (mount, body, body's velocity) that differ in the size of
the body's motion and in a factor on the stated measurement variance. Their likelihoods, forgotten over some
seconds, weigh the grid; the weighted mean is what the rig filter then assumes (multiple-model adaptive
estimation).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from stereocalib_core.config.back import NoiseBankConfig
from stereocalib_core.numeric.arrays import Array


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
    most: float,
) -> None:
    """One frame of one axis, in place. states (B, M, 3), covariances (B, M, 3, 3), scores (B, M) log-weights.

    F: (3, 3) transition. Q_body: (2, 2) for body factor 1. z NaN: predict only. most: largest surprise.
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
                # One wild frame must not rule out a model: beyond `most` a surprise costs no more.
                surprise = min(nu * nu / S, most)
                scores[i, j] = forget * scores[i, j] - 0.5 * np.log(S) - 0.5 * surprise
                K = (P[:, 0] + P[:, 1]) / S
                x = x + K * nu
                P = P - np.outer(K, K) * S
            states[i, j] = x
            covariances[i, j] = P


class NoiseBank:
    """The grid of one axis; `factors` gives the body and noise factors it believes in."""

    def __init__(
        self,
        config: NoiseBankConfig,
        z: float,
        variance: float,
        body_variance: float,
        velocity_variance: float,
    ) -> None:
        self._most = config.surprise
        self._body = np.array(config.body_factors)
        self._noise = np.array(config.noise_factors)
        shape = (len(self._body), len(self._noise))
        self._states = np.zeros((*shape, 3))
        self._states[..., 0] = z
        self._covariances = np.zeros((*shape, 3, 3))
        self._covariances[..., 0, 0] = variance + body_variance
        self._covariances[..., 1, 1] = body_variance
        self._covariances[..., 2, 2] = velocity_variance
        # The stated values are believed until the data speak: a weak prior about the middle of the grid.
        lb, ln = np.log(self._body / config.body_middle)[:, None], np.log(self._noise)[None, :]
        self._prior = -0.5 * (lb / config.body_prior) ** 2 - 0.5 * (ln / config.noise_prior) ** 2
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
            self._most,
        )

    def factors(self) -> tuple[float, float]:
        """Geometric means, weighted by likelihood, of the body and noise factors."""
        log_weights = self._scores + self._prior
        weights = np.exp(log_weights - log_weights.max())
        weights /= weights.sum()
        body = float(np.exp((weights * np.log(self._body)[:, None]).sum()))
        return body, float(np.exp((weights * np.log(self._noise)[None, :]).sum()))
