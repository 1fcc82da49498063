"""The tabs of the page of a camera and a LiDAR: pairs to tick, nudge, result, export."""

from __future__ import annotations

import shlex
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from stereocalib_app.boards.render import pair_row, thumbnail_rule
from stereocalib_app.boards.session import NO_NUDGE, LidarSession, LidarSnapshot, solved
from stereocalib_app.widgets import palette
from stereocalib_app.widgets.chart import Chart, ChartView, Curve
from stereocalib_app.widgets.copy_button import copy_button
from stereocalib_app.widgets.page_base import PageBase
from stereocalib_app.words import boards as lidar_words
from stereocalib_core.boards import Calibration, Detection, judge
from stereocalib_core.boards.pictures import before_and_after
from stereocalib_core.errors import OutputError
from stereocalib_core.files.boards import calibration_bytes

TURN_LIMIT_DEG, SHIFT_LIMIT_M = 2.0, 0.10
PLOT_PX = 120
NUDGES = (
    ("turn about x °", "the camera's right"),
    ("turn about y °", "the camera's down"),
    ("turn about z °", "the camera's view"),
    ("shift x m", "to the right"),
    ("shift y m", "downwards"),
    ("shift z m", "forwards"),
)


class PairsPanel:
    """Every pair with its thumbnail, its residuals and a tick. `tab`: where the rows of new pairs go."""

    def __init__(self, page: PageBase, session: LidarSession, tab: Any) -> None:
        gui, self._page, self._session, self._tab = page.gui, page, session, tab
        with tab:
            gui.add_markdown(
                "Untick a pair and the rest is solved again. Numbers: cloud to board, corners, normals."
            )
            self._all = gui.add_button("Use all pairs", hint="Tick every pair that the detection could use.")
            self._style: Any = gui.add_html("")
        page.on_click(self._all, lambda _value: session.change(excluded=frozenset()))
        self._rows: list[Any] = []
        self._ticks: list[Any] = []
        self._shown: list[str] = []
        self._names: tuple[str, ...] = ()
        self._build(session.snapshot)

    def _build(self, snapshot: LidarSnapshot) -> None:
        """A row for every name, in their order."""
        gui, folder = self._page.gui, self._session.folder
        for handle in (*self._rows, *self._ticks):
            handle.remove()
        self._rows, self._ticks = [], []
        with self._tab:
            for index, name in enumerate(folder.names):
                self._rows.append(gui.add_html(pair_row(snapshot, index, name)))
                tick = gui.add_checkbox(f"use {name}", True, hint="In or out of the solution.")
                self._ticks.append(tick)
                self._page.on_input(tick, partial(self._session.tick, name))
        self._shown = [""] * len(folder.names)
        self._names = folder.names
        self._styled = False

    def update(self, snapshot: LidarSnapshot) -> None:
        """Show what changed."""
        folder = self._session.folder
        if self._names != folder.names:
            self._build(snapshot)
        if not self._styled:
            rules = [thumbnail_rule(i, folder.images.get(n)) for i, n in enumerate(folder.names)]
            self._style.content = f"<style>{''.join(rules)}</style>"
            self._styled = True
        observations = None if snapshot.detection is None else snapshot.detection.observations
        for index, name in enumerate(folder.names):
            row = pair_row(snapshot, index, name)
            if row != self._shown[index]:
                self._rows[index].content = self._shown[index] = row
            usable = observations is None or observations[index].ok
            tick = self._ticks[index]
            wanted = usable and name not in self._session.wish.excluded
            if tick.value != wanted:
                tick.value = wanted
            if tick.disabled == usable:
                tick.disabled = not usable


class NudgePanel:
    """Six sliders that move the LiDAR by hand."""

    def __init__(self, page: PageBase, session: LidarSession) -> None:
        gui, self._session = page.gui, session
        gui.add_markdown(
            "Move the LiDAR by hand and watch the residuals: cloud and boards part at once where the set "
            "sees a direction well, and hardly where it does not."
        )
        self._state = gui.add_markdown("")
        self._sliders: list[Any] = []
        for index, (label, hint) in enumerate(NUDGES):
            limit, step = (TURN_LIMIT_DEG, 0.01) if index < 3 else (SHIFT_LIMIT_M, 0.001)
            slider = gui.add_slider(label, -limit, limit, step, 0.0, hint=f"Camera axes: {hint}.")
            self._sliders.append(slider)
            page.on_input(slider, partial(self._set, index))
        self._reset = gui.add_button("Back to the solution")
        page.on_click(self._reset, lambda _value: session.change(nudge=NO_NUDGE))

    def _set(self, index: int, value: float) -> None:
        values = list(self._session.wish.nudge)
        values[index] = float(value)
        self._session.change(nudge=tuple(values))

    def update(self, snapshot: LidarSnapshot) -> None:
        """Show the residuals; the sliders follow a reset."""
        self._state.content = lidar_words.nudge_words(snapshot)
        if snapshot.wish is not self._session.wish:
            return
        for slider, value in zip(self._sliders, snapshot.wish.nudge, strict=True):
            if slider.value != value:
                slider.value = value


class ResultPanel:
    """The transform, its sigma, the residuals, the way of the refinement."""

    def __init__(self, page: PageBase, session: LidarSession) -> None:
        gui = page.gui
        self._tables = gui.add_markdown("No result yet.")
        gui.add_markdown(
            "T_camera_lidar takes LiDAR points into the camera: X_camera = R X_lidar + t. Held out: each pair "
            "judged by the others."
        )
        refine = gui.add_checkbox(
            "Refine K and D too", False, hint="The camera's own calibration is found together with the rest."
        )
        kappa = gui.add_number(
            "κ [px/m]",
            0.0,
            min=0.0,
            step=0.5,
            hint="Weight of LiDAR points against corners; 0: by the noise of both.",
        )
        page.on_input(refine, lambda value: session.change(refine=bool(value)))
        page.on_input(kappa, lambda value: session.change(kappa=max(float(value), 0.0)))
        gui.add_markdown(
            "Below: the corner residual over the steps of the joint refinement. What falls with every step is the "
            "cost, corners and cloud together; the corners alone may get a little worse, because at the start each "
            "board stood where its own picture wanted it, and now it must please the cloud as well."
        )
        self._gui = gui
        self._plot: ChartView | None = None
        self._shown: Calibration | None = None
        self._holder = gui.add_folder("Refinement", expand_by_default=True)

    def update(self, snapshot: LidarSnapshot) -> None:
        """Show a new result."""
        self._tables.content = lidar_words.result_tables(snapshot)
        result = snapshot.result
        if result is None or result is self._shown or not result.iterations:
            return
        self._shown = result
        if self._plot is not None:
            self._plot.show(_iteration_chart(result))
            return
        with self._holder:
            self._plot = ChartView(self._gui, _iteration_chart(result), PLOT_PX)


def _iteration_chart(result: Calibration) -> Chart:
    """Corner residual over the steps of the refinement."""
    rms = np.array([i.reprojection_rms_px for i in result.iterations])
    step = np.arange(len(rms), dtype=np.float64)
    span = max(float(rms.max() - rms.min()), 0.02)
    y_range = float(rms.min()) - 0.2 * span, float(rms.max()) + 0.2 * span
    curve = Curve("corners px", rms, palette.RAW, width=2.0, marks=True)
    return Chart(step, (curve,), (), y_range, "corners px", "step", "steps")


class ExportPanel:
    """Files, the ROS 2 command, and the command that reproduces the result."""

    def __init__(self, page: PageBase, session: LidarSession) -> None:
        gui, self._session = page.gui, session
        gui.add_markdown("The solved result with the ticks as they are; a nudge is not exported.")
        for label, name, make in (
            ("Calibration, JSON", "calibration.json", self._calibration),
            ("Overlay of this pair, PNG", "overlay.png", self._overlay),
            ("ROS 2 static transform, sh", "static_transform.sh", self._ros2),
        ):
            page.on_download(gui.add_button(label), name, make)
        self._copy_ros2, self._ros2_text = gui.add_html(""), gui.add_markdown("")
        self._copy_line, self._line = gui.add_html(""), gui.add_markdown("")
        self._shown: Calibration | None = None

    def _solved(self) -> tuple[Detection, Calibration]:
        now = self._session.snapshot
        if now.detection is None or now.result is None:
            raise OutputError(
                "no result yet", "export", "wait until the boards are found, and tick some pairs"
            )
        return now.detection, now.result

    def _calibration(self) -> bytes:
        """As `stereocalib lidar-camera` writes it, with the next pose that the page shows, however good the set is."""
        detection, _ = self._solved()
        wish = self._session.snapshot.wish
        return calibration_bytes(judge(detection, solved(detection, wish), advise=True))

    def _overlay(self) -> bytes:
        detection, result = self._solved()
        observation = detection.observations[self._session.snapshot.wish.pair]
        files = self._session.files(observation.name)
        if files.picture is None or files.cloud is None:
            raise OutputError("no overlay of this pair", observation.name, files.problem or "choose another")
        drawn = before_and_after(files.picture, files.cloud, result, observation, detection.board)
        ok, data = cv2.imencode(".png", drawn)
        if not ok:
            raise OutputError("picture cannot be encoded", observation.name, "choose another pair")
        return bytes(data.tobytes())

    def _ros2(self) -> bytes:
        return f"#!/bin/sh\n{self._solved()[1].ros2_static_transform()}\n".encode()

    def update(self, snapshot: LidarSnapshot) -> None:
        """Show the commands of a new result."""
        if snapshot.result is None or snapshot.result is self._shown:
            return
        self._shown = snapshot.result
        ros2 = snapshot.result.ros2_static_transform()
        self._copy_ros2.content = copy_button("Copy the ROS 2 command", ros2)
        self._ros2_text.content = f"```\n{ros2}\n```\nParent: the camera's optical frame; child: the LiDAR."
        line = command(self._session.path, snapshot.solved_for)
        self._copy_line.content = copy_button("Copy the command that reproduces this", line)
        self._line.content = f"```\n{line.replace('`', ' ')}\n```"


def command(path: Path, excluded: frozenset[str]) -> str:
    """The command line that gives the result on show."""
    parts = ["stereocalib", "lidar-camera", str(path), "--out", f"{path.resolve().name}-calibration"]
    if excluded:
        parts += ["--exclude", ",".join(sorted(excluded))]
    return shlex.join(parts)
