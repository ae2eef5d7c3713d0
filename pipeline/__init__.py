"""From a pair of photographs to the light of every lamp. Arrays and files; no HTTP, no queue."""

from pipeline.options import Options
from pipeline.process import check_pair, separate_files
from pipeline.progress import Progress

__all__ = ["Options", "Progress", "check_pair", "separate_files"]
