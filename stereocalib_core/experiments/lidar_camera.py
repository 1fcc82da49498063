"""The second paper's simulation: error against the number of boards, for every solver, unrefined and refined.

Errors are spectral norms of the difference from the truth: of the 3x4 matrix (eq. 10), of t (eq. 8) and of R (eq. 9).
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from stereocalib_core.boards.baselines import points_on_plane, unnikrishnan_hebert
from stereocalib_core.boards.joint import JointState, Noise
from stereocalib_core.boards.noise import joint_problem
from stereocalib_core.boards.observation import PairObservation
from stereocalib_core.boards.planes import plane_through
from stereocalib_core.boards.refine import refine
from stereocalib_core.boards.rotations import nearest_rotation, rotation_from_vector
from stereocalib_core.boards.solve import PlanePairs, dual_space, split_covariance, weighted
from stereocalib_core.errors import ConfigError
from stereocalib_core.experiments import lidar_camera_intrinsics as wrong_intrinsics
from stereocalib_core.experiments import lidar_camera_report as report
from stereocalib_core.experiments.lidar_camera_simulation import (
    BOARD,
    CAMERA,
    T_CAMERA_LIDAR,
    SimulatedNoise,
    simulate_boards,
)
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.system.whole_file import write_json

Progress = Callable[[int, int, str], None]
COUNTS = tuple(range(5, 16))
SOLVERS = ("dual_space", "unnikrishnan_hebert", "points_on_plane", "weighted", "refined")
SHOWN_COUNT = 11
BLOCK = 25
JUDGES = 8
KAPPA = 10.0
"""The paper's weight in e = kappa e_L + e_C, used for its Fig. 5 only [px/m]."""

TAKES_DRIVE = False
"""Whether `--source` is a drive for it; it makes its own data, whose truth is known."""


def run(
    out: Path,
    source: str | None = None,
    progress: Progress | None = None,
    repeats: int = 500,
    workers: int = 2,
    counts: Sequence[int] = COUNTS,
) -> dict[str, Any]:
    """Write lidar-camera.json, lidar-camera.md and the figures into `out`; returns what the JSON holds.

    `source` is not used: the truth must be known. `progress` gets (done, total, what).
    """
    if source is not None:
        raise ConfigError(
            "experiment lidar-camera takes no source", source, "it simulates boards whose truth is known"
        )
    samples = simulate(repeats, workers, progress, counts)
    result = summarise(samples, counts)
    result["refined_intrinsics"] = wrong_intrinsics.summarise(
        wrong_intrinsics.simulate(max(repeats // wrong_intrinsics.FEWER, 4), progress, counts), counts
    )
    write_json(out / "lidar-camera.json", result)
    report.write(out, result, samples, repeats)
    return result


def simulate(
    repeats: int,
    workers: int = 2,
    progress: Progress | None = None,
    counts: Sequence[int] = COUNTS,
) -> dict[int, dict[str, Array]]:
    """All trials: count -> solver -> (repeats, 4) errors of matrix, translation [m], rotation, and eq. 7 [px].

    Under "sigma" (repeats, 12): signed errors of the refined rotation vector [rad] and translation [m] in
    the camera's axes, then their predicted sigmas. Every trial has its own seed, so any number of workers
    gives the same numbers.
    """
    tasks = [
        (count, first, min(BLOCK, repeats - first)) for count in counts for first in range(0, repeats, BLOCK)
    ]
    blocks: list[dict[str, Array]] = []
    if workers <= 1:
        for done, task in enumerate(tasks, start=1):
            blocks.append(trials(task))
            if progress is not None:
                progress(done, len(tasks), "simulating boards")
    else:
        # A fresh interpreter per worker: safe whatever threads the caller runs.
        with ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn")) as pool:
            for done, block in enumerate(pool.map(trials, tasks), start=1):
                blocks.append(block)
                if progress is not None:
                    progress(done, len(tasks), "simulating boards")
    return {
        count: {
            name: np.concatenate([b[name] for b, task in zip(blocks, tasks, strict=True) if task[0] == count])
            for name in (*SOLVERS, "sigma")
        }
        for count in counts
    }


def trials(task: tuple[int, int, int]) -> dict[str, Array]:
    """One block of trials: (boards, number of the first trial, how many)."""
    count, first, many = task
    rows: dict[str, list[Array]] = {name: [] for name in (*SOLVERS, "sigma")}
    for trial in range(first, first + many):
        rng = np.random.default_rng([2018, count, trial])
        observations = simulate_boards(count, rng, SimulatedNoise())
        solutions, covariance = solve_all(observations, Noise(0.5, 0.03))
        for name, T in solutions.items():
            rows[name].append(np.array([*errors(T, T_CAMERA_LIDAR), eq7_error(T, judges())]))
        rows["sigma"].append(_against_sigma(solutions["refined"], covariance))
    return {name: np.array(values) for name, values in rows.items()}


def solve_all(observations: Sequence[PairObservation], noise: Noise) -> tuple[dict[str, Array], Array]:
    """T_camera_lidar by every solver, and the (6, 6) covariance of the refined one (rotation vector, translation)."""
    camera = [o.camera_plane for o in observations if o.camera_plane is not None]
    lidar = [o.lidar_plane for o in observations if o.lidar_plane is not None]
    pairs = PlanePairs.of(camera, lidar)
    # The plain solvers take the plain least-squares plane, as the paper does.
    plain = [plane_through(o.points_lidar)[0] for o in observations]
    planes = (
        pairs.normals_camera,
        pairs.offsets_camera,
        np.array([p.normal for p in plain]),
        np.array([p.offset_m for p in plain]),
    )
    linear = dual_space(*planes)
    better, _ = weighted(pairs, linear)
    poses = np.array([o.T_camera_board for o in observations])
    problem = joint_problem(observations, BOARD, CAMERA, noise)
    refined = refine(problem, JointState(better, poses, CAMERA))
    T = refined.state.T_camera_lidar
    solutions = {
        "dual_space": linear,
        "unnikrishnan_hebert": unnikrishnan_hebert(*planes),
        "points_on_plane": points_on_plane([o.points_lidar for o in observations], planes[0], planes[1]),
        "weighted": better,
        "refined": T,
    }
    return solutions, split_covariance(refined.covariance, T)


def errors(T: Array, truth: Array) -> tuple[float, float, float]:
    """Spectral norms of the differences of the 3x4 matrices (eq. 10), of t [m] (eq. 8) and of R (eq. 9)."""
    gap = T[:3] - truth[:3]
    return (
        float(np.linalg.norm(gap, 2)),
        float(np.linalg.norm(gap[:, 3])),
        float(np.linalg.norm(gap[:, :3], 2)),
    )


def eq7_error(T: Array, boards: Sequence[PairObservation]) -> float:
    """Eq. 7, kappa e_L + e_C [px]: rms of the points' distances to the camera's boards, and of the corners.

    Both depend on the transform alone when `boards` carry no noise. For e_C a board stands on the LiDAR's plane,
    moved by T, where the seen corners' rays meet it best, and its corners are projected from there: a plane that is
    tilted or too far away makes them miss; one that leaves the view misses by the picture's diagonal.
    """
    distances, misses = [], []
    for o in boards:
        assert o.camera_plane is not None
        assert o.lidar_plane is not None
        assert o.corners is not None
        distances.append(o.camera_plane.plane.signed_distance(o.points_lidar @ T[:3, :3].T + T[:3, 3]))
        normal = T[:3, :3] @ o.lidar_plane.plane.normal
        offset = o.lidar_plane.plane.offset_m + float(normal @ T[:3, 3])
        rays = np.column_stack([CAMERA.normalise(o.corners), np.ones(len(o.corners))])
        met = rays * (offset / (rays @ normal))[:, None]
        miss = np.linalg.norm(CAMERA.project(_board_laid_on(met)) - o.corners, axis=1)
        misses.append(np.nan_to_num(miss, nan=float(np.hypot(CAMERA.width, CAMERA.height))))
    e_lidar = float(np.sqrt(np.mean(np.concatenate(distances) ** 2)))
    return KAPPA * e_lidar + float(np.sqrt(np.mean(np.concatenate(misses) ** 2)))


@lru_cache(maxsize=1)
def judges() -> tuple[PairObservation, ...]:
    """Boards without noise that had no say in any trial, the same for all: what eq. 7 is read on."""
    return tuple(simulate_boards(JUDGES, np.random.default_rng(2018), SimulatedNoise(0.0, 0.0)))


def _board_laid_on(places: Array) -> Array:
    """(N, 3) the board's corners, moved rigidly as near as can be to (N, 3) places."""
    model, middle = BOARD.corners_board, places.mean(axis=0)
    R = nearest_rotation((places - middle).T @ (model - model.mean(axis=0)))
    return (model - model.mean(axis=0)) @ R.T + middle


def _against_sigma(T: Array, covariance: Array) -> Array:
    """(12,) signed errors of rotation vector [rad] and translation [m], then the predicted sigmas."""
    turn = T[:3, :3] @ T_CAMERA_LIDAR[:3, :3].T
    vector = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / 2
    assert np.allclose(rotation_from_vector(vector), turn, atol=1e-3)
    return np.concatenate([vector, T[:3, 3] - T_CAMERA_LIDAR[:3, 3], np.sqrt(np.diag(covariance))])


def summarise(samples: dict[int, dict[str, Array]], counts: Sequence[int]) -> dict[str, Any]:
    """Means and standard deviations as the JSON holds them."""
    result: dict[str, Any] = {"counts": list(counts)}
    for solver in SOLVERS:
        result[solver] = {
            "mean": [float(samples[c][solver][:, 0].mean()) for c in counts],
            "std": [float(samples[c][solver][:, 0].std()) for c in counts],
        }
    shown = SHOWN_COUNT if SHOWN_COUNT in counts else counts[-1]
    names = ("matrix", "translation_m", "rotation")
    at = samples[shown]
    result["at_11"] = {s: {n: float(at[s][:, i].mean()) for i, n in enumerate(names)} for s in SOLVERS}
    result["at_11_std"] = {s: {n: float(at[s][:, i].std()) for i, n in enumerate(names)} for s in SOLVERS}
    sigma = at["sigma"]
    observed, predicted = np.sqrt((sigma[:, :6] ** 2).mean(axis=0)), np.sqrt((sigma[:, 6:] ** 2).mean(axis=0))
    result["sigma_at_11"] = {
        "rotation_deg": {
            "observed": np.rad2deg(observed[:3]).tolist(),
            "predicted": np.rad2deg(predicted[:3]).tolist(),
        },
        "translation_m": {"observed": observed[3:].tolist(), "predicted": predicted[3:].tolist()},
    }
    result["eq7_px"] = {s: [float(samples[c][s][:, 3].mean()) for c in counts] for s in SOLVERS}
    result["by_count"] = {
        s: {n: [float(samples[c][s][:, i].mean()) for c in counts] for i, n in enumerate(names)}
        for s in SOLVERS
    }
    return result
