"""What --help shows below the options: lines to copy."""

from __future__ import annotations


def _block(*lines: str) -> str:
    """Lines that are printed as they stand."""
    return "\n".join(["\b", "Examples:", *(f"  lightlayers {line}" for line in lines)])


SEPARATE = _block(
    "separate a.nef b.nef -o results",
    "separate my_photographs -o results",
    "separate a.jpg b.jpg -o results --lights 2 --outputs lamps.jpg,layers.psd",
    "separate a.dng b.dng -o results --pin-lamp 840,1210,40 --forbid-lamp FL2",
)
MIX = _block(
    "mix results -o mix.jpg --lamp 1:ev=-2,neutral --lamp 2:temperature=2700",
    "mix results -o mix.tif --lamp 1:off",
    "mix results -o mix.exr --preset preset.json",
)
SERVE = _block(
    "serve",
    "serve --host 0.0.0.0 --port 8080",
    "serve --no-worker",
)
SUBMIT = _block(
    "submit a.jpg b.jpg -o results",
    "submit a.jpg b.jpg -o results --url https://host --key-file key.txt",
)
REPORT = _block("report results", "report results -o page.html")
CAPTURE = _block(
    "capture sim://studio -o pair",
    "capture ptp+usb:// -o pair --flash operator",
    "capture ptp+ip://192.168.1.20 -o pair --flash 'http://relay/0?turn={state}' --settle 2",
)
