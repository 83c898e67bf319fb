"""Recordings that are wrong in one way each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np


@dataclass
class Table:
    """A CSV recording, to be spoilt."""

    metadata: str
    header: list[str]
    rows: list[list[str]]

    def column(self, name: str) -> int:
        return self.header.index(name)

    def set(self, row: int, name: str, value: str) -> None:
        self.rows[row][self.column(name)] = value

    def drop(self, *names: str) -> None:
        kept = [index for index, name in enumerate(self.header) if name not in names]
        self.header = [self.header[index] for index in kept]
        self.rows = [[row[index] for index in kept] for row in self.rows]

    def rename(self, old: str, new: str) -> None:
        self.header[self.column(old)] = new

    def restate(self, old: str, new: str) -> None:
        assert old in self.metadata
        self.metadata = self.metadata.replace(old, new)

    def with_tool(self, scale: float = 1.0) -> None:
        """Tool poses in place of joint angles."""
        self.drop(*(f"q{joint}_rad" for joint in range(1, 7)))
        self.header += ["tool_qw", "tool_qx", "tool_qy", "tool_qz"]
        angles = np.linspace(0.0, 3.0, len(self.rows))
        for row, angle in zip(self.rows, angles, strict=True):
            row += [repr(float(scale * value)) for value in (np.cos(angle), np.sin(angle), 0.0, 0.0)]

    def text(self) -> str:
        return "\n".join([self.metadata, ",".join(self.header), *map(",".join, self.rows), ""])


def table(path: Path) -> Table:
    metadata, header, *rows = path.read_text().splitlines()
    return Table(metadata, header.split(","), [row.split(",") for row in rows])


Spoil = Callable[[Table], object]

BAD_TABLES: dict[str, tuple[Spoil, str]] = {
    "missing axis": (lambda t: t.drop("accel2_V"), "accel2"),
    "missing time": (lambda t: t.drop("t_s"), "t_s"),
    "no sensor": (lambda t: t.drop(*(n for n in t.header if n.startswith(("accel", "mag")))), "no sensor"),
    "NaN reading": (lambda t: t.set(5, "mag1_V", "nan"), "mag1_V.*nan"),
    "infinite angle": (lambda t: t.set(7, "q5_rad", "inf"), "q5_rad.*inf"),
    "not a number": (lambda t: t.set(7, "q5_rad", "north"), "north"),
    "unknown unit": (lambda t: t.rename("accel1_V", "accel1_Volt"), "accel1_Volt"),
    "two units": (lambda t: t.rename("accel1_V", "accel1_mV"), "accel"),
    "time stands still": (lambda t: t.set(9, "t_s", t.rows[8][0]), "t_s.*increas"),
    "time runs back": (lambda t: t.set(9, "t_s", "0"), "t_s.*increas"),
    "partial joints": (lambda t: t.drop("q3_rad"), "q3"),
    "too few joints": (lambda t: t.drop("q6_rad"), "q6_rad"),
    "partial quaternion": (lambda t: (t.with_tool(), t.drop("tool_qz")), "tool_qz"),
    "partial position": (lambda t: (t.with_tool(), t.rename("temperature_degC", "tool_x_m")), "tool_y_m"),
    "quaternion of length two": (lambda t: t.with_tool(2.0), "tool_q.*norm 2"),
    "column twice": (lambda t: t.rename("mag2_V", "mag1_V"), "mag1_V"),
    "no row": (lambda t: t.rows.clear(), "no samples"),
    "truncated row": (lambda t: t.rows.__setitem__(-1, t.rows[-1][:4]), "row|columns"),
    "metadata not JSON": (lambda t: t.restate("}", ""), "JSON"),
    "another format": (lambda t: t.restate("recording/1", "recording/9"), "rig-recording/9"),
    "negative gravity": (lambda t: t.restate('s2": 9.8', 's2": -9.8'), "gravity_m_s2"),
}


def whole() -> bytes:
    return Path("run.parquet").read_bytes()


BAD_FILES: dict[str, Callable[[Path], object]] = {
    "empty.csv": lambda path: path.write_bytes(b""),
    "empty.parquet": lambda path: path.write_bytes(b""),
    "text.parquet": lambda path: path.write_text("t_s,accel1_V\n0,1\n"),
    "truncated.parquet": lambda path: path.write_bytes(whole()[:-500]),
    "damaged.parquet": lambda path: path.write_bytes(whole()[:20000] + whole()[20500:]),
    "binary.csv": lambda path: path.write_bytes(bytes(range(256)) * 40),
    "missing.parquet": lambda path: None,
    "folder.parquet": lambda path: path.mkdir(),
    "other.txt": lambda path: path.write_bytes(Path("run.csv").read_bytes()),
}
