"""Studies: many draws of the noise, many subsets of a recording, two papers table by table."""
