"""Faults of the synthetic drive, switched on from the page at a frame of choice."""

from __future__ import annotations

from stereocalib_app.drive.moment import Moment
from stereocalib_app.drive.panel import Host
from stereocalib_app.widgets import text
from stereocalib_core.errors import ConfigError
from stereocalib_core.simulator.faults import parse_fault

KINDS = (
    *("knock", "drift", "rectification", "dirt", "glare", "drop", "swap", "freeze"),
    *("low_texture", "rain", "night", "truck", "ramp"),
)
AXES = ("pitch", "roll", "yaw", "height", "x", "z")
WITH_AXIS = ("knock", "drift", "rectification")
AXES_OF_PAIR = ("pitch", "roll")


def fault_words(kind: str, axis: str, size: float, first: int, last: int | None) -> str:
    """The fault as a key of a synthetic SOURCE."""
    if kind not in KINDS:
        raise ConfigError(f"fault {kind}", "page", f"one of {' '.join(KINDS)}")
    what = kind
    if kind in WITH_AXIS:
        if kind == "rectification" and axis not in AXES_OF_PAIR:
            raise ConfigError(f"a rectification fault in {axis}", "page", "choose pitch or roll")
        what = f"{kind}:{axis}={size:g}"
    return f"fault={what}@{first}" + ("" if last is None else f"-{last}")


def with_fault(spec: str, fault: str) -> str:
    """A synthetic SOURCE with one more fault."""
    return spec + ("&" if "?" in spec else "?") + fault


def without_faults(spec: str) -> str:
    """A synthetic SOURCE as it was before its faults."""
    head, _, query = spec.partition("?")
    kept = [part for part in query.split("&") if part and not part.startswith("fault=")]
    return head + ("?" + "&".join(kept) if kept else "")


def faults_of(spec: str) -> list[str]:
    """The faults of a SOURCE."""
    return [part[6:] for part in spec.partition("?")[2].split("&") if part.startswith("fault=")]


def same_before(faults: list[str]) -> int:
    """The first frame that any of these faults changes."""
    found = [parse_fault(fault) for fault in faults]
    # A ramp is built into the road, and seen long before it is reached; the exposure of the frame before a knock
    # ends on the way to it.
    return min((0 if fault.kind == "ramp" else max(0, fault.first - 1) for fault in found), default=0)


class FaultsPanel:
    """A folder of Debug, for synthetic drives only."""

    def __init__(self, host: Host) -> None:
        self._host = host
        gui = host.gui
        self._kind = gui.add_dropdown("Fault", KINDS, hint="What goes wrong, from the frame on show onwards.")
        self._axis = gui.add_dropdown("Axis", AXES, hint="For knock, drift and rectification.")
        self._size = gui.add_number("Size", 0.5, step=0.05, hint="Degrees, or metres for height, x and z.")
        self._length = gui.add_number("Frames", 0, min=0, step=1, hint="How long it lasts; 0 = to the end.")
        self._buttons = gui.add_button_group("", ("Switch on", "All off"))
        self._state = gui.add_markdown("")
        host.on_click(self._buttons, self._press)

    def _press(self, button: str) -> None:
        host = self._host
        spec, frame, first = host.session.spec, host.playback.state.frame, self._first_frame()
        if button == "All off":
            wanted, changed = without_faults(spec), faults_of(spec)
        else:
            length = int(self._length.value)
            last = None if length <= 0 else first + frame + length - 1
            fault = fault_words(
                self._kind.value, self._axis.value, float(self._size.value), first + frame, last
            )
            wanted, changed = with_fault(spec, fault), [fault.removeprefix("fault=")]
        host.doors.reopen(wanted, frame, max(0, same_before(changed) - first))

    def _first_frame(self) -> int:
        """The drive's number of the page's frame 0."""
        frames = self._host.session.frames
        return 0 if frames is None else frames[0]

    def update(self, moment: Moment) -> None:
        """Name the faults that are on."""
        faults = faults_of(moment.session.spec)
        self._state.content = "On: " + ", ".join(text.code(f, 80) for f in faults) if faults else "None on."
