"""What the scans of a drive say of the stereo pair: the results of its frames, laid out for `depth_scale`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.back.rig.depth_scale import LidarDisparity, lidar_disparity
from stereocalib_core.config import PipelineConfig
from stereocalib_core.geometry import StereoCamera
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.results import FrameResult, Measured, RectificationSample


def by_lidar(
    camera: StereoCamera,
    results: Sequence[FrameResult],
    inside: NDArray[np.bool_],
    motions: Array,
    roll_pitch: tuple[Measured, Measured],
    config: PipelineConfig,
) -> LidarDisparity | None:
    """What the scans of the stretch say."""
    at = [i for i, r in enumerate(results) if inside[i] and r.disparities is not None]
    if not at:
        return None
    samples = [r.disparities for i in at if (r := results[i]).disparities is not None]
    held = roll_pitch[0].value, roll_pitch[1].value
    rows = _mean_rows([results[i].rectification for i in at])
    return lidar_disparity(camera, samples, _known_motions(motions)[at], held, config.pair, rows)


def _mean_rows(samples: Sequence[RectificationSample | None]) -> RectificationSample | None:
    """The rows of a rigid pair, by all frames that show them."""
    known = [sample for sample in samples if sample is not None]
    if not known:
        return None
    values = np.mean([sample.values for sample in known], axis=0)
    keystone = float(np.mean([sample.keystone_rad for sample in known]))
    return RectificationSample(values, known[0].covariance, sum(s.matches for s in known), keystone)


def _known_motions(motions: Array) -> Array:
    """(N, 6) motions into each frame; where one could not be solved, as into the first, that of the next that could."""
    solved = np.flatnonzero(motions[:, 6] > 0.0)
    if not len(solved):
        return motions[:, :6]
    following = np.minimum(np.searchsorted(solved, np.arange(len(motions))), len(solved) - 1)
    return np.asarray(motions[solved[following], :6])
