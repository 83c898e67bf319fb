"""What a maneuver can tell before anyone runs it, and the poses that tell most."""
