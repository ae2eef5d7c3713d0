"""From a pair of photographs to the light of every lamp. Arrays and files; no HTTP, no queue.

What works on a pair is in pipeline.process. This file imports nothing, so that who needs the
options alone, like the API, is spared the rest.
"""
