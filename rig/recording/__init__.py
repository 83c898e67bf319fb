"""Recordings: one run's time, pose and readings, on disk and in memory (format ``rig-recording/1``)."""

from rig.recording.files import RecordingScan, RecordingWriter, locked_beside, read_recording, scan_recording
from rig.recording.metadata import FORMAT, Metadata
from rig.recording.samples import Recording

__all__ = [
    "FORMAT",
    "Metadata",
    "Recording",
    "RecordingScan",
    "RecordingWriter",
    "locked_beside",
    "read_recording",
    "scan_recording",
]
