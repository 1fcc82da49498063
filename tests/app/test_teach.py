"""Teach: every step draws what it explains and breaks visibly; what the user had set comes back; the quiz."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import cv2
import numpy as np
import pytest
from conftest import start_page, stop_page, until
from stereocalib_app.drive.lesson_marks import plane_of, sigma_points
from stereocalib_app.drive.panels.bend import bent
from stereocalib_app.drive.settings import Corrections, Settings
from stereocalib_app.server.hub import Hub
from stereocalib_app.words.lessons import (
    LESSONS,
    TURN_DEG,
    TURNED,
    Lesson,
    broken_corrections,
    turned,
    turned_stage,
)

from stereocalib_core.frames import StereoFrame
from stereocalib_core.geometry import StereoCamera

FRAME = 9
TURN_RAD = float(np.deg2rad(TURN_DEG))


@pytest.fixture(scope="module")
def hub(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Hub]:
    running = start_page("synthetic:town?frames=14", tmp_path_factory.mktemp("root"))
    running.shared.playback.play(False)
    assert running.shared.session.wait(120.0)
    yield running
    stop_page(running)


def picture(hub: Hub, settings: Settings) -> np.ndarray:
    look = hub.shared._look(FRAME, settings)
    view = hub.shared.session.views_with(settings.broken_stage).get(FRAME, look)
    return cv2.imdecode(np.frombuffer(view.jpeg, np.uint8), cv2.IMREAD_COLOR).astype(int)


@pytest.mark.parametrize("lesson", LESSONS, ids=lambda lesson: lesson.title)
def test_a_step_breaks_visibly(hub: Hub, lesson: Lesson) -> None:
    plain = Settings(preset="Teach", teach_step=LESSONS.index(lesson), layout=lesson.layout)
    broken = replace(
        plain, corrections=broken_corrections(lesson.breakage), broken_stage=lesson.breakage.stages
    )
    changed = np.abs(picture(hub, plain) - picture(hub, broken)).max(axis=2) > 40
    assert changed.mean() > 0.0008, f"{lesson.title}: {changed.mean():.5f}"


@pytest.mark.parametrize("title", ["Roll", "Yaw", "Filter", "Odometry"])
def test_a_step_draws_what_it_explains(hub: Hub, title: str) -> None:
    step = next(i for i, lesson in enumerate(LESSONS) if lesson.title == title)
    taught = picture(hub, Settings(preset="Teach", teach_step=step))
    plain = picture(hub, Settings())
    assert (np.abs(taught - plain).max(axis=2) > 40).mean() > 0.0015


def test_a_pair_bent_by_the_slider_tilts_the_road_stretches_the_path_and_is_found(hub: Hub) -> None:
    page, teach = hub.shared, hub.shared.parts["Teach"]
    session, snapshot = page.session, page.session.snapshot
    straight, now = (bent(session, snapshot, turn) for turn in (0.0, 0.1))
    camera = session.camera
    # h / b of pitch per yaw, and every depth short
    expected = -np.deg2rad(0.1) * 1.65 / camera.baseline_m
    assert now.pitch_rad - straight.pitch_rad == pytest.approx(expected, rel=0.1)
    assert now.path_m > 1.01 * straight.path_m
    assert straight.yaw is not None and now.yaw is not None
    assert np.rad2deg(now.yaw.value - straight.yaw.value) == pytest.approx(0.1, abs=0.003)
    step = next(i for i, lesson in enumerate(LESSONS) if lesson.breakage.stages in TURNED)
    teach.go(step)
    until(lambda: teach._bend._folder.visible)
    teach._bend.bend(0.1)
    assert page.settings.broken_stage == turned_stage(0.1)
    assert "motion finds" in teach._bend._table.content and "<polyline" in teach._bend._map.content
    until(lambda: teach._bend._slider.value == pytest.approx(0.1))
    teach.mend()
    assert page.settings.broken_stage == "" and "Move the slider" in teach._bend._table.content
    teach.go(0)
    until(lambda: not teach._bend._folder.visible)


def test_what_the_user_had_set_comes_back(hub: Hub) -> None:
    page, teach = hub.shared, hub.shared.parts["Teach"]
    mine = Corrections(roll_error_deg=0.3)
    page.change(corrections=mine)
    teach.go(4)
    assert page.settings.corrections == mine
    teach.break_it()
    assert page.settings.corrections.pitch_error_deg == 1.0
    teach.mend()
    assert page.settings.corrections == mine
    teach.break_it()
    teach.go(5)
    assert page.settings.corrections == mine
    page.change(corrections=Corrections())


def test_the_quiz_is_found_and_mended(hub: Hub) -> None:
    page, teach = hub.shared, hub.shared.parts["Teach"]
    step = next(i for i, lesson in enumerate(LESSONS) if lesson.title == "Roll")
    teach.quiz(step)
    assert page.settings.corrections.roll_error_deg == 2.0
    until(lambda: teach._effect.content == "", what="not given away")
    teach.guess("Yaw")
    assert "Look again" in teach._answer.content
    assert page.settings.corrections.touched
    teach.guess("Roll")
    assert "Found" in teach._answer.content
    assert not page.settings.corrections.touched


def test_sigma_points_carry_mean_and_covariance() -> None:
    covariance = np.array([[4e-4, 1e-5, 0], [1e-5, 3e-6, 0], [0, 0, 5e-6]])
    points = sigma_points(np.array([1.65, 0.01, -0.02]), covariance)
    away = points[1:] - points[0]
    np.testing.assert_allclose(away.T @ away / 6, covariance, atol=1e-12)


def test_the_disparity_plane_of_a_state() -> None:
    camera = StereoCamera(640, 320, 500.0, 320.0, 140.0, 0.5)
    a, c = plane_of(camera, np.array([1.6, np.deg2rad(2.0), 0.0]))
    assert a == pytest.approx(0.5 * np.cos(np.deg2rad(2.0)) / 1.6)
    assert c == pytest.approx(500.0 * a * np.tan(np.deg2rad(2.0)))


def test_a_turned_right_camera_shifts_every_disparity_by_nearly_the_same() -> None:
    camera = StereoCamera(640, 320, 500.0, 320.0, 140.0, 0.5)
    ramp = np.tile(np.linspace(0, 250, 640), (320, 1)).astype(np.uint8)
    moved = turned(StereoFrame(0, 0.0, ramp, ramp), camera, TURN_RAD).right
    assert moved is not None
    shift = (moved[140, 300:340].astype(float) - ramp[140, 300:340]).mean() / (250 / 639)
    assert shift == pytest.approx(500.0 * TURN_RAD, abs=0.5)
