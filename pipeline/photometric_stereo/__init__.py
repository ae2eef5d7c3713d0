"""Normals and depth of a surface under lamps of known directions, and the flash.

The light of distant lamps is linear in the squared depth of the surface when the flash sits at the
camera. Surface, lamps and materials are fitted to the pair together
(docs/decisions/0006-normals-by-a-surface.md).
"""
