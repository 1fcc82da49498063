"""How every settings dataclass reads strangers' values: unknown keys are refused, numbers must be positive.

Every number is a size, a limit or a count, and zero of it makes no sense, unless its type says otherwise: the
types below carry bounds of their own.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import ConfigDict, Field

STRICT = ConfigDict(extra="forbid")

Share = Annotated[float, Field(ge=0.0, lt=1.0)]
"""A part of a whole; none of it is allowed."""
Floor = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
"""A least size, or an addition, that may be nothing."""
