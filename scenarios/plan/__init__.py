"""Planning: the maneuver of an arm that a calibration, or a diagnosis, gains most from in a given time."""
