"""The noise floor: what poses at rest, or the recording itself, show of each channel's noise."""
