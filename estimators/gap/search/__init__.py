"""The search for the hypotheses worth weighing, and the posterior over them."""
