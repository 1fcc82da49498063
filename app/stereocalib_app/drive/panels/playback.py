"""How the drive plays: speed, round and round, stopping at failures."""

from __future__ import annotations

from stereocalib_app.drive.moment import Moment
from stereocalib_app.drive.panel import Host
from stereocalib_app.widgets.style import chosen, style_sheet

SPEEDS = ("¼×", "½×", "1×", "2×", "4×")
SPEED_OF = dict(zip(SPEEDS, (0.25, 0.5, 1.0, 2.0, 4.0), strict=True))
SPEED_NAME = {speed: name for name, speed in SPEED_OF.items()}


def speed_mark(speed: float) -> str:
    """HTML that fills in the button of a speed."""
    return chosen(SPEEDS.index(SPEED_NAME[speed])) + style_sheet()


class PlaybackPanel:
    """A tab below the 3-D view."""

    def __init__(self, host: Host) -> None:
        gui, clock = host.gui, host.playback
        self._chosen_speed = gui.add_html(speed_mark(1.0))
        self._speed = gui.add_button_group("Speed", SPEEDS, hint="1× is the recording's own pace.")
        self._loop = gui.add_checkbox("Loop", False, hint="Start over at the end of the drive.")
        self._pause = gui.add_checkbox(
            "Pause on failure", False, hint="Playback stops at the next frame that failed."
        )
        gui.add_markdown(
            "Keys: **Space** play · **N** / **P** step · **Shift+N** / **Shift+P** ten · "
            "**F** next failure · **Home** / **End** · **1**–**3** presets · **Ctrl+K** every command"
        )
        host.on_click(self._speed, lambda value: clock.set_speed(SPEED_OF[value]))
        host.on_input(self._loop, clock.set_loop)
        host.on_input(self._pause, clock.set_pause_on_failure)

    def update(self, moment: Moment) -> None:
        """Show how the clock is set."""
        if moment.clock.speed in SPEED_NAME:
            self._chosen_speed.content = speed_mark(moment.clock.speed)
        self._loop.value = moment.clock.loop
        self._pause.value = moment.clock.pause_on_failure
