"""What the posterior says: causes, widths, closure, what is left, what another maneuver would tell."""
