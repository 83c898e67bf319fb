"""The sim-to-real gap: where it lies, which unmodelled effect causes it, how far it closes once that is added.

In the order of the work, each room using those before it: ``floor``, the noise; ``data``, whitened by it;
``hypotheses``, what may be there; ``evidence``, how likely that makes the data; ``search``, over sets of causes;
``report``, what the posterior says. ``diagnose`` goes through them, ``diagnosis`` is what comes out.
"""

from estimators.gap.diagnose import diagnose
from estimators.gap.diagnosis import Cause, Channel, Diagnosis, Estimate

__all__ = ["Cause", "Channel", "Diagnosis", "Estimate", "diagnose"]
