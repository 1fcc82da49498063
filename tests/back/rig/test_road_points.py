"""The plane through tracked road points, and when the filter leans on it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from simulated_tracks import CAMERA, simulate

from stereocalib_core.back.odometry.packing import pack
from stereocalib_core.back.rig.road_points import Look, lean_on, road_planes
from stereocalib_core.back.rig.smoothing import filter_drive
from stereocalib_core.config import DirectConfig, FilterConfig, PipelineConfig, RoadPointsConfig
from stereocalib_core.geometry import Extrinsics
from stereocalib_core.results import FrameResult

CONFIG = RoadPointsConfig()


def test_points_show_the_plane_they_lie_on() -> None:
    results, extrinsics = simulate(np.zeros(40), -0.3, noise_px=0.1)
    values, covariance = road_planes(results, pack(CAMERA, results), CONFIG, DirectConfig())
    # the first frame has no points of its own, and those that the second finds again come too late for it
    assert np.isnan(values[0]).all()
    error, covariance = (values - extrinsics[:, :3])[1:], covariance[1:]
    assert np.abs(error[:, 0]).max() < 0.02
    assert np.rad2deg(np.abs(error[:, 1:]).max(axis=0)) == pytest.approx([0.0, 0.0], abs=0.15)
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    assert (np.abs(error) < 3.0 * sigma).mean() > 0.95


def test_a_kerb_among_the_points_does_not_tilt_the_plane() -> None:
    results, extrinsics = simulate(np.zeros(12), 0.0, noise_px=0.1)
    fb = CAMERA.focal_px * CAMERA.baseline_m
    for r in results:
        if r.tracks is None:
            continue
        for first in (0, 3):
            d = r.tracks.points[:, first + 2]
            side = (r.tracks.points[:, first] - CAMERA.cx_px) * CAMERA.baseline_m / d
            kerb = r.tracks.on_road & (d < fb / 10.0) & (side > 0.3)
            # 8 cm above the road at the same row is so much nearer
            d[kerb] *= 1.0 + 0.08 / 1.65
    values, covariance = road_planes(results, pack(CAMERA, results), CONFIG, DirectConfig())
    error = np.abs(values - extrinsics[:, :3])[1:]
    assert error[:, 0].max() < 0.03
    assert (np.rad2deg(np.median(error[:, 1:], axis=0)) < 0.05).all()
    # where nearly a quarter of the points are kerb, it may pass for a twisted road: then sigma says so
    sigma = np.sqrt(np.diagonal(covariance[1:], axis1=1, axis2=2))
    assert (error < np.maximum(4.0 * sigma, [0.03, *np.deg2rad([0.3, 0.3])])).all()


def test_few_points_say_nothing() -> None:
    results, _ = simulate(np.zeros(3), 0.0)
    for r in results:
        if r.tracks is not None:
            r.tracks.on_road[15:] = False
    assert np.isnan(road_planes(results, pack(CAMERA, results), CONFIG, DirectConfig())[0]).all()


SLACK = np.diag([0.04, 0.008, 0.008]) ** 2
WIDE, NARROW = np.diag(np.full(3, 1e-4)), np.diag(np.full(3, 1e-6))


def test_the_surer_look_has_its_say() -> None:
    look, surer = Look(np.zeros(3), WIDE), Look(np.full(3, 0.01), NARROW)
    values, covariance = lean_on(look, surer, None, SLACK, FilterConfig())
    assert values == pytest.approx([0.01] * 3, rel=0.1)
    assert (np.diag(covariance) < 2e-6).all()
    assert (np.linalg.eigvalsh(covariance) > 0).all()
    for unsure in (Look(np.full(3, np.nan), WIDE), Look(np.full(3, 0.01), WIDE)):
        same = lean_on(Look(np.zeros(3), NARROW), unsure, None, SLACK, FilterConfig())
        np.testing.assert_array_equal(same.values, 0.0)
        np.testing.assert_array_equal(same.covariance, NARROW)


def test_of_two_that_contradict_the_expected_one_is_believed() -> None:
    look, other = Look(np.zeros(3), WIDE), Look(np.array([0.1, 0.0, 0.0]), NARROW)
    unknown = lean_on(look, other, None, SLACK, FilterConfig())
    np.testing.assert_array_equal(unknown.values, 0.0)
    assert np.diag(unknown.covariance) == pytest.approx([0.01 + 1e-4, 1e-4, 1e-4])
    for right in (look, other):
        found = lean_on(look, other, Look(right.values, NARROW), SLACK, FilterConfig())
        np.testing.assert_allclose(found.values, right.values, atol=0.012)
        # the doubt that is left is told: a hump might have thrown the body that far
        assert found.covariance[0, 0] > right.covariance[0, 0]
    between = lean_on(look, other, Look(np.array([0.05, 0.0, 0.0]), 1e4 * WIDE), SLACK, FilterConfig())
    assert between.covariance[0, 0] > 0.03**2


def rewritten(
    results: list[FrameResult], height_m: float, pitch_rad: float, scale: float
) -> list[FrameResult]:
    """The same frames with their own estimates off by so much, and their covariance scaled."""
    changed = []
    for r in results:
        assert r.road is not None
        e = r.road.extrinsics
        off = Extrinsics(e.height_m + height_m, e.pitch_rad + pitch_rad, e.roll_rad)
        road = dataclasses.replace(r.road, extrinsics=off, covariance=scale * r.road.covariance)
        changed.append(dataclasses.replace(r, road=road))
    return changed


def test_points_improve_a_poor_road() -> None:
    results, extrinsics = simulate(np.zeros(80), 0.0, noise_px=0.1)
    # as unsure as dense matching on a cambered road
    poor = rewritten(results, 0.015, 0.001, 49.0)
    alone, helped = (
        np.abs((filter_drive(poor, CAMERA, config).smoothed.values - extrinsics[:, :3]).mean(axis=0))[:2]
        for config in (PipelineConfig(method="direct"), PipelineConfig(method="paper"))
    )
    assert (helped < 0.4 * alone).all()
