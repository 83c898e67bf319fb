"""Many known-angle calibrations at once: the search of ``estimators.known_angle.fit``, and all of them for studies.

A study fits thousands of data sets that share their poses, or nearly so. Their statistics are fitted together
(``fit_many``): every step of the search is a few products over all of them.
"""

from estimators.batch.fits import ManyFits, fit_many
from estimators.batch.parameters import ManyParameters

__all__ = ["ManyFits", "ManyParameters", "fit_many"]
