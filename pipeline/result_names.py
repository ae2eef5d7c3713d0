"""Names of the results that others are made from."""

LAYERS = "layers.exr"
MANIFEST = "manifest.json"
"""Written last, so that only a finished run has one."""
