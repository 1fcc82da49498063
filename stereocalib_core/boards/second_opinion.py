"""What the boards themselves say of the camera and of their own size, against what the two files claim."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from stereocalib_core.boards.beams import Beams, pull_of_beams
from stereocalib_core.boards.camera import BoardCamera
from stereocalib_core.boards.joint import Free, JointProblem, JointState, linearise
from stereocalib_core.boards.refine import Refined, refine
from stereocalib_core.boards.rotations import rotation_vector
from stereocalib_core.boards.solve import covariance_of, pseudo_inverse, split_covariance
from stereocalib_core.config.boards import SECOND_OPINION, VARIANCE
from stereocalib_core.numeric.arrays import Array


@dataclass(frozen=True)
class BoardScale:
    """How large the boards are in the LiDAR over what board.yaml says, 1 sigma, and whether the file is wrong."""

    value: float
    sigma: float
    doubted: bool = False

    @classmethod
    def judged(cls, value: float, sigma: float) -> BoardScale:
        """Doubted beyond what the scale's own sigma and the ruler's allow together."""
        limit = SECOND_OPINION.certain_sigmas * float(np.hypot(sigma, VARIANCE.scale_sigma))
        return cls(value, sigma, abs(value - 1.0) > limit)


@dataclass(frozen=True)
class Doubt:
    """The camera and the scale as the boards would have them, held against those that were given.

    camera, scale: the freed ones; camera_sigma: (4 + n,) or None. surprise: chi^2 of the step over its degrees of
    freedom (1 = as expected). beyond_chance: too much for luck. moved: (6, 6) what T would move by, as a second
    moment of rotation vector [rad] and translation [m].
    """

    camera: BoardCamera
    camera_sigma: Array | None
    scale: float
    surprise: float
    beyond_chance: bool
    moved: Array


def second_opinion(problem: JointProblem, held: Refined) -> Doubt | None:
    """Free the intrinsics, and see whether they, and T with them, leave by more than their own sigma allows.

    None when they were free already, or when there are too few boards to fit a lens. The move of T counts as an
    error of its own, shrunk by what chance alone would have moved (the positive part of James and Stein 1961).
    """
    if len(problem.counts) < SECOND_OPINION.least_boards:
        return None
    if held.free.intrinsics:
        return None
    # The scale gives way in both, or the lens would answer for a square of another size.
    sized = refine(problem, held.state, Free(True, False, True, _ruler(held)))
    freed = refine(problem, sized.state, Free(True, True, True, _ruler(held)))
    step = intrinsics_of(freed.state.camera) - intrinsics_of(held.state.camera)
    block = np.arange(6, 6 + len(step))
    covariance = freed.joint_covariance[np.ix_(block, block)]
    unit = 1.0 / np.sqrt(np.diag(covariance))
    moved_by = step * unit
    chi = float(moved_by @ np.linalg.pinv(covariance * unit * unit[:, None], rcond=1e-10) @ moved_by)
    beyond = chi > float(chdtri(len(step), SECOND_OPINION.chance))
    moved = np.zeros((6, 6))
    if beyond:
        d = _difference(freed.state.T_camera_lidar, sized.state.T_camera_lidar)
        moved = max(0.0, 1.0 - len(step) / chi) * np.outer(d, d)
    return Doubt(freed.state.camera, freed.intrinsic_sigma, freed.state.scale, chi / len(step), beyond, moved)


@dataclass(frozen=True)
class Solved:
    """What a covariance rests on: the problem, its solution, how much more the planes scatter than they should, the
    boards' second opinion of the camera, and the LiDAR's beams."""

    problem: JointProblem
    refined: Refined
    scatter: float
    doubt: Doubt | None
    beams: Beams | None

    @property
    def free(self) -> Free:
        """All that is uncertain, the ruler too, whether or not the scale was free."""
        held = self.refined.free
        return Free(True, held.intrinsics, True, _ruler(self.refined))

    @cached_property
    def information(self) -> Information:
        """What the boards of the problem say."""
        owner = None if self.beams is None else self.beams.owner
        count = 0 if self.beams is None else self.beams.count
        return Information.of(self.problem, self.refined.state, self.free, owner, count)


@dataclass(frozen=True)
class Information:
    """own: (G, G) of extrinsics, intrinsics if free, scale. by_beams: (G, K) what a beam's error adds to the pull."""

    own: Array
    by_beams: Array

    @classmethod
    def of(
        cls,
        problem: JointProblem,
        state: JointState,
        free: Free,
        owner: NDArray[np.int64] | None,
        beams: int,
    ) -> Information:
        """The boards of a problem, `owner` (P,) being the beam of each point."""
        system = linearise(problem, state, free)
        pull = np.zeros((len(system.g_g), 0))
        if owner is not None:
            pull = pull_of_beams(problem, state, system, owner, beams)
        return cls(system.reduced(), pull)


def covariance_with_doubt(solved: Solved, information: Information | None = None) -> Array:
    """(6, 6) of the rotation vector about the camera's axes [rad] and of the translation [m].

    The ruler's own uncertainty is in it whether or not the scale was free. `information`: that of other boards than
    the solved ones.
    """
    held, scatter = solved.refined, solved.scatter
    asked = solved.information if information is None else information
    own = asked.own
    if held.free.scale:
        whole = covariance_of(own)
        # What the ruler knows is its own: a scatter of the boards makes it no worse.
        by_ruler = whole[:6, -1] / held.free.scale_sigma
        covariance = scatter * whole[:6, :6] + (1.0 - scatter) * np.outer(by_ruler, by_ruler)
    else:
        # T is for the stated size, whatever the data say of it: the ruler's error moves it in full.
        known = covariance_of(own[:-1, :-1])
        by_ruler = pseudo_inverse(own[:-1, :-1])[:6] @ own[:-1, -1] * VARIANCE.scale_sigma
        covariance = scatter * known[:6, :6] + np.outer(by_ruler, by_ruler)
    if solved.beams is not None:
        by_beams = beam_response(held, asked)
        covariance = covariance + solved.beams.sigma_m**2 * by_beams @ by_beams.T
    covariance = split_covariance(covariance, held.state.T_camera_lidar)
    return covariance if solved.doubt is None else covariance + solved.doubt.moved


def beam_response(held: Refined, asked: Information) -> Array:
    """(6, K) left twist of T for a unit range error of each beam [1/m].

    Along what the boards leave open nothing moves: that it is unknown is said by the covariance without beams. Where
    T is for the stated size, no part of what the beams do goes into the scale.
    """
    seen = len(asked.own) if held.free.scale else len(asked.own) - 1
    return np.asarray(-pseudo_inverse(asked.own[:seen, :seen])[:6] @ asked.by_beams[:seen])


def _ruler(held: Refined) -> float:
    return held.free.scale_sigma if held.free.scale else VARIANCE.scale_sigma


def intrinsics_of(camera: BoardCamera) -> Array:
    """(4 + n,) fx, fy, cx, cy [px] and the coefficients."""
    return np.concatenate([camera.K[[0, 1, 0, 1], [0, 1, 2, 2]], camera.D])


def _difference(a: Array, b: Array) -> Array:
    """(6,) rotation vector about the camera's axes [rad] and translation [m] from transform b to a."""
    return np.concatenate([rotation_vector(a[:3, :3] @ b[:3, :3].T), a[:3, 3] - b[:3, 3]])
