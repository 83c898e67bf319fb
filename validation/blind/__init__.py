"""The blind check: sealed recordings, made by one half of this package and scored by it, diagnosed in between.

The maker (``strata``, ``cases``, ``mechanics``) and the scorer share with the diagnosis only what is in ``rig``: the
strengths, the declared equivalents and the true gap are computed here, from the truth.
"""
