"""Our estimator of lamps: a 3×3 matrix for each, by maximum a posteriori.

A lamp is a full matrix from the flash part to its light, not three coefficients in a basis. In
image chromaticity N lamps are N points that depend on the pixel's own flash colour, so that the
spread by reflectance, which limits the published method, largely vanishes. Pixels lie between the
points; differences across the edge of a shadow lie at one of them, with no pixel needed that one
lamp lights alone (docs/decisions/0005-fitted-lamps.md).
"""
