"""Layers mixed anew: brighter, darker, of another colour."""
