"""White balance under two lights of known colours, from one photograph.

Source: Hsu, Mertens, Paris, Avidan and Durand, "Light Mixture Estimation for Spatially Varying
White Balance", ACM Transactions on Graphics 27(3), 2008. The source's own constants are not known
here; those below were found on development scenes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import diags_array
from scipy.sparse.linalg import spsolve

from pipeline.arrays import Floats64
from pipeline.images.frames import Image
from tests.evaluation.baselines.matting_laplacian import matting_laplacian

_BIN = 0.03  # of the logarithm of a material's chromaticity
_REACH = 3.0  # largest logarithm on the grid, either way
_MIXTURES = np.linspace(0.0, 1.0, 41)
_VOTERS = 8000
_MATERIALS = 60  # at most
_FEW = 0.003  # of the voters: fewer are no material
_EPSILON = 1e-4
_FIDELITY = 0.1
_DARK = 1e-3  # of the brightest green: chromaticity means nothing


def mixture_balance(photograph: Image, lights: Floats64, neutral: Floats64) -> Image:
    """Divide every pixel by the mixture of the two lights there.

    Materials are voted for, the mixture α taken where one material alone explains a pixel, and
    spread with the matting Laplacian of the picture of chromaticities; (H, W, 3), green as it was.

    Parameters
    ----------
    photograph : (H, W, 3) linear camera RGB
    lights : (2, 3), a white card's colour under each
    neutral : (3,), the same under the neutral light
    """
    height, width = photograph.shape[:2]
    values = np.maximum(photograph.reshape(-1, 3).astype(np.float64), 0.0)
    floor = _DARK * max(values[:, 1].max(), 1e-12)
    lit = values.min(axis=1) > floor
    seen = np.log(np.maximum(values, floor)[:, [0, 2]] / np.maximum(values[:, 1:2], floor))
    ratios = lights[:, [0, 2]] / lights[:, 1:2]
    materials = material_colours(seen[lit], ratios)
    known, mixture = unambiguous_mixtures(seen, materials, ratios)
    known &= lit
    laplacian = matting_laplacian(np.exp(seen).reshape(height, width, 2), _EPSILON)
    fidelity = _FIDELITY * known + 1e-6  # which keeps what nothing tells in the middle
    spread = spsolve(laplacian + diags_array(fidelity), fidelity * np.where(known, mixture, 0.5))
    share = np.clip(spread, 0.0, 1.0)[:, None]
    light = share * lights[0] / lights[0, 1] + (1 - share) * lights[1] / lights[1, 1]
    balanced = values / light * neutral / neutral[1]
    return np.asarray(balanced.reshape(photograph.shape), dtype=np.float32)


def material_colours(seen: Floats64, ratios: Floats64) -> Floats64:
    """Logarithms (m, 2) of the R/G and B/G of the materials that explain most pixels, by voting.

    seen: (n, 2), logarithms of the pixels' ratios. ratios: (2, 2), of the two lights. Each pixel
    votes for every material that one of the mixtures could show like it; the one with the most
    votes is taken, the pixels it explains vote no more, and so on.
    """
    seen = seen[:: max(1, len(seen) // _VOTERS)]
    side = round(2 * _REACH / _BIN) + 1
    paths = seen[:, None, :] - _mixed(_MIXTURES, ratios)[None]
    bins = np.round((np.clip(paths, -_REACH, _REACH) + _REACH) / _BIN).astype(np.int64)
    votes = bins[..., 0] * side + bins[..., 1]
    fresh = np.ones(votes.shape, bool)
    fresh[:, 1:] = votes[:, 1:] != votes[:, :-1]  # one vote for each bin on the way
    waiting = np.ones(len(seen), bool)
    found: list[Floats64] = []
    while len(found) < _MATERIALS and waiting.any():
        counts = np.bincount(votes[waiting][fresh[waiting]], minlength=side**2)
        winner = int(counts.argmax())
        if counts[winner] < _FEW * len(seen):
            break
        place = np.array(divmod(winner, side))
        found.append(place * _BIN - _REACH)
        waiting &= ~(np.abs(bins - place).max(axis=2) <= 1).any(axis=1)
    return np.array(found).reshape(-1, 2)


def unambiguous_mixtures(
    seen: Floats64, materials: Floats64, ratios: Floats64
) -> tuple[NDArray[np.bool_], Floats64]:
    """Where just one material explains a pixel (n,), and the share of the first light then (n,)."""
    grid = np.linspace(0.0, 1.0, 201)
    mixed = _mixed(grid, ratios)
    explained = np.zeros(len(seen), np.int64)
    mixture = np.zeros(len(seen))
    for material in materials:
        # the light that the material would need, against all mixtures along their longer side
        light = seen - material
        axis = int(np.ptp(mixed, axis=0).argmax())
        order = np.argsort(mixed[:, axis])
        share = np.interp(light[:, axis], mixed[order, axis], grid[order])
        fits = np.abs(light - _mixed(share, ratios)).max(axis=1) <= 1.5 * _BIN
        explained += fits
        mixture = np.where(fits, share, mixture)
    return explained == 1, mixture


def _mixed(shares: Floats64, ratios: Floats64) -> Floats64:
    """Logarithms (n, 2) of the R/G and B/G of mixtures, shares (n,) of the first light's green."""
    return np.asarray(np.log(shares[:, None] * ratios[0] + (1 - shares[:, None]) * ratios[1]))
