"""The output of an earlier run: known for what it is, and no recording."""

from __future__ import annotations

from typing import NoReturn

from stereocalib_core.errors import SourceError
from stereocalib_core.sources.format import Format, SourceKind, Spec

RUN_FILES = ("report.json", "extrinsics.csv")


def _accepts(spec: Spec) -> bool:
    folder = spec.folder
    return folder is not None and all((folder / name).is_file() for name in RUN_FILES)


def _open(spec: Spec) -> NoReturn:
    remedy = "use it with view or compare, or name its source"
    raise SourceError("output of an earlier run", spec.path, remedy)


FORMAT = Format("output of an earlier run", _accepts, _open, SourceKind.RUN)
