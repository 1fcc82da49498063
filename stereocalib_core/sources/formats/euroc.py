"""EuRoC / ASL: `mav0/cam0 cam1` each with `data/`, `data.csv` and `sensor.yaml`, the truth in
`state_groundtruth_estimate0/data.csv`; also as TUM-VI lays it out."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from stereocalib_core.config.reading import MOST_BYTES_OF_A_LIST
from stereocalib_core.errors import SourceError
from stereocalib_core.frames import GroundTruth, Recording
from stereocalib_core.geometry import Array, invert_transform
from stereocalib_core.sources.assembly import Parts, calibration_for, recording
from stereocalib_core.sources.calibrations import kalibr
from stereocalib_core.sources.calibrations.trees import Tree, read_tree
from stereocalib_core.sources.format import Format, SourceKind, Spec
from stereocalib_core.sources.lists import read_ground_truth
from stereocalib_core.sources.pairing import match_pairs
from stereocalib_core.sources.times import Times, since_epoch, times_in_names
from stereocalib_core.system.text_file import lines

TRUTHS = ("state_groundtruth_estimate0", "gt0", "mocap0", "vicon0", "leica0")


def _home(folder: Path) -> Path | None:
    """The folder that holds cam0 and cam1: itself, or mav0 in it."""
    for place in (folder, folder / "mav0"):
        if all((place / cam / "data").is_dir() for cam in ("cam0", "cam1")):
            return place
    return None


def _accepts(spec: Spec) -> bool:
    return spec.folder is not None and _home(spec.folder) is not None


def _open(spec: Spec) -> Recording:
    assert spec.folder is not None
    home = _home(spec.folder)
    assert home is not None
    name = spec.folder.name if home != spec.folder else home.parent.name if home.name == "mav0" else home.name
    found = calibration_for(
        spec.options, home, home.parent, home.parent / "dso", home / "dso", what="cam0 and cam1"
    )
    pairs = match_pairs(home / "cam0" / "data", home / "cam1" / "data", numbered=False)
    stamps = stamps_of(home / "cam0" / "data.csv")
    in_names = times_in_names(list(pairs.stems))
    seconds, epoch_s = since_epoch([stamps.get(stem) for stem in pairs.stems], 10**9)
    times = Times(seconds, (), epoch_s)
    if not np.isfinite(seconds).any():
        times = Times(np.zeros(0)) if in_names is None else in_names
    elif in_names is not None:
        named = in_names.seconds + (in_names.epoch_s - epoch_s)
        times = Times(np.where(np.isfinite(seconds), seconds, named), (), epoch_s)
    rows = range(len(pairs))
    notices: list[str] = []
    T_body_camera = _body_from_camera(home, notices)
    truth_file = next(
        (path for path in (home / place / "data.csv" for place in TRUTHS) if path.is_file()), None
    )

    def truth(times_s: Array) -> tuple[GroundTruth | None, list[str]]:
        return read_ground_truth(truth_file, None, rows, times_s, T_body_camera)

    files = [home / "cam0" / "data.csv", *([truth_file] if truth_file else [])]
    return recording(
        Parts(
            kind="euroc",
            folder=home,
            pairs=type(pairs)(pairs.stems, tuple(rows), pairs.left, pairs.right, pairs.notices),
            found=found,
            times=times,
            times_name="cam0/data.csv",
            truth=truth,
            notices=notices,
            files=files,
            name=name,
        )
    )


def stamps_of(path: Path) -> dict[str, int]:
    """Picture name without suffix to nanoseconds, from rows of `nanoseconds,name`; empty where there are none."""
    found: dict[str, int] = {}
    if not path.is_file():
        return found
    try:
        for line in lines(path, MOST_BYTES_OF_A_LIST, "times"):
            words = re.split(r"[,\s]+", line.strip())
            if not line.startswith("#") and re.fullmatch(r"\d{10,19}", words[0] or ""):
                name = words[1] if len(words) > 1 and words[1] else words[0]
                found[name.rpartition(".")[0] or name] = int(words[0])
    except SourceError:
        return {}
    return found


def _body_from_camera(home: Path, notices: list[str]) -> Array | None:
    """(4, 4) T_body_camera of cam0 from its sensor.yaml and the truth's own; None where they do not say."""
    trees: list[Tree] = []
    truth = next((home / place for place in TRUTHS if (home / place / "data.csv").is_file()), None)
    for path in (home / "cam0" / "sensor.yaml", *([truth / "sensor.yaml"] if truth else [])):
        try:
            trees.append(read_tree(path) if path.is_file() else {})
        except SourceError as error:
            notices.append(f"{path.parent.name}/{path.name} is not used: {error.what}")
            trees.append({})
    try:
        camera, *body = (kalibr.body_from_camera(tree, home) if "T_BS" in tree else None for tree in trees)
    except SourceError as error:
        notices.append(f"T_BS is not used: {error.what}")
        return None
    if camera is None:
        return None
    return camera if not body or body[0] is None else invert_transform(body[0]) @ camera


FORMAT = Format("EuRoC / ASL recording", _accepts, _open, SourceKind.EUROC)
