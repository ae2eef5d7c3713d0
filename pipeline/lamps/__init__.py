"""Which lamps light a pair: their number, and who they are."""
