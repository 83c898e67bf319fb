"""Recordings: one run's time, pose and readings, on disk and in memory (format ``rig-recording/1``)."""

from rig.recording.block_means import block_length, block_means, joined, whole_or_beginning, whole_or_means
from rig.recording.metadata import FORMAT, Metadata
from rig.recording.recording_files import RecordingScan, RecordingWriter, locked_beside, read_recording, scan_recording
from rig.recording.samples import Recording
from rig.recording.thinning import thinned, whole_or_thinned

__all__ = [
    "FORMAT",
    "Metadata",
    "Recording",
    "RecordingScan",
    "RecordingWriter",
    "block_length",
    "block_means",
    "joined",
    "locked_beside",
    "read_recording",
    "scan_recording",
    "thinned",
    "whole_or_beginning",
    "whole_or_means",
    "whole_or_thinned",
]
