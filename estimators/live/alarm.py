"""What a monitor says."""

from __future__ import annotations

from dataclasses import dataclass

from estimators.live.naming import Likeness


@dataclass(frozen=True)
class Alarm:
    """A change, its name once it is known, or its end.

    Attributes:
        kind: "change", "named" or "over".
        t_s: when it was noticed [s]. since_s: since when it seems to last [s].
        sensor: which one. test: what noticed it.
        p_value: of the test.
        names: what it looks like, the likeliest first.
    """

    kind: str
    t_s: float
    since_s: float
    sensor: str
    test: str
    p_value: float
    names: tuple[Likeness, ...] = ()

    @property
    def begins(self) -> bool:
        """Whether it is a new change."""
        return self.kind == "change"

    @property
    def looks_like(self) -> str:
        """In words."""
        return " or ".join(map(str, self.names)) if self.names else "no effect of the catalogue alone: unknown"

    def __str__(self) -> str:
        """One line."""
        if self.kind == "over":
            return f"{self.sensor}: as before again, since about {self.since_s:.2f} s"
        if self.kind == "named":
            return f"{self.sensor}: the change at {self.since_s:.2f} s looks like {self.looks_like}"
        return f"ALARM {self.sensor}: {self.test}, since about {self.since_s:.2f} s"
