"""Which lamps light a pair: the model of their light, their number, and who they are."""
