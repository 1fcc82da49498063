"""What each command does: reads its arguments, calls the core, prints a summary.

Every function returns None, or why the result must not be trusted. Heavy imports are inside, so that a
command loads only what it needs.
"""

from __future__ import annotations

import argparse
import dataclasses
import importlib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from stereocalib_app.cli.arguments import EXPERIMENTS, SYNTH_KEYS
from stereocalib_app.cli.progress import terminal_progress
from stereocalib_core.errors import ConfigError, SourceError

if TYPE_CHECKING:
    from stereocalib_core.results import Drive, OdometryErrors


def demo(arguments: argparse.Namespace) -> str | None:
    """The app on the synthetic drive."""
    keys = [] if arguments.frames is None else [f"frames={arguments.frames}"]
    keys += [f"fault={fault}" for fault in arguments.fault]
    _serve("synthetic:town" + ("?" if keys else "") + "&".join(keys), arguments)
    return None


def view(arguments: argparse.Namespace) -> str | None:
    """The app on any source."""
    _serve(_with_calibration(arguments.source, arguments), arguments)
    return None


def _compile(spec: str | None, frames_first: bool = False) -> None:
    """What a drive from this source needs, compiled where it is not yet.

    frames_first: the command looks at all frames before it needs more than them.
    """
    from stereocalib_core.sources import source_kind
    from stereocalib_core.system.compiled import AFTER, DRIVE, FRONT, compile_once

    if spec is not None:
        source_kind(spec)  # what is no drive is said first
    drive = FRONT if frames_first else DRIVE
    rooms = ("boards",) if spec is None else drive + ("simulator",) * spec.startswith("synthetic")
    with terminal_progress() as progress:
        later = AFTER if frames_first else ()
        compile_once(rooms, _say, progress, later)


def _say(line: str) -> None:
    print(f"stereocalib: {line}", file=sys.stderr)


def _serve(spec: str, arguments: argparse.Namespace) -> None:
    from stereocalib_core.files.tolerance import read_tolerances

    limits = read_tolerances(arguments.tolerance) if arguments.tolerance else {}
    settings = importlib.import_module("stereocalib_app.drive.page_words").from_words(arguments.set)
    _compile(spec)
    server = importlib.import_module("stereocalib_app.drive.serve")
    how = server.Opening(
        limits=limits,
        tolerance=arguments.tolerance,
        settings=settings,
        frame=arguments.at,
        token=_token(arguments),
    )
    server.serve(spec, arguments.host, arguments.port, how)


def _token(arguments: argparse.Namespace) -> str | None:
    """What browsers must bring: what was said, or a random one where other machines reach the page."""
    import secrets

    from stereocalib_app.server.security import LOCAL_NAMES

    if arguments.no_token or arguments.token is not None:
        return arguments.token  # type: ignore[no-any-return]
    return None if arguments.host in LOCAL_NAMES else secrets.token_urlsafe(16)


def _with_calibration(spec: str, arguments: argparse.Namespace) -> str:
    """The source with the calibration of `--calibration`, where that is given."""
    from stereocalib_core.sources import with_calibration

    return with_calibration(spec, arguments.calibration)


def run(arguments: argparse.Namespace) -> str | None:
    """One drive from end to end."""
    from stereocalib_core import config as settings
    from stereocalib_core.files.io import read_rig
    from stereocalib_core.files.tolerance import read_tolerances
    from stereocalib_core.run.drive import run_drive

    config = settings.load(arguments.config) if arguments.config else settings.PipelineConfig()
    if arguments.method:
        config = dataclasses.replace(config, method=arguments.method)
    if arguments.matcher:
        disparity = dataclasses.replace(config.disparity, matcher=arguments.matcher)
        config = dataclasses.replace(config, disparity=disparity)
    rig = read_rig(arguments.rig) if arguments.rig else None
    tolerances = read_tolerances(arguments.tolerance) if arguments.tolerance else None
    source = _with_calibration(arguments.source, arguments)
    _compile(source, frames_first=True)
    with terminal_progress() as progress:
        drive = run_drive(
            source,
            arguments.out,
            arguments.frames,
            config,
            rig,
            tolerances,
            rrd=arguments.rrd,
            rerun=arguments.rerun,
            overwrite=arguments.overwrite,
            resume=arguments.resume,
            self_calibrate=arguments.self_calibrate,
            progress=progress,
        )
    _print_run(drive, arguments.out)
    return drive.why_not


def _print_run(drive: Drive, out: Path) -> None:
    from stereocalib_app.words.answer import answer
    from stereocalib_core.results import BEST, TO_DEGREES

    speed = drive.timing.frames_per_second or float("nan")
    print(f"{drive.frames_ok} of {len(drive.frames)} frames ok, {speed:.1f} a second, {out}/report.json")
    spreads = drive.frames.statistics(TO_DEGREES).values()
    for (label, unit), spread in zip(
        (("height", "m"), ("pitch", "deg"), ("roll", "deg")), spreads, strict=True
    ):
        if spread.median is not None:
            print(f"  {label:<7} {spread.median:8.4f} {unit:<3}  std {spread.std:.4f}")
    yaw = drive.mount.yaw_rad
    if yaw is not None:
        value, sigma = TO_DEGREES[1] * yaw.value, TO_DEGREES[1] * yaw.sigma
        print(f"  yaw     {value:8.4f} deg  sigma {sigma or float('nan'):.4f}")
    if BEST in drive.paths:
        print(f"  path    {_path_words(drive.paths[BEST].errors)}")
    if drive.mount.note is not None:
        print(f"  mount   {drive.mount.note}")
    for text in drive.notices:
        print(f"  note: {text}")
    for line in answer(drive, out):
        print(line)


def _path_words(errors: OdometryErrors) -> str:
    """Length and errors of the path; on a closed loop the final error hides a wrong scale, t_rel does not."""
    if errors.path_m is None:
        return f"      -   a gap: {errors.measured_percent or 0.0:.0f} % of the way was measured on the road"
    line = f"{errors.path_m:8.2f} m"
    if errors.final_translation_m is not None:
        line += (
            f"    final error {errors.final_translation_m:.2f} m, {errors.final_translation_percent:.2f} %"
        )
    if errors.t_rel_percent is not None:
        line += f"    t_rel {errors.t_rel_percent:.2f} %"
    return line


def compare(arguments: argparse.Namespace) -> str | None:
    """Two runs side by side."""
    import json

    from stereocalib_core.files.difference import difference_of
    from stereocalib_core.files.run_folder import load_run
    from stereocalib_core.run import compare as comparing

    names = str(arguments.run_a), str(arguments.run_b)
    difference = comparing.compare(load_run(arguments.run_a), load_run(arguments.run_b))
    if arguments.json:
        print(json.dumps(difference_of(difference, *names), indent=2))
    else:
        print(comparing.describe(difference, *names))
    return None


def synth(arguments: argparse.Namespace) -> str | None:
    """A synthetic drive to files."""
    from stereocalib_core.files.output_folder import new_output

    options = {key: value for key in SYNTH_KEYS if (value := getattr(arguments, key)) is not None}
    writer = importlib.import_module("stereocalib_core.run.synth")
    with (
        new_output(arguments.out, ("sequences", "poses"), arguments.overwrite) as out,
        terminal_progress() as bar,
    ):
        writer.synth(out, arguments.name, options, arguments.fault, bar)
    print(f"{arguments.out}/sequences/00")
    return None


def experiments(arguments: argparse.Namespace) -> str | None:
    """The papers' experiments."""
    from stereocalib_core.files.output_folder import new_output

    names = EXPERIMENTS if arguments.name == "all" else (arguments.name,)
    owned = tuple(f"{name}*.{suffix}" for name in EXPERIMENTS for suffix in ("json", "md", "png"))
    with new_output(arguments.out, owned, arguments.overwrite) as out, terminal_progress() as progress:
        for name in names:
            module = importlib.import_module(f"stereocalib_core.experiments.{name.replace('-', '_')}")
            # with `all` a source goes to the experiments that drive along one
            source = None if arguments.name == "all" and not module.TAKES_DRIVE else arguments.source
            module.run(out, source, progress)
    for name in names:
        print(f"{arguments.out}/{name}.json")
    return None


def lidar_camera(arguments: argparse.Namespace) -> str | None:
    """A camera against a LiDAR."""
    from stereocalib_core.boards import lines
    from stereocalib_core.files.output_folder import new_output

    _need_folder(arguments.folder)
    package = importlib.import_module("stereocalib_core.run.boards")
    nothing: SourceError | None = None
    with (
        new_output(arguments.out, package.FILES, arguments.overwrite) as out,
        terminal_progress() as progress,
    ):
        stages = None if progress is None else lambda what, done, total: progress(done, total, what)
        try:
            answer = package.run(
                arguments.folder,
                out,
                arguments.pairs,
                arguments.exclude,
                arguments.cropped,
                stages,
                with_intrinsics=arguments.intrinsics == "refine",
                kappa=arguments.kappa,
                accept=arguments.accept,
            )
        except package.NothingToSolve as error:
            nothing = error  # the reasons are in the folder, which must stay
    if nothing is not None:
        raise nothing
    print("\n".join(lines(answer, package.files_of(arguments.out))))
    return None if answer.trusted else f"{answer.calibration.verdict}: {answer.why}"


def synth_boards(arguments: argparse.Namespace) -> str | None:
    """Rendered pictures and clouds of boards, with their truth."""
    from stereocalib_core.files.output_folder import new_output

    module = importlib.import_module("stereocalib_core.boards.synth")
    settings = module.SynthSettings(
        arguments.pairs, arguments.seed, camera_as="estimate" if arguments.estimate else "pinhole"
    )
    owned = ("images", "clouds", "camera.yaml", "board.yaml", "truth.json")
    with new_output(arguments.out, owned, arguments.overwrite) as out, terminal_progress() as progress:
        stages = None if progress is None else lambda what, done, total: progress(done, total, what)
        module.write_set(out, settings, stages)
    print(f"{arguments.out}: {arguments.pairs} pairs and truth.json")
    return None


def view_lidar(arguments: argparse.Namespace) -> str | None:
    """The app on chessboard poses."""
    _need_folder(arguments.folder)
    importlib.import_module("stereocalib_app.boards.serve").serve(
        arguments.folder, arguments.host, arguments.port, _token(arguments), arguments.watch
    )
    return None


def _need_folder(folder: Path) -> None:
    if not folder.is_dir():
        raise SourceError("no such folder", folder, "name one with images/ clouds/ camera.yaml board.yaml")


def batch(arguments: argparse.Namespace) -> str | None:
    """Many drives."""
    from stereocalib_core.run.batch import Scheduler, run_batch

    scheduler = None
    tls = (arguments.tls_ca, arguments.tls_cert, arguments.tls_key)
    if arguments.scheduler is not None:
        scheduler = Scheduler(arguments.scheduler, *tls)
    elif any(tls):
        raise ConfigError("certificates without a scheduler", "--tls-...", "add --scheduler tls://HOST:PORT")
    with terminal_progress() as progress:
        summary = run_batch(
            [_with_calibration(source, arguments) for source in arguments.sources],
            arguments.out,
            workers=arguments.workers,
            scheduler=scheduler,
            method=arguments.method,
            overwrite=arguments.overwrite,
            progress=progress,
            say=_say,
        )
    for note in summary.notes:
        print(f"stereocalib: note: {note}", file=sys.stderr)
    print(f"{summary.done} of {summary.total} drives done, {arguments.out}/summary.md")
    return summary.warning


def calibration(arguments: argparse.Namespace) -> str | None:
    """One dialect of calibration to another."""
    from stereocalib_core.sources.calibrations import convert

    done = convert(
        arguments.input, arguments.to, arguments.out, arguments.unit, arguments.size, arguments.overwrite
    )
    for path in done.written:
        print(path)
    print(f"  read from {', '.join(str(path) for path in done.read)} ({done.dialect})")
    for text in done.notes:
        print(f"  note: {text}")
    return None


COMMANDS: dict[str, Callable[[argparse.Namespace], str | None]] = {
    "demo": demo,
    "view": view,
    "run": run,
    "compare": compare,
    "synth": synth,
    "experiments": experiments,
    "lidar-camera": lidar_camera,
    "view-lidar": view_lidar,
    "synth-boards": synth_boards,
    "batch": batch,
    "calibration": calibration,
}
