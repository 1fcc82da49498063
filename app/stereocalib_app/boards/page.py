"""The page of a camera and a LiDAR: lays out the panels and keeps them on the session's snapshot."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import viser

from stereocalib_app.boards.panels import ExportPanel, NudgePanel, PairsPanel, ResultPanel
from stereocalib_app.boards.render import WIDTH_PX, cloud_over_picture, one_over_the_other
from stereocalib_app.boards.scene import LidarScene, look_from
from stereocalib_app.boards.session import COMPARISONS, LidarSession, LidarSnapshot
from stereocalib_app.server.browser_panel import light_switch
from stereocalib_app.server.docking import MAIN_WIDTH_PX, SCENE_WIDTH_PX
from stereocalib_app.server.viser_internals import set_width
from stereocalib_app.widgets import canvas
from stereocalib_app.widgets.page_base import PageBase, set_theme
from stereocalib_app.widgets.picture import PictureView
from stereocalib_app.widgets.style import style_sheet
from stereocalib_app.words import boards as lidar_words

VIEWS_WIDTH_PX, PAIR_WIDTH_PX = (260, 430), (300, 440)
"""Least and usual width of the pictures and of the panel that chooses a pair: as much as a window leaves them."""
MARGIN_PX = 8
OPENING_S = 15.0
"""A browser says how wide its 3-D view is when it first draws it, seconds after it has connected."""
STAGES = ("reading pairs", "searching boards in clouds", "measuring boards in clouds")


def views_width(room_px: int) -> int:
    """Width of the docked pictures in the room that the main panel leaves, so that the 3-D view keeps its own."""
    return int(np.clip(room_px - SCENE_WIDTH_PX, *VIEWS_WIDTH_PX))


def chooser_width(between_px: int) -> int:
    """Width of the floating panel that chooses a pair, between the docked ones."""
    return int(np.clip(between_px - 2 * MARGIN_PX, *PAIR_WIDTH_PX))


class LidarPage(PageBase):
    """Shared by all browsers; drawn by the session's worker alone."""

    def __init__(self, server: viser.ViserServer, session: LidarSession) -> None:
        super().__init__(server.gui)
        self.server, self.session = server, session
        self._drawn: tuple[Any, ...] = ()
        self._looked = False
        set_theme(self.gui)
        server.initial_camera.up = (0.0, -1.0, 0.0)
        server.initial_camera.position = (-2.6, -2.2, -2.4)
        server.initial_camera.look_at = (0.0, 0.0, 2.0)
        with server.atomic():
            self._build_views()
            self._build_main(session)
            self._build_slider()
            self.scene = LidarScene(server, self._board_clicked)
        self._commands()
        server.on_client_connect(self._greet)
        session.show = self.update

    def _greet(self, client: viser.ClientHandle) -> None:
        """What belongs to one browser alone: its theme, and panels that fit its window."""
        with client.gui.add_folder("This browser", expand_by_default=False, order=1e6):
            light_switch(client.gui)
        views, chooser = VIEWS_WIDTH_PX[1], PAIR_WIDTH_PX[1]
        since = time.monotonic()

        def fit(camera: viser.CameraHandle) -> None:
            nonlocal views, chooser
            between = int(camera.image_width)
            wanted = views_width(between + views)
            # While the page opens only: a width that somebody has dragged must stay.
            if wanted < views and time.monotonic() - since < OPENING_S:
                set_width(client, self.gui, self._views, wanted)
                between, views = between + views - wanted, wanted
            if (wide := chooser_width(between)) != chooser:
                chooser = wide
                set_width(client, self.gui, self._chooser, wide)

        client.camera.on_update(fit)
        fit(client.camera)

    def _build_views(self) -> None:
        gui = self.gui
        panel: Any = gui.add_panel()
        panel.dock_left()
        panel.set_width(VIEWS_WIDTH_PX[1])
        self._views = panel
        with panel.add_tab("Cloud on picture"):
            self._close_up: Any = gui.add_checkbox("Close-up", False, hint="Only the board, larger.")
            self._compare: Any = gui.add_dropdown(
                "Before and after",
                COMPARISONS,
                hint="What moves between two pictures in one place, the eye sees at once.",
            )
            self._after = PictureView(gui, WIDTH_PX)
            self._before = PictureView(gui, WIDTH_PX)
            self._overlay: Any = gui.add_html("", visible=False)
            self._explain = gui.add_markdown(
                "Near points are red, far ones blue. A good calibration puts the jump in range on the board's "
                "edge. The linear solution is where the refinement starts."
            )
            gui.add_html(style_sheet())
        self.on_input(self._close_up, lambda value: self.session.change(close_up=value))
        self.on_input(self._compare, lambda value: self.session.change(compare=str(value)))
        with panel.add_tab("3-D"):
            boxes = [
                gui.add_checkbox(label, True, hint=hint)
                for label, hint in (
                    ("Whole cloud", "The scan of this pair, near is bright."),
                    ("Board points", "Cloud points on the boards; this pair's are gold."),
                    (
                        "Normals",
                        "Each board's normal: green as the camera sees it, orange as the LiDAR does.",
                    ),
                    ("σ ellipsoid", "One sigma of the LiDAR's place, enlarged as its label says."),
                )
            ]
            gui.add_markdown(
                "Outlines are boards as the camera sees them: green used, orange refused, grey left out, gold "
                "this pair. Click a board's centre to go to it."
            )
        self._options = boxes
        for box in boxes:
            self.on_input(box, lambda _value: self.session.change())

    def _build_main(self, session: LidarSession) -> None:
        gui = self.gui
        gui.main_panel.dock_right()
        gui.main_panel.set_width(MAIN_WIDTH_PX)
        self._headline: Any = gui.add_markdown("")
        self._progress: Any = gui.add_progress_bar(0.0)
        self._verdict = gui.add_markdown("")
        gui.add_html(style_sheet())
        self._parts: list[Any] = []
        tabs: Any = gui.add_tab_group()
        self._parts.append(PairsPanel(self, session, tabs.add_tab("Pairs")))
        for name, part in (("Result", ResultPanel), ("Nudge", NudgePanel), ("Export", ExportPanel)):
            with tabs.add_tab(name):
                self._parts.append(part(self, session))

    def _build_slider(self) -> None:
        gui, count = self.gui, self._count()
        panel: Any = gui.add_panel()
        panel.float(x=MARGIN_PX, y=-MARGIN_PX, width=PAIR_WIDTH_PX[1])
        self._chooser = panel
        with panel.add_tab("Pair"):
            self._slider: Any = gui.add_slider("Pair", 1, max(count, 2), 1, 1)
            self._steps = gui.add_button_group("", ("◀ previous", "next ▶", "tick in or out"))
            self._words = gui.add_markdown("")
        self.on_input(
            self._slider, lambda value: self.session.change(pair=min(int(value), self._count()) - 1)
        )
        self.on_click(self._steps, self._press)

    def _count(self) -> int:
        return len(self.session.folder.names)

    def _press(self, name: str) -> None:
        if name == "tick in or out":
            self.toggle()
        else:
            self.session.step(1 if name == "next ▶" else -1)

    def toggle(self) -> None:
        """Take the pair on show in or out."""
        wish = self.session.wish
        name = self.session.folder.names[wish.pair]
        self.session.tick(name, name in wish.excluded)

    def _commands(self) -> None:
        for label, key, action in (
            ("Next pair", "N", lambda: self.session.step(1)),
            ("Previous pair", "P", lambda: self.session.step(-1)),
            ("Tick this pair in or out", "T", self.toggle),
        ):
            handle: Any = self.gui.add_command(label, hotkey=key)  # type: ignore[arg-type]
            handle.on_trigger(
                lambda event, action=action: self.run_for_client(event, lambda _client: action())
            )

    def _board_clicked(self, event: Any, index: int) -> None:
        self.run_for_client(event, lambda _client: self.session.change(pair=index))

    # --- what is shown

    def update(self, snapshot: LidarSnapshot) -> None:
        """Called by the session's worker only: numbers first, pictures after them."""
        name = self.session.folder.names[snapshot.wish.pair]
        with self.server.atomic():
            if self._slider.max != max(self._count(), 2):
                self._slider.max = max(self._count(), 2)
            self._headline.content = lidar_words.headline(
                snapshot, self.session.path.resolve().name, self.session.watching is not None
            )
            self._show_progress(snapshot)
            self._verdict.content = lidar_words.verdict(snapshot)
            self._words.content = lidar_words.pair_words(snapshot, name)
            if snapshot.wish is self.session.wish:
                self._align(snapshot)
            for part in self._parts:
                part.update(snapshot)
        self.server.flush()
        if snapshot.detection is None or snapshot.stage != "ready":
            return
        files = self.session.files(name)
        options = tuple(bool(box.value) for box in self._options)
        with self.server.atomic():
            self.scene.update(snapshot, name, files, options)  # type: ignore[arg-type]
            self._show_pictures(snapshot, name)
        self.server.flush()
        self._look(snapshot)

    def _align(self, snapshot: LidarSnapshot) -> None:
        """The inputs follow what another browser, a key or a click in 3-D has changed."""
        for handle, value in (
            (self._slider, snapshot.wish.pair + 1),
            (self._close_up, snapshot.wish.close_up),
            (self._compare, snapshot.wish.compare),
        ):
            if handle.value != value:
                handle.value = value

    def _show_progress(self, snapshot: LidarSnapshot) -> None:
        stage = STAGES.index(snapshot.stage) if snapshot.stage in STAGES else 0
        share = (stage + snapshot.done / max(snapshot.total, 1)) / len(STAGES)
        self._progress.value = 100.0 * min(share, 1.0)
        self._progress.visible = snapshot.busy

    def _show_pictures(self, snapshot: LidarSnapshot, name: str) -> None:
        detection, result = snapshot.detection, snapshot.result
        key = (name, result, snapshot.trial, snapshot.wish.close_up, snapshot.wish.compare)
        same = len(self._drawn) == len(key) and all(a is b for a, b in zip(self._drawn, key, strict=True))
        if detection is None or same:
            return
        files, index = self.session.files(name), snapshot.wish.pair
        if result is None:
            blank = canvas.notice(WIDTH_PX, 380, "no result", "tick some pairs")
            for handle in (self._after, self._before):
                handle.show(canvas.encode_jpeg(blank))
                handle.visible = True
            self._overlay.visible = False
            self._drawn = key
            return
        after = result.T_camera_lidar if snapshot.trial is None else snapshot.trial.T_camera_lidar
        pair, observation = result.pairs[index], detection.observations[index]
        views = (
            (
                (self._after, after, "After", "refined solution")
                if snapshot.trial is None
                else (self._after, after, "Nudged", "by hand from the refined solution")
            ),
            (self._before, result.linear, "Before", "linear solution"),
        )
        for handle, T, title, note in views:
            picture = cloud_over_picture(
                files, observation, pair, T, result.camera, detection.board, title, f"{name} · {note}",
                snapshot.wish.close_up,
            )  # fmt: skip
            handle.show(canvas.encode_jpeg(picture))
        apart = snapshot.wish.compare == COMPARISONS[0]
        self._after.visible = self._before.visible = apart
        self._overlay.visible = not apart
        self._overlay.content = (
            "" if apart else one_over_the_other(self._before.jpeg, self._after.jpeg, snapshot.wish.compare)
        )
        self._drawn = key

    def _look(self, snapshot: LidarSnapshot) -> None:
        """Once, with the first result: turn every browser to the boards."""
        if self._looked or snapshot.result is None:
            return
        self._looked = True
        position, target = look_from(snapshot)
        self.server.initial_camera.position, self.server.initial_camera.look_at = position, target
        for client in self.server.get_clients().values():
            client.camera.position, client.camera.look_at = position, target
