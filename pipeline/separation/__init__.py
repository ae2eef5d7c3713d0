"""Every pixel is dealt out among the lamps."""
