"""How likely a hypothesis makes the data: refits, Laplace's approximation, discrepancies, states of the noise."""
