"""Recordings diagnosed: one, many side by side, several together, a fleet; and the rig that comes of it."""
