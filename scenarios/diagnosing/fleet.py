"""Many recordings of many arms: which cause on which arm, since when."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final, Literal

from estimators.gap.diagnosis import Cause, Diagnosis
from scenarios.diagnosing.task import About

FORMAT: Final = "rig-fleet/1"
#: A cause that is likelier than not has been found.
FOUND: Final = 0.5
#: Verdicts that say of a cause they do not hold that it is not there; the others leave it open.
_SETTLED: Final = ("no-gap", "named", "ambiguous")
COLUMNS: Final = (
    "arm",
    "recorded",
    "recording",
    "verdict",
    "effect",
    "where",
    "probability",
    "equivalent",
    "closed",
    "since",
    "error",
)

Label = tuple[str, str]
Seen = Literal["found", "absent", "open"]


@dataclass(frozen=True)
class Entry:
    """One recording of a fleet.

    Attributes:
        name: of the recording. diagnosis: None where ``error`` says why there is none.
        about: whose recording it is; None where it could not be read.
        without: effects that were not looked for.
    """

    name: str
    diagnosis: Diagnosis | None
    about: About | None
    error: str = ""
    without: tuple[str, ...] = ()

    @property
    def arm(self) -> str:
        """The arm: its serial number, or its model where none is stated."""
        return "" if self.about is None else self.about.serial or self.about.arm

    @property
    def recorded(self) -> str:
        """Date and time, empty where not stated."""
        return "" if self.about is None else self.about.recorded or ""

    @property
    def causes(self) -> tuple[Cause, ...]:
        """The causes that were found."""
        every = () if self.diagnosis is None else self.diagnosis.causes
        return tuple(cause for cause in every if cause.probability >= FOUND)

    def sees(self, names: frozenset[Label]) -> Seen:
        """Whether it has a cause by one of its names; "open" where it could not tell, or did not look."""
        if any(names_of(cause) & names for cause in self.causes):
            return "found"
        if self.diagnosis is None or self.diagnosis.verdict not in _SETTLED:
            return "open"
        blind = {(each["effect"], each["where"]) for each in self.diagnosis.cannot_tell}
        told = {name for name in names if name not in blind and name[0] not in self.without}
        return "absent" if told else "open"


@dataclass(frozen=True)
class History:
    """A cause on an arm.

    Attributes:
        arm: which. names: the cause's, the first one first; more where the recordings cannot split them.
        seen: of each of the arm's recordings, in their order.
        entries: these recordings.
    """

    arm: str
    names: tuple[Label, ...]
    seen: tuple[Seen, ...]
    entries: tuple[Entry, ...]

    @property
    def since(self) -> Entry:
        """The first recording of the latest unbroken run that has it."""
        last = len(self.seen) - 1 - self.seen[::-1].index("found")
        broken = [number for number in range(last) if self.seen[number] == "absent"]
        begin = max(broken, default=-1) + 1
        return self.entries[begin + self.seen[begin:].index("found")]

    @property
    def before(self) -> Entry | None:
        """The last recording before that which did not have it; None where none could tell."""
        ahead = self.seen[: self.entries.index(self.since)]
        return self.entries[len(ahead) - 1 - ahead[::-1].index("absent")] if "absent" in ahead else None

    @property
    def now(self) -> bool:
        """Whether the latest recording that could tell has it."""
        return next(each for each in reversed(self.seen) if each != "open") == "found"

    def to_json(self) -> dict[str, Any]:
        """A JSON object."""
        return {
            "arm": self.arm,
            "effect": self.names[0][0],
            "where": self.names[0][1],
            "equivalent": [list(name) for name in self.names[1:]],
            "since": _moment(self.since),
            "not_yet": None if self.before is None else _moment(self.before),
            "now": self.now,
            "recordings": {entry.name: seen for entry, seen in zip(self.entries, self.seen, strict=True)},
        }


def names_of(cause: Cause) -> frozenset[Label]:
    """A cause's name and those of what does the same."""
    return frozenset([(cause.effect, cause.where), *((each["effect"], each["where"]) for each in cause.equivalent)])


def in_order(entries: Iterable[Entry]) -> tuple[Entry, ...]:
    """Arm by arm, each from its first recording on; as given where no time is stated."""
    return tuple(sorted(entries, key=lambda entry: (entry.arm, entry.recorded)))


def histories(entries: Iterable[Entry]) -> tuple[History, ...]:
    """Every cause of every arm, in the order of arms and first appearance."""
    arms: dict[str, list[Entry]] = {}
    for entry in in_order(entries):
        if entry.about is not None:
            arms.setdefault(entry.arm, []).append(entry)
    found = []
    for arm, own in arms.items():
        for first, names in _distinct(own):
            seen = tuple(entry.sees(names) for entry in own)
            found.append(History(arm, (first, *sorted(names - {first})), seen, tuple(own)))
    return tuple(found)


def _distinct(entries: Sequence[Entry]) -> list[tuple[Label, frozenset[Label]]]:
    """The causes of an arm: what two recordings may share a name of is one cause, by the names that they share."""
    groups: list[frozenset[Label]] = []
    for cause in (cause for entry in entries for cause in entry.causes):
        names = names_of(cause)
        place = next((index for index, group in enumerate(groups) if group & names), None)
        if place is None:
            groups.append(names)
        else:
            groups[place] &= names
    likeliest: dict[Label, float] = {}
    for cause in (cause for entry in entries for cause in entry.causes):
        for label, probability in _chances(cause).items():
            likeliest[label] = likeliest.get(label, 0.0) + probability
    return [(max(sorted(group), key=lambda label: likeliest[label]), group) for group in groups]


def _chances(cause: Cause) -> dict[Label, float]:
    others = {(each["effect"], each["where"]): float(each["probability"]) for each in cause.equivalent}
    return {(cause.effect, cause.where): cause.probability - sum(others.values()), **others}


def fleet_json(entries: Sequence[Entry]) -> dict[str, Any]:
    """All recordings and all causes, as a JSON object."""
    return {
        "format": FORMAT,
        "recordings": [_plain(entry) for entry in in_order(entries)],
        "causes": [history.to_json() for history in histories(entries)],
    }


def _plain(entry: Entry) -> dict[str, Any]:
    about = {} if entry.about is None else asdict(entry.about)
    if entry.diagnosis is None:
        return {"recording": entry.name, **about, "error": entry.error}
    document = entry.diagnosis.to_json()
    causes = [
        {key: cause[key] for key in ("effect", "where", "probability", "equivalent", "parameters")}
        for cause in document["causes"]
    ]
    return {
        "recording": entry.name,
        **about,
        "samples": document["samples"],
        "verdict": document["verdict"],
        "posterior": document["posterior"],
        "closed": document["closed"]["value"],
        "causes": causes,
    }


def fleet_csv(entries: Sequence[Entry]) -> str:
    """One line a recording and cause found; a recording without any has one line of its own."""
    told = histories(entries)
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    writer.writeheader()
    for entry in in_order(entries):
        row: dict[str, Any] = {"arm": entry.arm, "recorded": entry.recorded, "recording": entry.name}
        if entry.diagnosis is None:
            writer.writerow({**row, "error": entry.error})
            continue
        row["verdict"] = entry.diagnosis.verdict
        for cause in entry.causes:
            writer.writerow({**row, **_cells(cause, entry, told)})
        if not entry.causes:
            writer.writerow(row)
    return text.getvalue()


def _cells(cause: Cause, entry: Entry, told: Sequence[History]) -> Mapping[str, Any]:
    own = next(each for each in told if each.arm == entry.arm and names_of(cause) & set(each.names))
    return {
        "effect": cause.effect,
        "where": cause.where,
        "probability": f"{cause.probability:.4g}",
        "equivalent": " ".join(f"{each['effect']}@{each['where']}" for each in cause.equivalent),
        "closed": "" if cause.closed.value is None else f"{cause.closed.value:.4g}",
        "since": own.since.name,
    }


def _moment(entry: Entry) -> dict[str, Any]:
    return {"recording": entry.name, "recorded": entry.recorded or None}
