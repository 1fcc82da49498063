"""Do the pictures agree on the lens as well as each agrees with itself?

A lens model that is not quite the lens, a board that is not quite flat and blur move many corners of a picture
together. Within a picture a pose hides most of it, so the scatter of its corners says little; what each picture for
itself asks of the intrinsics says more, and that is the noise which the intrinsics' own sigma must go by.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stereocalib_core.boards.joint import Free, JointProblem, JointState, corner_rows, shared_columns
from stereocalib_core.boards.refine import Refined, refine
from stereocalib_core.config.boards import SECOND_OPINION
from stereocalib_core.numeric.arrays import Array


def lens_scatter(problem: JointProblem, state: JointState) -> tuple[float, int]:
    """Variance of the corners along what intrinsics can do, poses left free, over the stated one, and its freedom.

    `state` must be at its optimum with the intrinsics free: as many numbers as these are gone from the freedom.
    """
    error, by_pose, points, d_pixels = corner_rows(problem, state)
    by_lens = shared_columns(problem, state, Free(intrinsics=True), points, d_pixels)
    assert by_lens is not None, "intrinsics are asked for"
    total, freedom = 0.0, -by_lens.shape[-1]
    for e, J_pose, J_lens in zip(error, by_pose, by_lens, strict=True):
        left, basis = _without(J_pose, e), _basis(_without(J_pose, J_lens))
        total += float(np.sum((basis.T @ left) ** 2))
        freedom += basis.shape[1]
    return (total / freedom, freedom) if freedom > 0 else (1.0, 0)


def weighed_by_lens(problem: JointProblem, refined: Refined) -> tuple[JointProblem, Refined]:
    """The same problem and solution with the corners' noise as the pictures' views of the lens scatter; never less
    than what a picture shows of its own."""
    factor, _ = lens_scatter(problem, refined.state)
    if factor <= 1.0:
        return problem, refined
    problem = replace(problem, corner_sigma=problem.corner_sigma * np.sqrt(factor))
    return problem, refine(problem, refined.state, refined.free)


def _without(J: Array, values: Array) -> Array:
    """What is left of (N, ...) values beside the columns of J (N, k)."""
    Q = np.linalg.qr(J)[0]
    return np.asarray(values - Q @ (Q.T @ values))


def _basis(J: Array) -> Array:
    """(N, q) columns to an orthonormal basis (N, r) of what they span, each column at its own scale."""
    length = np.linalg.norm(J, axis=0)
    vectors, values, _ = np.linalg.svd(J / np.where(length > 0, length, 1.0), full_matrices=False)
    return np.asarray(vectors[:, values > SECOND_OPINION.least_share * values[0]])
