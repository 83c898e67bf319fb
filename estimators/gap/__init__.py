"""The sim-to-real gap: where it lies, which unmodelled effect causes it, how far it closes once that is added."""

from estimators.gap.diagnose import diagnose
from estimators.gap.diagnosis import Cause, Channel, Diagnosis, Estimate

__all__ = ["Cause", "Channel", "Diagnosis", "Estimate", "diagnose"]
