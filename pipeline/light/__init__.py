"""The model of light: what a camera sees of lamps, and how much of each a pixel holds."""
