"""The loop as a study: hidden rigs, diagnosed, sent the next maneuver, and diagnosed together until they are named."""
