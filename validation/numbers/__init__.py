"""The numbers that a diagnosis rests on: listed from its source with their reasons, and moved to see what they sway."""
