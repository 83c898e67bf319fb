"""The six channels of the sensor and their order, which is the same everywhere."""

from __future__ import annotations

from typing import Final, Literal

ACCELEROMETER: Final = "accelerometer"
MAGNETOMETER: Final = "magnetometer"
SENSORS: Final = (ACCELEROMETER, MAGNETOMETER)

CHANNELS_OF: Final[dict[str, tuple[str, str, str]]] = {
    ACCELEROMETER: ("accel1", "accel2", "accel3"),
    MAGNETOMETER: ("mag1", "mag2", "mag3"),
}
CHANNELS: Final = CHANNELS_OF[ACCELEROMETER] + CHANNELS_OF[MAGNETOMETER]

#: The columns of a sensor in an array (n, 6) of all channels.
COLUMNS_OF: Final[dict[str, slice]] = {ACCELEROMETER: slice(0, 3), MAGNETOMETER: slice(3, 6)}

#: What an accelerometer reads: "g-a", gravity less acceleration, down at rest; "a-g", the specific force, up at rest.
Reads = Literal["g-a", "a-g"]
READS: Final[tuple[Reads, Reads]] = ("g-a", "a-g")
