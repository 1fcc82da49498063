"""K off by 1 % and 4 px: the joint refinement with the intrinsics held, and with them free (the paper's eq. 6-7)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from stereocalib_core.boards.camera import BoardCamera
from stereocalib_core.boards.chessboard import posed_again
from stereocalib_core.boards.joint import Free, JointState, Noise
from stereocalib_core.boards.noise import joint_problem
from stereocalib_core.boards.refine import refine
from stereocalib_core.boards.solve import PlanePairs, dual_space
from stereocalib_core.experiments.lidar_camera_simulation import (
    BOARD,
    CAMERA,
    T_CAMERA_LIDAR,
    SimulatedNoise,
    simulate_boards,
)
from stereocalib_core.numeric.arrays import Array

Progress = Callable[[int, int, str], None]
FOCAL_SHARE, CENTRE_PX = 0.01, 4.0
FEWER = 10
"""One trial here for so many of the main simulation: its effect is many times its chance."""


def wrong_camera() -> BoardCamera:
    """The simulated camera with a focal length 1 % too long and a centre 4 px to the right and below."""
    K = CAMERA.K.copy()
    K[0, 0] *= 1.0 + FOCAL_SHARE
    K[1, 1] *= 1.0 + FOCAL_SHARE
    K[:2, 2] += CENTRE_PX
    return BoardCamera(CAMERA.model, CAMERA.width, CAMERA.height, K, CAMERA.D)


def simulate(repeats: int, progress: Progress | None, counts: Sequence[int]) -> dict[int, dict[str, Array]]:
    """count -> "fixed" and "refined" -> (repeats, 3): matrix error, focal error [px], centre error [px]."""
    camera = wrong_camera()
    result: dict[int, dict[str, Array]] = {}
    for done, count in enumerate(counts, start=1):
        rows: dict[str, list[Array]] = {"fixed": [], "refined": []}
        for trial in range(repeats):
            rng = np.random.default_rng([2019, count, trial])
            seen = [posed_again(o, camera, BOARD) for o in simulate_boards(count, rng, SimulatedNoise())]
            pairs = PlanePairs.of(
                [o.camera_plane for o in seen if o.camera_plane is not None],
                [o.lidar_plane for o in seen if o.lidar_plane is not None],
            )
            linear = dual_space(
                pairs.normals_camera, pairs.offsets_camera, pairs.normals_lidar, pairs.offsets_lidar
            )
            problem = joint_problem(seen, BOARD, camera, Noise(0.5, 0.03))
            start = JointState(linear, np.array([o.T_camera_board for o in seen]), camera)
            for name, free in (("fixed", Free()), ("refined", Free(intrinsics=True))):
                rows[name].append(_errors(refine(problem, start, free).state))
        result[count] = {name: np.array(values) for name, values in rows.items()}
        if progress is not None:
            progress(done, len(counts), "freeing a wrong K")
    return result


def _errors(state: JointState) -> Array:
    K = state.camera.K
    return np.array(
        [
            np.linalg.norm(state.T_camera_lidar[:3] - T_CAMERA_LIDAR[:3], 2),
            abs(K[0, 0] - CAMERA.K[0, 0]),
            np.linalg.norm(K[:2, 2] - CAMERA.K[:2, 2]),
        ]
    )


def summarise(samples: dict[int, dict[str, Array]], counts: Sequence[int]) -> dict[str, Any]:
    """As the JSON holds it: matrix errors by number of boards, and what is left of the two errors of K."""
    result: dict[str, Any] = {
        "counts": list(counts), "focal_share": FOCAL_SHARE, "centre_px": CENTRE_PX,
        "repeats": len(samples[counts[0]]["fixed"]),
    }  # fmt: skip
    for name in ("fixed", "refined"):
        result[name] = {
            "mean": [float(samples[c][name][:, 0].mean()) for c in counts],
            "std": [float(samples[c][name][:, 0].std()) for c in counts],
            "focal_error_px": [float(samples[c][name][:, 1].mean()) for c in counts],
            "centre_error_px": [float(samples[c][name][:, 2].mean()) for c in counts],
        }
    return result
