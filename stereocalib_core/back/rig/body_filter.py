"""The unscented Kalman filter of a camera on a car's body, one frame at a time.

Per axis (height, pitch, roll) the body swings as a damped oscillator about a rest pose; the rest pose itself
wanders (braking, a curve, load, the mount). State: rest (3), body minus rest (3), velocity (3).

Where the tracks show how the camera moved, springs need not be guessed: over the road that was seen before, the camera
now stands as that motion has carried it, but for what the road itself changes on the way (`carried`).

Neighbouring frames see the same bumps and the same crossfall. The error that they share is no noise that averages out:
the state is the pose with that error in it, its size is added in the end, and what of it changes on the way is noise of
the way.

What a frame measures is the road's plane in disparity space, z = (A, B, C) of eq. 16: there the errors of a fit are
normal, and its covariance is the fit's own. In height, pitch and roll they are not: h = b cos(roll) cos(pitch) / A
leans to large heights, and the more so the unsurer the plane and the lower the camera. So the measurement is
nonlinear in the state, which is what an unscented filter is for.

How lively the body is, and how far the stated covariances can be trusted,
is learnt on the way (`multiple_model`), so that a well measured drive is followed and a badly measured one is
smoothed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from stereocalib_core.back.rig.carried import Moved, carry
from stereocalib_core.back.rig.multiple_model import NoiseBank
from stereocalib_core.back.rig.road_points import Look, lean_on
from stereocalib_core.config import FilterConfig, VehicleConfig
from stereocalib_core.geometry import Extrinsics, StereoCamera
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.light_filterpy import MerweScaledSigmaPoints, UnscentedKalmanFilter

_N = 9
_SEEN = np.hstack([np.eye(3), np.eye(3), np.zeros((3, 3))])
_LOWEST_M = 0.02
"""Below the bumper of any car [m]."""


@dataclass(frozen=True)
class FilterStep:
    """One frame of the filter, and what a look back over it needs.

    values: (3,) height [m], pitch, roll [rad]; covariance: (3, 3). state: `updated`, `predicted` or `none`.
    x, P: (9,), (9, 9) after the frame; F, x_prior, P_prior: the transition into it and the prediction;
    x_before, P_before: the state that this came from, of the frame before, the motion in between known.
    joined: False where the filter began anew, so that nothing may be carried back over it.
    """

    values: Array
    covariance: Array
    state: str
    x: Array
    P: Array
    F: Array
    x_prior: Array
    P_prior: Array
    x_before: Array
    P_before: Array
    joined: bool

    def packed(self) -> Array:
        """(PACKED,) what a look back needs; `unpacked` gives it again."""
        matrices = self.P, self.F, self.P_prior, self.P_before
        return np.concatenate([*(m.ravel() for m in matrices), self.x, self.x_prior, self.x_before])


PACKED = 4 * _N * _N + 3 * _N


class Unpacked(NamedTuple):
    """Of a `FilterStep`."""

    P: Array
    F: Array
    P_prior: Array
    P_before: Array
    x: Array
    x_prior: Array
    x_before: Array


def unpacked(row: Array) -> Unpacked:
    """What `FilterStep.packed` put together, as views."""
    states = row[4 * _N * _N :].reshape(3, _N)
    return Unpacked(*row[: 4 * _N * _N].reshape(4, _N, _N), *states)


def oscillator(frequency_hz: float, damping: float, dt_s: float) -> tuple[Array, Array]:
    """Transition (2, 2) of position and velocity over dt, and the (2, 2) noise that keeps unit variance.

    Exact for x'' = -w^2 x - 2 d w x' + white noise: with stationary P = diag(1, w^2), Q = P - F P F^T.
    """
    w = 2.0 * math.pi * frequency_hz
    decay, wd = damping * w, w * math.sqrt(1.0 - damping**2)
    c, s, e = math.cos(wd * dt_s), math.sin(wd * dt_s), math.exp(-decay * dt_s)
    F = e * np.array([[c + decay / wd * s, s / wd], [-(w**2) / wd * s, c - decay / wd * s]])
    P = np.diag([1.0, w**2])
    return F, P - F @ P @ F.T


class _MatrixUKF(UnscentedKalmanFilter):  # type: ignore[misc]
    """filterpy's filter with all sigma points moved at once; the transition is a matrix and a shift."""

    transition: Array
    shift: Array

    def compute_process_sigmas(self, dt: float, fx: object = None, **fx_args: object) -> None:
        self.sigmas_f = self.points_fn.sigma_points(self.x, self.P) @ self.transition.T + self.shift

    def cross_variance(self, x: Array, z: Array, sigmas_f: Array, sigmas_h: Array) -> Array:
        return np.asarray((sigmas_f - x).T @ (self.Wc[:, None] * (sigmas_h - z)))

    def refresh(self) -> None:
        """Sigma points of the current state: filterpy's own are those before the process noise."""
        self.sigmas_f = self.points_fn.sigma_points(self.x, self.P)


def seen(x: Array) -> Array:
    """(3,) height [m], pitch, roll [rad] of the body's pose in a state (9,)."""
    return np.asarray(x[:3] + x[3:6])


def plane_of(camera: StereoCamera, values: Array) -> Array:
    """(3,) A, B, C of eq. 16 for height, pitch, roll."""
    plane = _extrinsics(values).disparity_plane(camera)
    return np.array([plane.a, plane.b, plane.c_px])


def plane_covariance(camera: StereoCamera, values: Array, covariance: Array) -> Array:
    """(3, 3) of A, B, C from that of height, pitch and roll, by the exact Jacobian."""
    J = _extrinsics(values).disparity_plane_jacobian(camera)
    return np.asarray(J @ covariance @ J.T)


def _extrinsics(values: Array) -> Extrinsics:
    # a sigma point of a low camera may lie below the road
    return Extrinsics(max(float(values[0]), _LOWEST_M), float(values[1]), float(values[2]))


def measured_covariance(P: Array) -> Array:
    """(9, 9) of the state to (3, 3) of height, pitch and roll."""
    return np.asarray(P[:3, :3] + P[3:6, 3:6] + P[:3, 3:6] + P[3:6, :3])


class RigFilter:
    """Height, pitch and roll frame by frame; predicts through frames without a measurement.

    A measurement that no body could make is gated out. A knocked mount makes many of them: after
    `recovery_frames` gated in a row the filter begins anew from the next one.
    """

    def __init__(
        self, camera: StereoCamera, config: FilterConfig | None = None, vehicle: VehicleConfig | None = None
    ) -> None:
        self.camera = camera
        self.config = config or FilterConfig()
        self.vehicle = vehicle or VehicleConfig()
        c = self.config
        self._body = np.array(
            [c.body_height_m, math.radians(c.body_pitch_deg), math.radians(c.body_roll_deg)]
        )
        rest = np.array([c.rest_height_m, math.radians(c.rest_angle_deg), math.radians(c.rest_angle_deg)])
        self._rest_rate = rest**2
        road = np.array([c.road_height_m, math.radians(c.road_pitch_deg), math.radians(c.road_roll_deg)])
        self._road = road * math.sqrt(2.0 / c.alike_m)
        self._least = np.array([c.least_height_m, *np.deg2rad([c.least_angle_deg, c.least_angle_deg])])
        slack = np.array([c.gate_height_m, math.radians(c.gate_angle_deg), math.radians(c.gate_angle_deg)])
        self._slack = np.diag(slack**2)
        self._ukf: _MatrixUKF | None = None
        self._banks: list[NoiseBank] = []
        self._time_s = 0.0
        self._gated = 0
        self._widest = np.zeros(3)
        self._persistent = np.zeros((3, 3))
        self._alike = 1.0
        self._prior = (np.eye(_N), np.zeros(_N), np.eye(_N), np.zeros(_N), np.eye(_N))

    def step(self, timestamp_s: float, *looks: Look, moved: Moved | None = None) -> FilterStep:
        """One frame: height [m], pitch, roll [rad] and their covariance.

        looks: none or NaN where it failed; a second one of the same frame has its say, and where both contradict, the
        prediction says which is the likelier. moved: how the camera came here from the frame before, where it is known.
        """
        look = looks[0] if looks else None
        other = looks[1] if len(looks) > 1 else None
        if look is not None and not (np.isfinite(look.values).all() and np.isfinite(look.covariance).all()):
            look = None
        ukf = self._ukf
        if ukf is None:
            if look is None:
                nan = np.full((_N, _N), np.nan)
                x, P = nan[0], nan
                return FilterStep(x[:3], P[:3, :3], "none", x, P, P, x, P, x, P, False)
            look = look if other is None else lean_on(look, other, None, self._slack, self.config)
            self._persistent, R = self._parted(look.covariance)
            self._ukf = self._start(timestamp_s, look.values, R)
            return self._report(self._ukf, "updated", joined=False)
        dt = min(max(timestamp_s - self._time_s, self.config.shortest_step_s), self.config.longest_step_s)
        self._time_s = timestamp_s
        before = ukf.x.copy(), ukf.P.copy()
        noise = self._predict(ukf, dt, moved)
        if look is None:
            self._learn(dt, np.full(3, np.nan), np.ones(3))
            return self._report(ukf, "predicted")
        if moved is not None and self._surprise(ukf, look) > self.config.gate:
            # no body does that: the motion may have been that of something else
            ukf.x, ukf.P = before
            self._predict(ukf, dt, None)
        if other is not None:
            expected = Look(seen(ukf.x), measured_covariance(ukf.P) + self._persistent)
            look = lean_on(look, other, expected, self._slack, self.config)
        z, (persistent, R) = look.values, self._parted(look.covariance)
        self._learn(dt, z, np.diag(R))
        R = R * np.outer(noise, noise)
        # neighbours that agree say that their own noise is small, and nothing of the error that they share
        least = np.maximum(noise, 1.0)
        self._go_on(ukf, self._as_seen_from(seen(ukf.x), z, persistent * np.outer(least, least)))
        joined = True
        if self._surprise(ukf, Look(z, R)) > self.config.gate:
            self._gated += 1
            if self._gated <= self.config.recovery_frames:
                return self._report(ukf, "predicted")
            joined = False
            self._reopen(ukf, z - seen(ukf.x))
        self._gated = 0
        ukf.update(self._plane(z), R=self._plane_covariance(z, R))
        ukf.P = 0.5 * (ukf.P + ukf.P.T)
        return self._report(ukf, "updated", joined)

    def _parted(self, covariance: Array) -> tuple[Array, Array]:
        """What neighbouring frames share of a look's covariance (3, 3), and the rest."""
        c = self.config
        share = np.array([c.persistent_share, c.persistent_share, c.persistent_roll_share])
        shared, rest = np.sqrt(share), np.sqrt(1.0 - share)
        return np.outer(shared, shared) * covariance, np.outer(rest, rest) * covariance

    def _go_on(self, ukf: _MatrixUKF, persistent: Array) -> None:
        """The error that looks share changes from (3, 3) the last one's to this one's: by how far the car has come,
        and all the more where a look is much surer or much less sure than that before."""
        a, b = np.sqrt(np.diag(self._persistent)), np.sqrt(np.diag(persistent))
        ukf.P[:3, :3] += np.diag(a * a + b * b - 2.0 * self._alike * a * b)
        self._persistent = persistent
        self._prior = (*self._prior[:2], ukf.P.copy(), *self._prior[3:])
        ukf.refresh()

    def _surprise(self, ukf: _MatrixUKF, look: Look) -> float:
        """Squared Mahalanobis distance of a measured plane from the predicted one, what a body may do included."""
        predicted = seen(ukf.x)
        S = self._plane_covariance(predicted, measured_covariance(ukf.P) + self._slack)
        S = S + self._plane_covariance(look.values, look.covariance)
        off = self._plane(look.values) - self._plane(predicted)
        return float(off @ np.linalg.solve(S, off))

    def _start(self, timestamp_s: float, z: Array, R: Array) -> _MatrixUKF:
        points = MerweScaledSigmaPoints(_N, alpha=1.0, beta=2.0, kappa=3.0 - _N)
        ukf = _MatrixUKF(_N, 3, 0.1, self._plane_of_state, None, points)
        ukf.x = np.concatenate([z, np.zeros(6)])
        body = np.diag(self._body**2)
        ukf.P = np.zeros((_N, _N))
        # The sum of rest and body is known; a whisper more than that, because Cholesky wants full rank.
        ukf.P[:3, :3] = R + 1.001 * body
        ukf.P[:3, 3:6] = ukf.P[3:6, :3] = -body
        ukf.P[3:6, 3:6] = body
        ukf.P[6:, 6:] = body * (2.0 * math.pi * self.vehicle.natural_hz) ** 2
        self._time_s = timestamp_s
        self._banks = [
            NoiseBank(
                self.config.noise_bank,
                float(z[k]),
                float(R[k, k]),
                float(body[k, k]),
                float(ukf.P[6 + k, 6 + k]),
            )
            for k in range(3)
        ]
        return ukf

    def _plane_of_state(self, x: Array) -> Array:
        return self._plane(seen(x))

    def _plane(self, values: Array) -> Array:
        return plane_of(self.camera, values)

    def _jacobian(self, values: Array) -> Array:
        return _extrinsics(values).disparity_plane_jacobian(self.camera)

    def _plane_covariance(self, values: Array, covariance: Array) -> Array:
        J = self._jacobian(values)
        return np.asarray(J @ covariance @ J.T)

    def _as_seen_from(self, predicted: Array, values: Array, covariance: Array) -> Array:
        """(3, 3) covariance at `values`, of a plane's errors, as the same errors make it at the prediction.

        At a height that is too large by chance it is too large as well, and seems to change from frame to frame.
        """
        J = np.linalg.solve(self._jacobian(predicted), self._jacobian(values))
        return np.asarray(J @ covariance @ J.T)

    def _predict(self, ukf: _MatrixUKF, dt: float, moved: Moved | None) -> Array:
        """Advance the filter; gives the (3,) factors on the measurement's sigma that were learnt so far."""
        F2, Q2 = oscillator(self.vehicle.natural_hz, self.vehicle.damping, dt)
        noise = np.ones(3)
        F, Q = np.eye(_N), np.zeros((_N, _N))
        for k, bank in enumerate(self._banks):
            body, noise[k] = bank.factors()
            rate = float(self._rest_rate[k]) * dt
            F[3 + k :: 3, 3 + k :: 3] = F2
            Q[3 + k :: 3, 3 + k :: 3] = Q2 * (body * self._body[k]) ** 2
            # The rest pose moves; the body stays where it is until its springs answer.
            Q[k, k] = rate
            Q[3 + k, 3 + k] += rate
            Q[k, 3 + k] = Q[3 + k, k] = -rate
        # where nobody knows how far the car came, it is the same road
        self._alike = 1.0 if moved is None else math.exp(-moved.travel_m / self.config.alike_m)
        ukf.shift = np.zeros(_N)
        if moved is not None:
            F, Q = self._carry(ukf, F, Q, moved)
        x, P = ukf.x.copy(), ukf.P.copy()
        ukf.transition, ukf.Q = F, Q
        ukf.predict(dt)
        ukf.refresh()
        self._prior = (F, ukf.x.copy(), ukf.P.copy(), x, P)
        return noise

    def _carry(self, ukf: _MatrixUKF, F: Array, Q: Array, moved: Moved) -> tuple[Array, Array]:
        """Let the filter hear of a motion; gives the transition and its noise, of which it says most.

        y = seen(now) - G seen(before) = g - G seen(before) + v, with what `carry` says, measures the state before
        (by what the springs would have done) and the noise of the springs, which is correlated with it and so is
        moved into the transition (Bar-Shalom, Li, Kirubarajan 2001, 8.3).
        """
        values = seen(ukf.x)
        expected, G, V = carry(values, moved)
        V = V + np.diag(self._road**2) * moved.travel_m + np.diag(self._least**2)
        H = _SEEN @ F - G @ _SEEN
        y, noise = expected - G @ values, _SEEN @ Q @ _SEEN.T + V
        K = np.linalg.solve(H @ ukf.P @ H.T + noise, H @ ukf.P).T
        ukf.x = ukf.x + K @ (y - H @ ukf.x)
        ukf.P = ukf.P - K @ (H @ ukf.P)
        ukf.P = 0.5 * (ukf.P + ukf.P.T)
        gain = np.linalg.solve(noise, _SEEN @ Q).T
        ukf.shift = gain @ y
        Q = Q - gain @ noise @ gain.T
        return F - gain @ H, 0.5 * (Q + Q.T)

    def _learn(self, dt: float, z: Array, variance: Array) -> None:
        """The banks see a frame: (3,) values, NaN = failed, and their variances."""
        F, forget = np.eye(3), math.exp(-dt / self.config.memory_s)
        F[1:, 1:], Q2 = oscillator(self.vehicle.natural_hz, self.vehicle.damping, dt)
        for k, bank in enumerate(self._banks):
            rate, Q_body = float(self._rest_rate[k]) * dt, Q2 * self._body[k] ** 2
            bank.step(F, rate, Q_body, float(z[k]), float(variance[k]), forget)

    def _reopen(self, ukf: _MatrixUKF, innovation: Array) -> None:
        """Believe that the rest pose has moved by about the innovation."""
        ukf.x[:3] += innovation
        ukf.x[3:] = 0.0
        body = np.diag(self._body**2)
        ukf.P[:] = 0.0
        ukf.P[:3, :3] = 2.0 * body + np.diag(innovation**2)
        ukf.P[3:6, 3:6] = body
        ukf.P[6:, 6:] = body * (2.0 * math.pi * self.vehicle.natural_hz) ** 2
        ukf.refresh()

    def _report(self, ukf: _MatrixUKF, state: str, joined: bool = True) -> FilterStep:
        covariance = measured_covariance(ukf.P) + self._persistent
        sigma = np.sqrt(np.diag(covariance))
        if state == "predicted":
            # A prediction is never surer than the one before it, whatever the phase of the swing.
            scale = np.maximum(self._widest / sigma, 1.0)
            covariance, sigma = covariance * np.outer(scale, scale), sigma * scale
        self._widest = sigma
        return FilterStep(seen(ukf.x), covariance, state, ukf.x.copy(), ukf.P.copy(), *self._prior, joined)

    @property
    def persistent(self) -> Array:
        """(3, 3) the share of the last measurement's covariance that no filter removes."""
        return self._persistent
