"""What may be there: the effects of the catalogue, noise, error sources; their priors and score tests."""
