"""Recordings as streams, and streams calibrated and watched while they run."""
