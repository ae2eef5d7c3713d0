"""The published method.

Hui, Sunkavalli, Hadap, Sankaranarayanan, "Illuminant Spectra-based Source Separation Using Flash
Photography", CVPR 2018. Equation and algorithm numbers are those of its supplement.
"""
