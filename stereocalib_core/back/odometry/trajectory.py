"""The path of a whole drive from its tracks, its extrinsics and the settings of one variant; no pixel.

`trajectory` is the function behind every slider. The settings act on the extrinsics after any filter: each
axis is scaled by its strength (0 = taken as zero; height: the drive's median), then the injected error is
added. The models:

- `full` (default): six degrees of freedom. The depth of a road point is the road's by eq. 16, fused with its measured
  disparity by their covariances (`road_depth`); points above the road bring rotation.
- `planar`: the paper's, eq. 13-16: road points lie on the plane of the extrinsics exactly as given.
- `nonholonomic`: planar, held to a rear axle that does not slip sideways; here yaw and lever arm count.
- `stereo_only`: all points by their measured disparities; no road and no extrinsics. To compare with.

All variants of a model share tracks, weights and solver and differ in the extrinsics alone. Where a pair shows no
road its motion is taken from the disparities, so that the path goes on, and `measured` says that it is a gap.
Under `full` and `planar` the path of the camera itself does not depend on yaw at all.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numba import njit
from numpy.typing import NDArray

from stereocalib_core.back.odometry.packing import PackedTracks
from stereocalib_core.back.odometry.planar_motion import solve_planar
from stereocalib_core.back.odometry.road_depth import with_floors
from stereocalib_core.config import VehicleConfig
from stereocalib_core.config.vehicle import USUAL_HEIGHT_M
from stereocalib_core.errors import ConfigError
from stereocalib_core.geometry import road_rotation
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.chunks import in_chunks
from stereocalib_core.numeric.small_algebra import rotation_from_vector, vector_from_rotation
from stereocalib_core.numeric.spill import put_away

Model = Literal["full", "planar", "nonholonomic", "stereo_only"]
MODELS: tuple[str, ...] = get_args(Model)


@dataclass(frozen=True)
class TrajectorySettings:
    """What one variant does to the extrinsics, and how the car may move.

    *_strength: 0 ... 1, how much of the estimate is used. *_error_*: added to every frame after that.
    lever_arm_m: rear axle to camera, for `nonholonomic`.
    """

    model: Model = "full"
    yaw_strength: float = 1.0
    pitch_strength: float = 1.0
    roll_strength: float = 1.0
    height_strength: float = 1.0
    yaw_error_rad: float = 0.0
    pitch_error_rad: float = 0.0
    roll_error_rad: float = 0.0
    height_error_m: float = 0.0
    lever_arm_m: float = VehicleConfig().lever_arm_m

    def __post_init__(self) -> None:
        for axis in ("yaw", "pitch", "roll", "height"):
            strength = getattr(self, f"{axis}_strength")
            if not 0.0 <= strength <= 1.0:
                raise ConfigError(
                    f"{axis} strength {strength:g}", "trajectory settings", "give a value from 0 to 1"
                )
        if self.model not in MODELS:
            raise ConfigError(
                f"motion model {self.model}", "trajectory settings", "one of " + ", ".join(MODELS)
            )


VARIANTS: dict[str, TrajectorySettings] = {
    "autocalibrated": TrajectorySettings(),
    "no_yaw": TrajectorySettings(yaw_strength=0.0),
    "no_roll": TrajectorySettings(roll_strength=0.0),
    "no_pitch_no_roll": TrajectorySettings(pitch_strength=0.0, roll_strength=0.0),
}
"""The variants of the paper's Table 1."""


@dataclass(frozen=True)
class Trajectory:
    """The path of the left camera.

    poses: (N, 4, 4) T_world_camera, world = first left camera.
    covariance: (N, 6, 6) of each pair's motion given the extrinsics: rotation [rad], translation [m] in the
        axes of this frame's camera; zero where nothing was measured.
    planar: (N, 3) x, z [m], heading [rad] of each pair in the road frame of its previous frame.
    planar_covariance: (N, 3, 3) of `planar`.
    measured: (N,) False where the motion is a prediction or rests on no road; frame 0 is True. Under `stereo_only`
        only predictions are False.
    tracked: (N,) whether the motion into a frame was seen by tracks, on a road or not.
    """

    poses: Array
    covariance: Array
    planar: Array
    planar_covariance: Array
    measured: NDArray[np.bool_]
    tracked: NDArray[np.bool_]

    @property
    def measured_share(self) -> float:
        """Which part of the way was measured, 0 ... 1; by frames where nothing of the way is known."""
        if len(self.poses) < 2:
            return 1.0
        # a frame counts a little by itself, so that standing is a way as well
        way = np.linalg.norm(np.diff(self.poses[:, :3, 3], axis=0), axis=1) + 0.01
        return float((way * self.measured[1:]).sum() / way.sum())

    @property
    def gaps(self) -> tuple[tuple[int, int], ...]:
        """First and last frame of every stretch that was not measured on the road."""
        missing = np.flatnonzero(np.diff(np.concatenate([[True], self.measured, [True]]).astype(int)))
        return tuple((int(first), int(last) - 1) for first, last in missing.reshape(-1, 2))

    @property
    def path_m(self) -> float:
        """Length of the path [m]."""
        return float(np.linalg.norm(np.diff(self.poses[:, :3, 3], axis=0), axis=1).sum())


def fill_missing(extrinsics: Array) -> Array:
    """(N, 4) with every row that holds a NaN replaced by the last whole row, at the start by the first."""
    known = np.asarray(np.isfinite(extrinsics).all(axis=1), dtype=np.bool_)
    if not known.any():
        return np.tile([USUAL_HEIGHT_M, 0.0, 0.0, 0.0], (len(extrinsics), 1))
    last = np.maximum.accumulate(np.where(known, np.arange(len(known)), -1))
    return np.asarray(extrinsics[np.where(last < 0, np.argmax(known), last)], dtype=np.float64)


def apply_settings(extrinsics: Array, settings: TrajectorySettings) -> Array:
    """(N, 4) height [m], pitch, roll, yaw [rad] as a variant sees them."""
    s = settings
    median = float(np.median(extrinsics[:, 0])) if len(extrinsics) else 0.0
    # in this form a strength of one changes no bit, and the best motions need no second solution
    height = extrinsics[:, 0] + (s.height_strength - 1.0) * (extrinsics[:, 0] - median) + s.height_error_m
    angles = extrinsics[:, 1:] * [s.pitch_strength, s.roll_strength, s.yaw_strength]
    angles = angles + [s.pitch_error_rad, s.roll_error_rad, s.yaw_error_rad]
    return np.column_stack([np.maximum(height, 0.05), angles])


def trajectory(
    tracks: PackedTracks, extrinsics: Array, settings: TrajectorySettings, sigma: Array | None = None
) -> Trajectory:
    """The whole drive under one variant.

    extrinsics: (N, 4) height [m], pitch, roll, yaw [rad] of every frame, raw or filtered; NaN = unknown.
    sigma: (N, 3) of height, pitch, roll; None: as sure as the road is even.
    """
    if np.shape(extrinsics) != (len(tracks), 4):
        raise ConfigError(
            f"extrinsics of shape {np.shape(extrinsics)}", "trajectory", f"give ({len(tracks)}, 4)"
        )
    if settings.model == "stereo_only":
        return _stereo_only(tracks)
    known = np.asarray(np.isfinite(extrinsics).all(axis=1), dtype=np.bool_)
    given = fill_missing(np.asarray(extrinsics, dtype=np.float64))
    used = apply_settings(given, settings)
    rotations = road_rotation(used[:, 1], used[:, 2])
    has_pair = tracks.previous >= 0
    origin = np.maximum(tracks.previous, 0)
    road = has_pair & (tracks.road_end - tracks.start[:-1] >= tracks.config.min_road_points)
    road &= tracks.road_ok & tracks.road_ok[origin] & known & known[origin]
    moving = has_pair & ~tracks.still
    if settings.model == "full":
        surely = with_floors(sigma, len(tracks), tracks.config)
        motions, motion_covariance = tracks.full_motion(road, used, given, surely)
        planar = _planar_of(motions, rotations, origin)
        planar_covariance = _planar_covariance(motion_covariance, motions, rotations, origin)
    else:
        lever = settings.lever_arm_m if settings.model == "nonholonomic" else float("nan")
        planar, planar_covariance, solved = _planar(tracks, used, rotations, road & moving, lever)
        motions = _motions_of(planar, used, rotations, origin)
        motions[:, 6] = solved
        rest = moving & ~solved.astype(bool)
        motions[rest] = tracks.stereo_motion[rest]
        planar[rest] = _planar_of(motions, rotations, origin)[rest]
        motion_covariance = _covariance_of(planar_covariance, rotations, origin)
    planar[tracks.still] = 0.0
    return _path(tracks, motions, motion_covariance, planar, planar_covariance, road)


def _stereo_only(tracks: PackedTracks) -> Trajectory:
    """The path by measured disparities; `planar` is in the camera's own axes, for there is no road."""
    level = np.tile(np.eye(3), (len(tracks), 1, 1))
    origin, motions = np.maximum(tracks.previous, 0), tracks.stereo_motion.copy()
    planar = _planar_of(motions, level, origin)
    planar[tracks.still] = 0.0
    planar_covariance = _planar_covariance(tracks.stereo_covariance, motions, level, origin)
    everywhere = tracks.previous >= 0
    return _path(tracks, motions, tracks.stereo_covariance, planar, planar_covariance, everywhere)


def _path(
    tracks: PackedTracks,
    motions: Array,
    covariance: Array,
    planar: Array,
    planar_covariance: Array,
    shown: NDArray[np.bool_],
) -> Trajectory:
    """The motions (N, 7) of all pairs, one after the other; shown: (N,) pairs that show what their model rests on."""
    has_pair = tracks.previous >= 0
    motions[tracks.still] = [0, 0, 0, 0, 0, 0, 1]
    poses, bridged = _chain(motions, tracks.previous)
    tracked = has_pair & (motions[:, 6] > 0)
    measured = (shown | (tracks.still & has_pair)) & tracked & ~bridged
    measured[:1] = True
    # of a long drive there are a dozen paths: none of them is worked on before all are there
    return Trajectory(
        put_away(poses), put_away(covariance), planar, put_away(planar_covariance), measured, tracked
    )


def _planar(
    tracks: PackedTracks, used: Array, rotations: Array, active: NDArray[np.bool_], lever: float
) -> tuple[Array, Array, Array]:
    """(N, 3) planar motion, (N, 3, 3) covariance and (N,) whether solved."""
    initial = _planar_of(tracks.stereo_motion, rotations, np.maximum(tracks.previous, 0))
    count = len(tracks)
    motions, covariance = np.zeros((count, 4)), np.zeros((count, 3, 3))
    in_chunks(
        solve_planar, count,
        tracks.rays, tracks.start, tracks.road_end, tracks.previous, active, used, initial, lever,
        tracks.camera.focal_px, tracks.config.solver.cauchy_px, tracks.config.solver.iterations, motions, covariance,
    )  # fmt: skip
    return motions[:, :3].copy(), covariance, motions[:, 3].copy()


@njit(cache=True, nogil=True)
def _planar_of(motions: Array, rotations: Array, origin: NDArray[np.int64]) -> Array:
    """(N, 3) x, z, heading in the previous road frame of (N, 7) camera motions."""
    result = np.zeros((len(motions), 3))
    for i in range(len(motions)):
        R = rotation_from_vector(motions[i, :3])
        to_road = np.ascontiguousarray(rotations[origin[i]].T)
        shift = -(to_road @ (np.ascontiguousarray(R.T) @ np.ascontiguousarray(motions[i, 3:6])))
        turn = to_road @ np.ascontiguousarray(R.T) @ rotations[i]
        result[i, 0] = shift[0]
        result[i, 1] = shift[2]
        result[i, 2] = np.arctan2(turn[0, 2] - turn[2, 0], turn[0, 0] + turn[2, 2])
    return result


@njit(cache=True, nogil=True)
def _motions_of(planar: Array, extrinsics: Array, rotations: Array, origin: NDArray[np.int64]) -> Array:
    """(N, 7) camera motions of (N, 3) planar ones; each camera stands over the road as its extrinsics say."""
    result = np.zeros((len(planar), 7))
    for i in range(len(planar)):
        x, z, heading = planar[i]
        c, s = np.cos(heading), np.sin(heading)
        back = np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
        R = rotations[i] @ back @ np.ascontiguousarray(rotations[origin[i]].T)
        rise = extrinsics[i, 0] - extrinsics[origin[i], 0]
        result[i, :3] = vector_from_rotation(R)
        result[i, 3:6] = rotations[i] @ (np.array([0.0, rise, 0.0]) - back @ np.array([x, 0.0, z]))
    return result


def _covariance_of(planar: Array, rotations: Array, origin: NDArray[np.int64]) -> Array:
    """(N, 3, 3) planar covariance to (N, 6, 6) of rotation and translation, to first order."""
    jacobian = np.zeros((len(planar), 6, 3))
    jacobian[:, :3, 2] = rotations[:, :, 1]
    jacobian[:, 3:, :2] = rotations[origin][:, :, [0, 2]]
    return np.asarray(jacobian @ planar @ np.swapaxes(jacobian, 1, 2))


@njit(cache=True, nogil=True)
def _rotations_of(motions: Array) -> Array:
    """(N, 7) motions to (N, 3, 3)."""
    result = np.empty((len(motions), 3, 3))
    for i in range(len(motions)):
        result[i] = rotation_from_vector(motions[i, :3])
    return result


def _planar_covariance(
    covariance: Array, motions: Array, rotations: Array, origin: NDArray[np.int64]
) -> Array:
    """(N, 6, 6) covariance of camera motions to the (N, 3, 3) of x, z, heading on the road."""
    to_road = np.swapaxes(rotations[origin], 1, 2) @ np.swapaxes(_rotations_of(motions), 1, 2)
    jacobian = np.zeros((len(motions), 3, 6))
    jacobian[:, :2, 3:] = to_road[:, [0, 2]]
    jacobian[:, 2, :3] = rotations[:, :, 1]
    return np.asarray(jacobian @ covariance @ np.swapaxes(jacobian, 1, 2))


@njit(cache=True, nogil=True)
def _chain(motions: Array, previous: NDArray[np.int64]) -> tuple[Array, NDArray[np.bool_]]:
    """(N, 7) T_current_previous to (N, 4, 4) poses, and which frames have no pair of their own.

    Frames jumped over by a pair move evenly along it; frames after the last known pair keep their velocity.
    """
    n = len(motions)
    poses = np.zeros((n, 4, 4))
    bridged = np.zeros(n, dtype=np.bool_)
    velocity = np.zeros(6)
    for i in range(n):
        poses[i, 3, 3] = 1.0
        if i == 0:
            poses[0] = np.eye(4)
            continue
        if motions[i, 6] > 0.0:
            base = previous[i]
            velocity = motions[i, :6] / (i - base)
        else:
            base = i - 1
            bridged[i] = True
        bridged[base + 1 : i] = True
        for j in range(base + 1, i + 1):
            part = motions[i, :6] if j == i and not bridged[i] else velocity * (j - base)
            back = np.ascontiguousarray(rotation_from_vector(part[:3]).T)
            poses[j, :3, :3] = np.ascontiguousarray(poses[base, :3, :3]) @ back
            shift = np.ascontiguousarray(poses[j, :3, :3]) @ np.ascontiguousarray(part[3:6])
            poses[j, :3, 3] = poses[base, :3, 3] - shift
    return poses, bridged
