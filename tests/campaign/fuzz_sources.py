"""Damaged recordings: every format and every dialect of calibration, one file of it damaged in one of many ways.

Right is: the recording opens and gives frames or failures, or one line says what is wrong. Wrong is any other
exception, more than five seconds, or a line that is none. `python tests/campaign/fuzz_sources.py [CASES]` prints a
table.
"""

from __future__ import annotations

import os
import random
import re
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

if __name__ == "__main__":
    root = Path(__file__).resolve().parents[2]
    sys.path[:0] = [str(root), str(root / "app"), str(root / "tests")]

from sources.laid_out import LAYOUTS, MORE, Drive, drive_of, unrectified

from stereocalib_core.calibration import StereoCalibration
from stereocalib_core.errors import StereoCalibError
from stereocalib_core.sources import open_source
from stereocalib_core.sources.calibrations import WRITERS, read_calibration, write_calibration
from stereocalib_core.sources.formats.synthetic import SyntheticSource

LIMIT_S = 5.0
SPECIAL = (
    "nan",
    "inf",
    "-1",
    "0",
    "1e999",
    "9" * 400,
    "",
    "x",
    "1,5",
    "-0.0",
    "1e-300",
    "[",
    "{",
    "&a",
    "*a",
    "!!python/name:os",
)


@dataclass
class Outcome:
    """cases: how many were tried; wrong: the case, its damage and what happened; slowest in seconds."""

    cases: Counter[str] = field(default_factory=Counter)
    refused: Counter[str] = field(default_factory=Counter)
    wrong: list[tuple[str, str]] = field(default_factory=list)
    slowest_s: float = 0.0


# --- damage, each from bytes to bytes


def _cut(data: bytes, rng: random.Random) -> bytes:
    return data[: rng.randrange(len(data) + 1)]


def _flip(data: bytes, rng: random.Random) -> bytes:
    out = bytearray(data)
    for _ in range(rng.choice((1, 3, 20))):
        if out:
            out[rng.randrange(len(out))] ^= 1 << rng.randrange(8)
    return bytes(out)


def _noise(data: bytes, rng: random.Random) -> bytes:
    return rng.randbytes(rng.choice((0, 1, 7, 100, 5000)))


def _hole(data: bytes, rng: random.Random) -> bytes:
    at = rng.randrange(len(data) + 1)
    return data[:at] + bytes(rng.choice((1, 16, 4096))) + data[at:]


def _doubled(data: bytes, rng: random.Random) -> bytes:
    at = rng.randrange(len(data) + 1)
    return data[:at] + data[max(0, at - rng.randrange(1, 400)) :]


def _words(data: bytes, rng: random.Random) -> bytes:
    """Numbers exchanged for what is none, or for absurd ones."""
    parts = re.split(rb"(\s+|,|:)", data)
    for _ in range(rng.choice((1, 1, 4))):
        if parts:
            parts[rng.randrange(len(parts))] = rng.choice(SPECIAL).encode()
    return b"".join(parts)


def _lines(data: bytes, rng: random.Random) -> bytes:
    rows = data.split(b"\n")
    kind = rng.randrange(4)
    if kind == 0:
        rng.shuffle(rows)
    elif kind == 1:
        del rows[rng.randrange(len(rows))]
    elif kind == 2:
        rows.insert(rng.randrange(len(rows) + 1), rng.choice(rows))
    else:
        rows.insert(
            rng.randrange(len(rows) + 1),
            rng.choice((b"", b"\t", b"#", b"a: b: c", b"- 1", b"\xff\xfe", b"?")),
        )
    return b"\n".join(rows)


def _encoded(data: bytes, rng: random.Random) -> bytes:
    text = data.decode("latin-1")
    return text.encode(rng.choice(("utf-16", "utf-16-be", "utf-32", "utf-8-sig")))


def _huge(data: bytes, rng: random.Random) -> bytes:
    unit = rng.choice((b"1\n", b"[", b"{a: ", b"0 ", b"a", data[:200] or b"x"))
    return unit * (rng.choice((300_000, 2_000_000)) // len(unit))


BINARY: tuple[Callable[[bytes, random.Random], bytes], ...] = (_cut, _flip, _flip, _noise, _hole, _doubled)
TEXT = (*BINARY, _words, _words, _lines, _lines, _encoded, _huge)
TEXTS = (".txt", ".csv", ".yaml", ".yml", ".xml", ".json")


@contextmanager
def _alarm() -> Iterator[None]:
    def ring(*_: Any) -> None:
        raise TimeoutError(f"more than {LIMIT_S:g} s")

    before = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, LIMIT_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def small_drive() -> Drive:
    """Three frames of 96x64, noise that no format minds."""
    import cv2

    drive = drive_of(SyntheticSource.from_spec("synthetic:plane?frames=3"), 3)
    rng = np.random.default_rng(1)
    sides = [
        [cv2.imencode(".png", rng.integers(0, 256, (64, 96)).astype(np.uint8))[1].tobytes() for _ in range(3)]
        for _ in "lr"
    ]
    return Drive(
        sides[0],
        sides[1],
        (96, 64),
        (80.0, 47.5, 31.5, 0.5),
        drive.stamps_ns,
        drive.poses,
        drive.scans,
        drive.T_camera_lidar,
    )


def _calibrations(root: Path, drive: Drive) -> dict[str, Path]:
    """Every dialect, of rectified and of raw lenses."""
    raw: StereoCalibration = unrectified(drive)[2]
    found = {}
    for dialect in WRITERS:
        for name, calibration in (("rectified", drive.calibration()), ("raw", raw)):
            for suffix in (".yml", ".xml", ".json") if dialect == "opencv" else (".yaml",):
                place = root / f"{dialect}-{name}{suffix}"
                place.mkdir(parents=True)
                write_calibration(calibration, dialect, place / f"file{suffix}")
                found[f"calibration {dialect} {name}{suffix}"] = place
    return found


def run(cases: int, seed: int = 0) -> Outcome:
    """`cases` damaged files over all formats and dialects in turn."""
    outcome = Outcome()
    place = Path(tempfile.mkdtemp(prefix="stereocalib-fuzz-"))
    try:
        drive = small_drive()
        templates: dict[str, tuple[Path, str]] = {}
        for name, layout in {**LAYOUTS, **MORE}.items():
            root = place / "templates" / re.sub(r"\W+", "-", name)
            root.mkdir(parents=True)
            templates[name] = (root, layout.write(root, drive))
        for name, root in _calibrations(place / "calibrations", drive).items():
            templates[name] = (root, "")
        names = list(templates)
        for case in range(cases):
            name = names[case % len(names)]
            rng = random.Random(seed * 1_000_003 + case)
            root, spec = templates[name]
            work = place / "work"
            shutil.copytree(root, work, copy_function=os.link)
            damage = _damage(work, rng)
            _try(outcome, name, f"case {case}, {damage}", spec.replace(str(root), str(work)), work)
            shutil.rmtree(work)
    finally:
        shutil.rmtree(place, ignore_errors=True)
    return outcome


def _damage(work: Path, rng: random.Random) -> str:
    """One file of the recording damaged, or removed; what was done."""
    files = sorted(path for path in work.rglob("*") if path.is_file())
    texts = [path for path in files if path.suffix in TEXTS]
    path = rng.choice(texts) if texts and rng.random() < 0.7 else rng.choice(files)
    data = path.read_bytes()
    path.unlink()  # the file is a link to the template's
    if rng.random() < 0.03:
        return f"{path.relative_to(work)} removed"
    damage = rng.choice(TEXT if path.suffix in TEXTS else BINARY)
    path.write_bytes(damage(data, rng))
    return f"{path.relative_to(work)} {damage.__name__.strip('_')}"


def _try(outcome: Outcome, name: str, case: str, spec: str, work: Path) -> None:
    outcome.cases[name] += 1
    began = time.perf_counter()
    try:
        with _alarm():
            if not spec:
                read_calibration(work)
            else:
                source = open_source(spec)
                for index in range(min(len(source), 4)):
                    source[index]
                assert all("\n" not in note for note in source.notices)
    except StereoCalibError as error:
        outcome.refused[name] += 1
        if "\n" in str(error) or len(str(error)) > 1000:
            outcome.wrong.append((f"{name}: {case}", f"no short line: {str(error)[:300]}"))
    except BaseException as error:  # noqa: BLE001 - whatever comes is what is looked for
        if isinstance(error, KeyboardInterrupt):
            raise
        last = traceback.extract_tb(error.__traceback__)[-1]
        what = f"{type(error).__name__}: {str(error)[:200]} ({Path(last.filename).name}:{last.lineno})"
        outcome.wrong.append((f"{name}: {case}", what))
    outcome.slowest_s = max(outcome.slowest_s, time.perf_counter() - began)


def table(outcome: Outcome) -> str:
    """Format by format: cases, how many were refused in one line, how many went wrong."""
    lines = [f"{'damaged':<48} {'cases':>6} {'refused':>8} {'wrong':>6}"]
    for name, count in outcome.cases.items():
        wrong = sum(case.startswith(f"{name}:") for case, _ in outcome.wrong)
        lines.append(f"{name:<48} {count:>6} {outcome.refused[name]:>8} {wrong:>6}")
    total = sum(outcome.cases.values())
    lines.append(f"{'all':<48} {total:>6} {sum(outcome.refused.values()):>8} {len(outcome.wrong):>6}")
    lines.append(f"slowest {outcome.slowest_s:.2f} s of {LIMIT_S:g} s")
    lines += [f"WRONG {case}\n      {what}" for case, what in outcome.wrong[:40]]
    return "\n".join(lines)


if __name__ == "__main__":
    result = run(int(sys.argv[1]) if len(sys.argv) > 1 else 5000)
    print(table(result))
    sys.exit(bool(result.wrong))
