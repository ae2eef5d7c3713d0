from __future__ import annotations

import subprocess
import sys

CALLED = """
from pipeline.images import area_strips
from pipeline.pair import one_surface, tone_curve
from pipeline.photometric_stereo import detail
from pipeline.pictures import clipped
from pipeline.separation import fill_alike
from service import compile

compile._call_others()
loops = area_strips._share_out, tone_curve._multiply, one_surface._peak, fill_alike._fill
loops = *loops, detail._add_detail, clipped._show
print(*(len(loop.signatures) for loop in loops))
"""


def test_loops_that_no_pair_reaches_are_called() -> None:
    """In a process of its own, where nothing else has called them; one for each number of lamps."""
    done = subprocess.run(
        [sys.executable, "-c", CALLED], capture_output=True, text=True, check=True
    )
    assert done.stdout == "1 1 1 1 1 3\n"
