"""How every settings dataclass reads strangers' values: unknown keys are refused."""

from pydantic import ConfigDict

STRICT = ConfigDict(extra="forbid")
