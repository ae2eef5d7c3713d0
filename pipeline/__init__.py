"""From a pair of photographs to the light of every lamp. Arrays and files; no HTTP, no queue."""

from pipeline.process import check_pair, separate_files

__all__ = ["check_pair", "separate_files"]
