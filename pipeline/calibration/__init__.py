"""Calibration without special gear: a flash, a camera or lamps, from a pair that shows them."""
