"""`stereocalib batch`: many drives on several processes or machines, by Dask.

Every drive is a `run` into its own folder. A worker that dies loses nothing: another one takes its drive over
from the checkpoint. A batch that is called again skips the drives whose files are whole and whose source and
settings are the same.

A local worker takes one core and leaves the others alone: drives are what runs in parallel, so N workers are N
times as fast as one, where a single `run` already reads, renders and solves on other cores as well.
"""

from __future__ import annotations

import contextlib
import fcntl
import functools
import hashlib
import json
import re
import uuid
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stereocalib_core import config as settings
from stereocalib_core.config import PipelineConfig
from stereocalib_core.config.running import RETRIES
from stereocalib_core.errors import ConfigError, OutputError, StereoCalibError
from stereocalib_core.files.output_folder import OutputFolder
from stereocalib_core.files.run_folder import RESULT_FILES, load_run
from stereocalib_core.numeric.threads import bind_threads
from stereocalib_core.results import Drive
from stereocalib_core.run.batch_summary import DriveOutcome, ready_to_draw, write_summary
from stereocalib_core.run.cluster import Scheduler, cluster, usable_cores
from stereocalib_core.sources import SourceKind, open_source, parse, source_kind
from stereocalib_core.system import whole_file
from stereocalib_core.system.compiled import DRIVE, compile_once

SEAL, LOCK, MARKER = "done.json", ".lock", "batch.json"
Progress = Callable[[int, int, str], None]


@dataclass(frozen=True)
class BatchSummary:
    """How many drives there are, how many are done, why the result must not be trusted, if so, and what to know."""

    total: int
    done: int
    warning: str | None
    notes: tuple[str, ...] = ()


def run_batch(
    specs: Sequence[str],
    out: Path,
    *,
    workers: int | None = None,
    scheduler: Scheduler | None = None,
    method: str | None = None,
    overwrite: bool = False,
    progress: Progress | None = None,
    say: Callable[[str], None] | None = None,
) -> BatchSummary:
    """Run every source into `out/<drive>/` and write summary.csv, summary.md and summary.png.

    workers: local processes of one core each, default as many as there are cores. scheduler: a running Dask
    scheduler instead, whose workers see the same paths. A local cluster speaks TLS with certificates of its own, made
    for this call, so that no other process of the machine can hand it functions. say: told before what is compiled
    once for this machine, so that the workers do not each compile the same. Raises StereoCalibError when not one
    source can be a drive.
    """
    config = settings.from_dict({} if method is None else {"method": method})
    specs = [full_spec(spec) for spec in specs]
    unusable = _unusable(specs)
    folder = OutputFolder(out, (MARKER,), overwrite, resume=(out / MARKER).is_file())
    folder.create()
    whole_file.write_json(out / MARKER, {"made_by": "stereocalib batch"})
    names = drive_names(specs)
    outcomes: dict[str, DriveOutcome] = {}
    waiting: list[tuple[str, str]] = []
    for spec, name in zip(specs, names, strict=True):
        if spec in unusable:
            outcomes[name] = DriveOutcome(name, spec, "failed", unusable[spec])
        elif (drive := sealed_drive(out / name, spec, config)) is not None and not overwrite:
            outcomes[name] = DriveOutcome(name, spec, "done", drive=drive)
        else:
            waiting.append((spec, name))
    if waiting and scheduler is None:
        rendered = any(spec.startswith("synthetic") for spec, _ in waiting)
        compile_once(DRIVE + ("simulator",) * rendered, say or (lambda line: None), progress)
    if progress:
        progress(len(outcomes), len(specs), "drives")
    with ThreadPoolExecutor(1, thread_name_prefix="closing") as aside, contextlib.ExitStack() as running:
        try:
            if waiting:
                count = min(workers, len(waiting)) if workers else None
                client = running.enter_context(cluster(count, scheduler, len(waiting)))
                work = run_one if scheduler else functools.partial(run_one_on_its_core, usable_cores())
                for outcome in _submit(client, work, waiting, out, config, overwrite):
                    outcomes[outcome.name] = outcome
                    if progress:
                        progress(len(outcomes), len(specs), "drives")
                    ready_to_draw()  # while other drives are still worked on
        except StereoCalibError:
            folder.undo()
            raise
        aside.submit(running.pop_all().close)  # the workers end while the summary is written
        ordered = [outcomes[name] for name in names]
        write_summary(out, ordered)
    return _summary(ordered, () if scheduler is None or scheduler.note is None else (scheduler.note,))


def _summary(outcomes: list[DriveOutcome], notes: tuple[str, ...]) -> BatchSummary:
    failed = [o for o in outcomes if o.status == "failed"]
    doubtful = [o for o in outcomes if o.drive is not None and o.drive.why_not]
    parts = []
    if failed:
        parts.append(
            f"{len(failed)} of {len(outcomes)} drives failed ({', '.join(o.name for o in failed[:5])})"
        )
    if doubtful:
        parts.append(f"{len(doubtful)} not to be trusted ({', '.join(o.name for o in doubtful[:5])})")
    warning = f"{'; '.join(parts)}: see summary.md" if parts else None
    return BatchSummary(len(outcomes), len(outcomes) - len(failed), warning, notes)


def full_spec(spec: str) -> str:
    """Folders by their full path, since workers may have another working directory."""
    taken = parse(spec)
    if taken.scheme or taken.path is None or not taken.path.exists():
        return spec
    return str(taken.path) + spec[len(taken.name) :]


def _unusable(specs: Sequence[str]) -> dict[str, str]:
    """Sources that are no drive, with the reason; raises when that is true of all of them."""
    reasons: dict[str, str] = {}
    first: StereoCalibError | None = None
    for spec in specs:
        try:
            if source_kind(spec) is SourceKind.RUN:
                raise ConfigError("output of an earlier run", spec, "name its source")
        except StereoCalibError as error:
            reasons[spec] = str(error)
            first = first or error
    if first is not None and len(reasons) == len(set(specs)):
        raise first
    return reasons


def drive_names(specs: Sequence[str]) -> list[str]:
    """A short folder name for every source, different for different ones."""
    parts = [_name_parts(spec) for spec in specs]
    names = [p[-1] for p in parts]
    for depth in range(2, 1 + max(map(len, parts))):
        clashes = {name for name, count in Counter(names).items() if count > 1}
        names = ["-".join(p[-depth:]) if n in clashes else n for n, p in zip(names, parts, strict=True)]
    seen: Counter[str] = Counter()
    for i, name in enumerate(names):
        seen[name] += 1
        names[i] = name if seen[name] == 1 else f"{name}-{seen[name]}"
    return names


def _name_parts(spec: str) -> list[str]:
    taken = parse(spec)
    here = not taken.scheme and taken.path is not None and taken.path.exists()
    words = Path(taken.name).parts if here else (spec,)
    cleaned = [re.sub(r"[^A-Za-z0-9_.=-]+", "-", word).strip("-.") for word in words]
    return [word[-80:] for word in cleaned if word] or ["drive"]


# --- one drive, in a worker


def run_one(spec: str, folder: str, config: PipelineConfig, overwrite: bool) -> str | None:
    """Run or resume one drive and seal its folder; None, or what is wrong with it in one line."""
    import cv2

    from stereocalib_core.run.drive import CHECKPOINT, run_drive

    cv2.setNumThreads(1)
    path = Path(folder)
    try:
        path.mkdir(parents=True, exist_ok=True)
        with (path / LOCK).open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)  # a worker thought dead may still be at it
            if overwrite or sealed_drive(path, spec, config) is None:
                (path / SEAL).unlink(missing_ok=True)
                go_on = (path / CHECKPOINT).is_file() and not overwrite
                _run_or_restart(spec, path, config, go_on, run_drive)
                seal(path, spec, config)
        (path / LOCK).unlink(missing_ok=True)
        return None
    except StereoCalibError as error:
        return str(error)


def run_one_on_its_core(cores: Sequence[int], *drive: Any) -> str | None:
    """`run_one` in a worker of a local cluster, which are numbered: this one keeps to its own of `cores`.

    All of its threads are bound, and with them every thread that the drive starts.
    """
    from distributed import get_worker

    bind_threads({cores[int(get_worker().name) % len(cores)]})
    return run_one(*drive)


def _run_or_restart(
    spec: str, path: Path, config: PipelineConfig, go_on: bool, run_drive: Callable[..., Drive]
) -> Drive:
    """Go on from a checkpoint; one of other settings or another version is started afresh."""
    if go_on:
        with contextlib.suppress(OutputError):
            return run_drive(spec, path, config=config, resume=True)
    return run_drive(spec, path, config=config, overwrite=True)


def seal(folder: Path, spec: str, config: PipelineConfig) -> None:
    """Write down which files a finished drive has, and from what they were made."""
    whole_file.write_json(folder / SEAL, {"made_from": _made_from(spec, config), "sha256": _digests(folder)})


def sealed_drive(folder: Path, spec: str, config: PipelineConfig) -> Drive | None:
    """A drive that is done, whole, and of the same source and settings; else None."""
    try:
        mark = json.loads((folder / SEAL).read_text(encoding="utf-8"))
        if mark["sha256"] != _digests(folder) or mark["made_from"] != _made_from(spec, config):
            return None
        return load_run(folder)
    except (OSError, ValueError, KeyError, TypeError, StereoCalibError):
        return None


def _made_from(spec: str, config: PipelineConfig) -> list[str]:
    text = json.dumps(settings.to_dict(config), sort_keys=True)
    return [open_source(spec).content_key, hashlib.sha256(text.encode()).hexdigest()]


def _digests(folder: Path) -> dict[str, str]:
    present = [name for name in RESULT_FILES if (folder / name).is_file()]
    return {name: hashlib.sha256((folder / name).read_bytes()).hexdigest() for name in present}


# --- Dask


def _submit(
    client: Any,
    work: Callable[..., str | None],
    waiting: list[tuple[str, str]],
    out: Path,
    config: PipelineConfig,
    overwrite: bool,
) -> Iterator[DriveOutcome]:
    """Outcomes as the drives finish; `work` is `run_one` or does the same."""
    from distributed import as_completed

    futures = {}
    call = uuid.uuid4().hex  # a shared scheduler may still know keys of another batch
    for spec, name in waiting:
        arguments = (spec, str((out / name).resolve()), config, overwrite)
        future = client.submit(work, *arguments, key=f"{name}-{call}", retries=RETRIES, pure=False)
        futures[future] = (spec, name)
    for future in as_completed(futures):
        spec, name = futures[future]
        error = future.exception()
        wrong = f"{type(error).__name__}: {error}" if error else future.result()
        if wrong is not None:
            yield DriveOutcome(name, spec, "failed", " ".join(wrong.split()))
        else:
            yield DriveOutcome(name, spec, "done", drive=load_run(out / name))
