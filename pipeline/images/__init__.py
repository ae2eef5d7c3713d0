"""Pictures in memory: their types, and what is done with a picture whatever it shows."""
