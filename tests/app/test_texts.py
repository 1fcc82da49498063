"""What people read: numbers, escaped strings, lists, equations, commands."""

from __future__ import annotations

import html
import shlex
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from stereocalib_app.drive.panels import debug, faults
from stereocalib_app.drive.path_state import PathState
from stereocalib_app.drive.session import Snapshot
from stereocalib_app.drive.summary import path_legend
from stereocalib_app.widgets import palette, text
from stereocalib_app.widgets.chart import Chart, Curve, chart_data, edges, now_line
from stereocalib_app.widgets.copy_button import copy_button
from stereocalib_app.words import lessons

from stereocalib_core.back.remedies import REMEDIES
from stereocalib_core.back.spans import failed_spans
from stereocalib_core.errors import ConfigError, Failure, FailureReason
from stereocalib_core.geometry import Extrinsics
from stereocalib_core.results import (
    Check,
    Drive,
    FrameResult,
    FrameTable,
    Measured,
    Pair,
    Rig,
    RoadEstimate,
    Tolerance,
)
from stereocalib_core.sources import open_source

EVIL = '<img src=x onerror=alert(1)> "quoted" `code` [link](javascript:x) & more'


def failed(frame: int, reason: FailureReason) -> FrameResult:
    return FrameResult(frame, 0.1 * frame, None, Failure(reason, EVIL))


def good(frame: int) -> FrameResult:
    road = RoadEstimate(Extrinsics(1.65, 0.01, 0.0), np.eye(3) * 1e-6, 100, 0.5, (4, 20))
    return FrameResult(frame, 0.1 * frame, road)


def test_strings_from_outside_are_inert() -> None:
    shown = text.escape(EVIL)
    assert "<" not in shown
    assert "`" not in shown.replace("\\`", "")
    assert "](" not in shown
    assert html.unescape(shown.replace("\\", "")) == EVIL


def test_code_shows_what_it_was_given() -> None:
    assert text.code("night@40-46") == "`night@40-46`"
    assert text.code(EVIL).count("`") == 2
    assert len(text.code("x" * 500, 80)) == 82


def test_copy_button_carries_text_but_no_markup() -> None:
    class Parser(HTMLParser):
        tags: list[str] = []
        data: dict[str, str | None] = {}

        def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
            self.tags.append(tag)
            self.data = dict(attrs)

    parser = Parser()
    parser.feed(copy_button("Copy", EVIL))
    assert parser.tags == ["button"]
    assert parser.data["data-text"] == EVIL


def test_every_reason_has_a_cause_and_a_remedy() -> None:
    assert set(REMEDIES) == set(FailureReason)


def test_failures_are_listed_in_runs() -> None:
    reasons = [FailureReason.DARK] * 3 + [FailureReason.NO_ROAD]
    results = (
        good(0),
        *(failed(i + 1, r) for i, r in enumerate(reasons)),
        good(5),
        failed(6, FailureReason.DARK),
    )
    spans = failed_spans(results)
    assert [span.words for span in spans] == ["1 to 3 · DARK", "4 · NO_ROAD", "6 · DARK"]
    assert [debug.frame_of(span.words) for span in spans] == [1, 4, 6]


def test_limits_that_failed_are_marked() -> None:
    table = debug.checks_html(
        (Check("image", "mean grey", 3.0, low=12.0), Check("<b>", "x", 1.0, 0.0, 2.0, "px"))
    )
    assert "✗ mean grey is outside" in table
    assert "<b>" not in table.replace('<b style="', "")
    assert "&lt;b&gt;" in table
    assert "0 … 2 px" in table


def test_numbers_have_their_unit_and_no_more_digits_than_they_deserve() -> None:
    assert debug.shown(0.000642, "deg") == "0.001°"
    assert debug.shown(-1.6604, "m") == "−1.660 m"
    assert debug.shown(3832.4) == "3832"
    assert debug.shown(float("nan"), "m") == "–"
    assert debug.limits(Check("estimate", "roll sigma", 0.01, high=1.003, unit="deg")) == "≤ 1°"


def test_equations_are_typeset_by_the_browser() -> None:
    for lesson in lessons.LESSONS:
        markup = lessons.equation_html(lesson.latex)
        assert markup.count("<math") == len(lesson.latex)
        assert "\\" not in markup
        assert "&#x029F5;" not in markup  # a sign that few fonts have


def test_every_lesson_breaks_something() -> None:
    from stereocalib_core.config import PipelineConfig

    assert 9 <= len(lessons.LESSONS) <= 12
    for lesson in lessons.LESSONS:
        breakage = lesson.breakage
        broken = lessons.broken_config(PipelineConfig(), breakage.stages) != PipelineConfig()
        assert broken or breakage.stages in lessons.TURNED or lessons.broken_corrections(breakage).touched


def test_faults_become_keys_of_the_source() -> None:
    fault = faults.fault_words("knock", "pitch", 0.5, 30, None)
    assert fault == "fault=knock:pitch=0.5@30"
    spec = faults.with_fault("synthetic:town?seed=3", fault)
    spec = faults.with_fault(spec, faults.fault_words("dirt", "pitch", 1.0, 5, 9))
    assert spec == "synthetic:town?seed=3&fault=knock:pitch=0.5@30&fault=dirt@5-9"
    assert faults.faults_of(spec) == ["knock:pitch=0.5@30", "dirt@5-9"]
    assert faults.without_faults(spec) == "synthetic:town?seed=3"
    assert faults.with_fault("synthetic", fault) == "synthetic?fault=knock:pitch=0.5@30"
    with pytest.raises(ConfigError):
        faults.fault_words("rectification", "height", 0.1, 0, None)
    assert shlex.quote(spec) != spec


def test_failed_spans_stand_upright_and_no_dot_is_invented() -> None:
    x = np.arange(10.0)
    failed = (x >= 4) & (x <= 6)
    curves = (
        Curve("failed", failed.astype(float), (0, 0, 0), hidden=True, step=True),
        Curve("dots", x, (0, 0, 0), dots=True),
        Curve("line", x, (0, 0, 0)),
    )
    chart = Chart(x, curves, (), (0.0, 9.0), "y", edges=edges(failed))
    times, band, dots, line = chart_data(chart)
    assert times[np.flatnonzero(np.diff(band))].tolist() == [3.5, 6.5]
    assert times[np.flatnonzero(np.diff(band)) + 1].tolist() == [3.5, 6.5]
    assert np.isfinite(dots).sum() == 10
    np.testing.assert_allclose(line, times)


def test_now_is_a_line_at_its_share_of_the_plot() -> None:
    chart = Chart(np.arange(11.0), (), (), (0.0, 1.0), "y")
    assert "0.30000 *" in now_line(chart, 3.0, 100)
    assert "background" not in now_line(chart, None, 100)


def test_the_card_judges_each_axis_and_the_whole() -> None:
    from stereocalib_app.drive.card import card_html, card_text

    limits = {
        "height_m": Tolerance(1.65, 0.02),
        "pitch_rad": Tolerance(*np.deg2rad([0.8, 0.2])),
        "roll_rad": Tolerance(*np.deg2rad([0.0, 1.0])),
    }
    mount = Rig(height_m=Measured(1.66, 0.01), pitch_rad=Measured(*np.deg2rad([0.5, 0.01])))
    drive = Drive(FrameTable.of([good(0)]), mount=mount, limits=limits, pair=Pair("good", EVIL))
    snapshot = Snapshot(1, (good(0),), drive=drive, done=True)
    lines = card_text("drive", snapshot)
    assert "height: 1.660 ± 0.010 m (✓ within 1.65 ± 0.02 m)" in lines
    assert "pitch: 0.500 ± 0.010° (✗ OUTSIDE 0.8 ± 0.2°)" in lines
    assert "roll: – (not measured, allowed 0 ± 1°)" in lines
    assert "tolerance: not every axis measured" in lines
    shown = card_html(snapshot)
    assert "<img" not in shown
    assert shown.count("✗ OUTSIDE") == 1
    drive = replace(drive, limits={axis: limits[axis] for axis in ("height_m", "pitch_rad")})
    assert "✗ mount OUTSIDE tolerance" in card_text("run", replace(snapshot, drive=drive))
    drive = replace(drive, limits={"height_m": limits["height_m"]})
    assert "✓ mount within tolerance" in card_text("run", replace(snapshot, drive=drive))


@pytest.mark.parametrize("kind", [k for k in faults.KINDS if k != "ramp"])
def test_frames_before_a_fault_are_as_without_it(kind: str) -> None:
    """What lets the page switch a fault on without computing the drive again."""
    fault = faults.fault_words(kind, "pitch", 0.3, 4, None)
    same = faults.same_before([fault.removeprefix("fault=")])
    assert same == 3
    plain, broken = (open_source(f"synthetic:plane?frames=6{more}") for more in ("", f"&{fault}"))
    a, b = plain[same - 1], broken[same - 1]
    np.testing.assert_array_equal(a.left, b.left)
    np.testing.assert_array_equal(a.right, b.right)
    assert faults.same_before(["ramp@3", "night@4"]) == 0


def test_the_paths_of_the_3d_view_are_told_by_their_colours() -> None:
    poses = {name: np.eye(4)[None] for name in ("ground_truth", "autocalibrated", "no_roll")}
    legend = path_legend(PathState(poses), {"no_roll": False})
    assert legend.count("━") == 1 and legend.count("┅") == 1
    assert legend.index("ground truth") < legend.index("autocalibrated")
    assert palette.css(palette.VARIANT["autocalibrated"]) in legend
    assert "no roll" not in legend and "live" not in legend
    assert path_legend(PathState(), {}) == ""
