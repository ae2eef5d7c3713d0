"""Two photographs become a pair: aligned, on one scale, with what is known of their noise."""
