"""Samples as they come: lines into samples, a clock that is looked after, where lines come from, and their journal."""

from rig.stream.clock import Clock
from rig.stream.feed import Feed
from rig.stream.journal import Journal
from rig.stream.lines import Layout, LineReader
from rig.stream.sources import Source, open_source

__all__ = ["Clock", "Feed", "Journal", "Layout", "LineReader", "Source", "open_source"]
