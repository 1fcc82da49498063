"""The command line: commands, options and the help that explains them. Imports nothing heavy."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import NoReturn

from stereocalib_app.cli.help_texts import EXIT_CODES, SOURCE_HELP, TOP
from stereocalib_app.cli.values import frame, frames, kappa, names, port, positive, size, token
from stereocalib_core import __version__
from stereocalib_core.errors import ConfigError

SYNTH_KEYS = {
    "seed": ("N", "random seed"),
    "frames": ("N", "only the first N frames"),
    "path": ("FILE", "KITTI poses to drive along"),
    "camera": ("FILE", "camera.yaml of another camera than KITTI's"),
    "mount_height_m": ("M", "camera height (1.65)"),
    "mount_pitch_deg": ("DEG", "camera pitch, > 0 looks down (0.8)"),
    "mount_roll_deg": ("DEG", "camera roll (-0.4)"),
    "mount_yaw_deg": ("DEG", "camera yaw (-0.3)"),
    "traffic": ("X", "other cars, 0 off, 1 default"),
    "camber": ("X", "crowned road, 0 off, 1 default"),
    "noise": ("X", "sensor noise, 0 off, 1 default"),
    "exposure_difference": ("X", "between left and right, 0 off, 1 default"),
    "body_motion": ("X", "pitching and rolling of the car, 0 off, 1 default"),
    "lidar": ("0|1", "LiDAR scans too"),
}
DIALECTS = ("yaml", "opencv", "ros", "kalibr", "kitti")
EXPERIMENTS = ("roll", "height", "filter", "yaw", "odometry", "lidar-camera")


class _Help(argparse.RawDescriptionHelpFormatter):
    """Keeps the texts' own lines, and gives option names room beside their explanation."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog, max_help_position=30, width=96)
        self._action_max_length = 20  # argparse miscounts the indented commands

    def _format_action(self, action: argparse.Action) -> str:
        text = super()._format_action(action)
        if isinstance(action, argparse._SubParsersAction):  # drop the line that repeats "COMMAND"
            return text.partition("\n")[2]
        return text


class Parser(argparse.ArgumentParser):
    """Reports bad usage as every other error: one line, exit code 2."""

    def error(self, message: str) -> NoReturn:
        """Raise instead of printing the usage."""
        raise ConfigError("bad usage", message, f"see `{self.prog} --help`")


def build_parser() -> Parser:
    """The whole command line; each command's namespace carries its name as `command`."""
    parser = Parser(
        prog="stereocalib",
        description="How your stereo camera stands over the road: height, pitch, roll and yaw in every\n"
        "frame, the odometry they drive, and a browser page that shows it all.",
        epilog=TOP,
        formatter_class=_Help,
    )
    parser.add_argument("--version", action="version", version=f"stereocalib {__version__}")
    commands = parser.add_subparsers(
        dest="command", required=True, metavar="COMMAND", title="commands", parser_class=Parser
    )

    def add(name: str, help_text: str, example: str) -> Parser:
        return commands.add_parser(  # type: ignore[no-any-return]
            name,
            help=help_text,
            description=help_text[0].upper() + help_text[1:] + ".",
            epilog=f"example:\n  {example}\n\n"
            + (SOURCE_HELP + "\n" if "SOURCE" in help_text else "")
            + EXIT_CODES,
            formatter_class=_Help,
        )

    demo = add(
        "demo",
        "open the app on the embedded synthetic drive",
        "stereocalib demo --frames 120 --fault truck@40-46",
    )
    _add_server(demo)
    _add_tolerance(demo)
    _add_state(demo)
    _add_fault(demo)
    demo.add_argument("--frames", type=positive, metavar="N", help="only the first N frames")

    view = add("view", "open the app on SOURCE", "stereocalib view sequences/06")
    view.add_argument("source", metavar="SOURCE", help="a drive, or the output of an earlier run")
    _add_server(view)
    _add_tolerance(view)
    _add_own_calibration(view)
    _add_state(view)
    _add_run(
        add(
            "run",
            "measure SOURCE from end to end and write the numbers",
            "stereocalib run sequences/06 --out o",
        )
    )

    compare = add(
        "compare", "say what differs between two runs, with sigma", "stereocalib compare monday friday"
    )
    compare.add_argument("run_a", metavar="RUN_A", type=Path, help="output folder of a run")
    compare.add_argument("run_b", metavar="RUN_B", type=Path, help="output folder of another")
    compare.add_argument("--json", action="store_true", help="print JSON instead of a table")

    synth = add(
        "synth",
        "write a synthetic drive with its truth, in KITTI odometry layout",
        "stereocalib synth --out s --name curves --frames 200 --fault knock:pitch=0.3@80",
    )
    _add_out(synth)
    synth.add_argument("--name", default="town", help="town, curves, straight or plane (default: town)")
    for key, (metavar, text) in SYNTH_KEYS.items():
        spellings = list(dict.fromkeys([f"--{key}", f"--{key.replace('_', '-')}"]))
        synth.add_argument(*spellings, dest=key, metavar=metavar, help=text)
    _add_fault(synth)

    experiments = add(
        "experiments",
        "repeat the experiments of the papers, beside their numbers",
        "stereocalib experiments roll --out e",
    )
    experiments.add_argument("name", choices=(*EXPERIMENTS, "all"))
    _add_out(experiments)
    experiments.add_argument(
        "--source", metavar="SOURCE", help="a drive of your own instead of the default one"
    )

    _add_lidar(add)
    _add_calibration(add)
    batch = add(
        "batch",
        "run many drives, on several processes or machines",
        "stereocalib batch d/* --out b --workers 2",
    )
    batch.add_argument("sources", metavar="SOURCE", nargs="+", help="drives, see below")
    _add_out(batch)
    _add_own_calibration(batch)
    where = batch.add_mutually_exclusive_group()
    where.add_argument(
        "--workers", type=positive, metavar="N", help="local worker processes (default: one per core)"
    )
    where.add_argument(
        "--scheduler", metavar="ADDRESS", help="a running Dask scheduler, tls://HOST:PORT or tcp://HOST:PORT"
    )
    for name, what in (("ca", "of the authority"), ("cert", "of this client"), ("key", "of this client")):
        kind = "private key" if name == "key" else "certificate"
        batch.add_argument(f"--tls-{name}", type=Path, metavar="PEM", help=f"for tls://: the {kind} {what}")
    batch.add_argument("--method", choices=("direct", "paper"), default=None)
    return parser


def _add_own_calibration(parser: argparse._ActionsContainer) -> None:
    parser.add_argument(
        "--calibration",
        metavar="FILE",
        help="takes the place of the source's own: camera.yaml, OpenCV, ROS, Kalibr, EuRoC or KITTI, "
        "two files as a.yml,b.yml",
    )


def _add_calibration(add: object) -> None:
    convert = add(  # type: ignore[operator]
        "calibration",
        "write a calibration in another tool's dialect",
        "stereocalib calibration camchain.yaml --to opencv --out stereo.yml",
    )
    convert.add_argument(
        "input",
        metavar="IN",
        help="a file, two files a.yml,b.yml, a folder that holds one, or the output of a run "
        "(its mended calibration)",
    )
    convert.add_argument("--to", required=True, choices=DIALECTS, metavar="DIALECT", help=", ".join(DIALECTS))
    convert.add_argument(
        "--out", type=Path, required=True, metavar="PATH", help="the file, or a folder for the usual name"
    )
    convert.add_argument("--overwrite", action="store_true", help="replace files that are there")
    convert.add_argument(
        "--unit", choices=("m", "cm", "mm"), help="of its lengths, where the file leaves that open"
    )
    convert.add_argument(
        "--size", type=size, metavar="WIDTHxHEIGHT", help="of the pictures, where the file does not say"
    )


def _add_server(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--port", type=port, default=8080, metavar="P", help="default: 8080")
    parser.add_argument(
        "--host", default="127.0.0.1", metavar="H", help="default: 127.0.0.1, this machine only"
    )
    whose = parser.add_mutually_exclusive_group()
    whose.add_argument(
        "--token",
        type=token,
        metavar="T",
        help="what browsers must bring in the address (default: a random one with a --host beyond this machine)",
    )
    whose.add_argument("--no-token", action="store_true", help="let in whoever reaches this machine")


def _add_fault(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--fault",
        action="append",
        default=[],
        metavar="KIND[:axis=size]@A[-B]",
        help="knock drift rectification dirt glare drop swap freeze low_texture rain night truck ramp "
        "lidar_knock, from frame A on or up to B; may be given several times",
    )


def _add_tolerance(parser: argparse._ActionsContainer) -> None:
    parser.add_argument(
        "--tolerance", type=Path, metavar="FILE", help="nominal mount and tolerances to judge it by"
    )


def _add_state(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--at", type=frame, metavar="N", help="the frame to begin with")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="what the page is set to, as its Export tab writes it, e.g. preset=Debug, "
        "pitch_error_deg=0.5; may be given several times",
    )


def _add_out(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="output folder, new or empty")
    parser.add_argument("--overwrite", action="store_true", help="replace what an earlier call wrote there")


def _add_run(run: argparse.ArgumentParser) -> None:
    run.add_argument("source", metavar="SOURCE", help="a drive, see below")
    _add_out(run)
    run.add_argument("--resume", action="store_true", help="go on with a run that was stopped or killed")
    run.add_argument(
        "--frames", type=frames, default=(None, None), metavar="A:B", help="zero-based, half open"
    )
    method = run.add_argument_group("method")
    method.add_argument(
        "--method",
        choices=("direct", "paper"),
        default=None,
        help="direct: align the road plane on the pictures (default); "
        "paper: v-disparity line and roll at fixed disparity",
    )
    method.add_argument(
        "--matcher",
        metavar="NAME",
        default=None,
        help="what gives the dense disparity: sgbm (default), or MODULE:NAME of a Python module",
    )
    method.add_argument(
        "--config", type=Path, metavar="FILE", help="settings (YAML or JSON), any part of config.json"
    )
    method.add_argument(
        "--rig", type=Path, metavar="RIG.yaml", help="yaw, lever arm and mount from an earlier drive"
    )
    method.add_argument(
        "--self-calibrate",
        action="store_true",
        help="run again with what the drive showed of its own stereo pair (relative yaw, pitch, roll; depth scale by "
        "LiDAR): all numbers are then for the mended pair",
    )
    _add_tolerance(method)
    _add_own_calibration(method)
    output = run.add_argument_group("recording")
    output.add_argument("--rrd", action="store_true", help="write recording.rrd for the Rerun viewer")
    output.add_argument("--rerun", action="store_true", help="show the run live in the Rerun viewer")


def _add_lidar(add: object) -> None:
    lidar = add(  # type: ignore[operator]
        "lidar-camera",
        "calibrate a camera against a 3-D LiDAR from chessboard poses",
        "stereocalib lidar-camera boards --out c",
    )
    lidar.add_argument("folder", type=Path, metavar="DIR", help="images/ clouds/ camera.yaml board.yaml")
    _add_out(lidar)
    lidar.add_argument("--pairs", type=names, metavar="a,b,...", help="use only these")
    lidar.add_argument("--exclude", type=names, default=[], metavar="a,b,...", help="leave these out")
    lidar.add_argument(
        "--cropped", action="store_true", help="take clouds_cropped/, the board cut out already"
    )
    lidar.add_argument(
        "--intrinsics",
        choices=("fixed", "refine"),
        default="fixed",
        help="fixed: K and D of camera.yaml are held (default); refine: found together with the rest",
    )
    lidar.add_argument(
        "--kappa",
        type=kappa,
        default=None,
        metavar="auto|NUMBER",
        help="weight of LiDAR points against corners [px/m]; auto: by the noise of both (default)",
    )
    lidar.add_argument(
        "--accept",
        type=positive,
        metavar="N",
        help="trust a result on which N pairs agree, even where most pairs are refused",
    )
    synth = add(  # type: ignore[operator]
        "synth-boards",
        "write rendered pictures and clouds of chessboards, with their truth",
        "stereocalib synth-boards --out boards && stereocalib lidar-camera boards --out c",
    )
    _add_out(synth)
    synth.add_argument("--pairs", type=positive, default=12, metavar="N", help="how many (12)")
    synth.add_argument("--seed", type=frame, default=0, metavar="N", help="random seed (0)")
    synth.add_argument("--estimate", action="store_true", help="camera.yaml says model: estimate")
    view = add(  # type: ignore[operator]
        "view-lidar", "open the app on a set of chessboard poses", "stereocalib view-lidar boards"
    )
    view.add_argument("folder", type=Path, metavar="DIR")
    view.add_argument(
        "--watch", action="store_true", help="take in new pairs while the page is open: beside the rig"
    )
    _add_server(view)
