"""Joint angles in, volts out: the arm, its maneuvers, the fields, the sensors and the recording of what they read."""
