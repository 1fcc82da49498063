"""Open another drive from the page: a path below the root that the server was given, or a small zip."""

from __future__ import annotations

from typing import Any

from stereocalib_app.drive import exports
from stereocalib_app.drive.moment import Moment
from stereocalib_app.drive.panel import Host
from stereocalib_app.drive.summary import difference_table
from stereocalib_app.widgets import palette, text
from stereocalib_app.widgets.tables import color_key, note
from stereocalib_core.errors import StereoCalibError
from stereocalib_core.results import Drive


class OpenPanel:
    """A tab of the main panel."""

    def __init__(self, host: Host) -> None:
        self._host = host
        gui = host.gui
        root = host.doors.root
        gui.add_markdown(
            "A folder (KITTI odometry, KITTI raw, plain `left/ right/ camera.yaml`), an earlier run, or "
            f"`synthetic`. Paths are read below\n\n{text.code(root, 120)}"
        )
        gui.add_html("<stereocalib-shelf></stereocalib-shelf>")
        self._path = gui.add_text(
            "Source", "", hint="A path below the folder above, or synthetic:town?frames=200"
        )
        self._open = gui.add_button("Open")
        self._upload = gui.add_upload_button(
            "Upload a zip",
            mime_type=".zip,application/zip",
            hint="A plain folder or KITTI sequence, at most 200 MB.",
        )
        self._state = gui.add_markdown("")
        with gui.add_folder("Compare with an earlier run"):
            self._compare = gui.add_text(
                "Run", "", hint="The output folder of an earlier run; empty takes it away."
            )
            self._lay = gui.add_button("Compare side by side")
            self._away = gui.add_button("Take the other run away", visible=False)
            self._legend = gui.add_html("")
            self._difference = gui.add_html("")
        self._compared: Drive | None = None
        self._done = False
        host.on_click(self._open, lambda _: host.doors.open(self._path.value))
        host.on_click(self._lay, lambda _: host.doors.compare(self._compare.value))
        host.on_click(self._away, lambda _: host.doors.compare(""))

        @self._upload.on_upload
        def _(event: Any) -> None:
            host.run_for_client(event, lambda _client: host.doors.open_upload(event.target.value))

    def update(self, moment: Moment) -> None:
        """Say what the source lacks."""
        if moment.drive_changed:
            notices = moment.session.source.notices
            self._state.content = "\n".join(f"- {text.escape(line)}" for line in notices[:12])
        if moment.compared is not self._compared or (
            moment.compared is not None and moment.snapshot.done != self._done
        ):
            self._compared, self._done = moment.compared, moment.snapshot.done
            beside = moment.compared is not None
            self._away.visible = beside
            mark = ("┅", palette.COMPARED, "other run, in time line and 3-D")
            self._legend.content = color_key("Beside this drive", [mark]) if beside else ""
            self._difference.content = (
                "" if moment.compared is None else self._compare_html(moment, moment.compared)
            )

    def _compare_html(self, moment: Moment, other: Drive) -> str:
        try:
            return difference_table(
                exports.difference(moment.session, moment.snapshot, moment.settings, other)
            )
        except StereoCalibError as error:
            return note(str(error))
