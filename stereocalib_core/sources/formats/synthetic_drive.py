"""`synthetic[:NAME][?key=value&...]`, known without loading the renderer."""

from __future__ import annotations

from stereocalib_core.frames import FrameSource
from stereocalib_core.sources.format import Format, SourceKind, Spec


def _open(spec: Spec) -> FrameSource:
    from stereocalib_core.sources.formats import synthetic

    return synthetic.SyntheticSource.from_spec(spec.text)


FORMAT = Format("synthetic drive", lambda spec: spec.scheme == "synthetic", _open, SourceKind.SYNTHETIC)
