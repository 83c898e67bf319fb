"""The tables and texts of Renk et al. (2005) and Camps et al. (2009) beside the rig."""
