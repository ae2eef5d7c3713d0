"""What becomes of a pair under each fault, by backend: python -m tests.tether.table.

The columns sim and ptp+usb run with a simulated clock; ptp+ip, gphoto2 and the program gphoto2 are
clients of simulated cameras on the network and take about a quarter of an hour, side by side. A
cell says how the pair ended and how the next one did, with the fault gone.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import cast, get_args

import drivers
from drivers.clock import Clock, SystemClock
from drivers.ptp import usb
from drivers.ptp.camera import open_awake
from drivers.sim.address import SimulatedCamera
from drivers.sim.backend import InProcessTransport
from drivers.sim.body import Body
from drivers.sim.faults import Fault
from drivers.sim.ip_responder import IpResponder
from drivers.sim.usb_bus import SimulatedBus
from tests.tether.faults import QuickClock, check_pair

FAULTS = tuple(fault for fault in cast(Sequence[Fault], get_args(Fault)) if fault != "none")
_OF_A_WIRE = {"short_packets", "glued_packets", "slow_link"}
_OF_USB = {"stall"}
_CLIENT_S = 45.0
_SHOT = ("--set-config-value", "flashmode=Flash off", "--capture-image-and-download")

Open = Callable[[], drivers.Camera]


def can_meet(fault: Fault, backend: str) -> bool:
    """Tell whether a fault can happen on that way to the camera."""
    if fault in _OF_USB:
        return backend == "ptp+usb"
    return fault not in _OF_A_WIRE or backend != "sim"


def attempt(open_: Open, camera: Body, clock: Clock) -> str:
    """Take a pair; tell how that ended, in a word."""
    try:
        with open_() as opened:
            check_pair(drivers.capture_pair(opened, clock=clock), camera)
    except drivers.DriverError as error:
        return type(error).__name__
    return "pair"


def _body(clock: Clock) -> Body:
    return Body(SimulatedCamera(width=64, height=64, format="both"), clock)


def by_sim(fault: Fault) -> str:
    """The simulated camera without a cable."""
    clock = QuickClock()
    camera = _body(clock)

    def open_() -> drivers.Camera:
        return open_awake("sim", lambda: InProcessTransport(camera, clock), clock)

    return _both(open_, camera, fault, clock)


def by_usb(fault: Fault) -> str:
    """The driver of pyusb, on a bus that is simulated."""
    clock = QuickClock()
    camera = _body(clock)
    bus = SimulatedBus(camera, clock)

    def open_() -> drivers.Camera:
        bus.plug_in()
        return open_awake("usb", lambda: usb.connect("", bus, clock), clock)

    return _both(open_, camera, fault, clock)


def by_network(scheme: str, fault: Fault) -> str:
    """Over PTP/IP in real time, by our driver or by libgphoto2 in its child process."""
    clock = SystemClock()
    served = IpResponder(_body(clock))
    host, port = served.address.split(":")
    address = {
        "ptp+ip": f"ptp+ip://{served.address}",
        "gphoto2": f"gphoto2://ptpip:{host}:{port}:{port}",
    }[scheme]
    try:
        return _both(lambda: drivers.open_camera(address), served.body, fault, clock)
    finally:
        served.close()


def _both(open_: Open, camera: Body, fault: Fault, clock: Clock) -> str:
    camera.fault = fault
    first = attempt(open_, camera, clock)
    camera.fault = "none"
    return f"{first}, then {attempt(open_, camera, clock)}"


def by_program(fault: Fault) -> str:
    """Debian's gphoto2: one photograph without the flash."""
    served = IpResponder(_body(SystemClock()))
    port = served.address.partition(":")[2]
    served.body.fault = fault
    with tempfile.TemporaryDirectory() as folder:
        command = ["gphoto2", "--port", f"ptpip:127.0.0.1:{port}:{port}", *_SHOT]
        try:
            done = subprocess.run(
                command, cwd=folder, capture_output=True, text=True, timeout=_CLIENT_S, check=False
            )
        except subprocess.TimeoutExpired:
            return f"has not ended after {_CLIENT_S:.0f} s"
        finally:
            served.close()
        files = len(list(Path(folder).iterdir()))
    return f"exit code {done.returncode}, {files} of 2 files"


COLUMNS: dict[str, Callable[[Fault], str]] = {
    "sim": by_sim,
    "ptp+usb": by_usb,
    "ptp+ip": lambda fault: by_network("ptp+ip", fault),
    "gphoto2": lambda fault: by_network("gphoto2", fault),
    "program gphoto2": by_program,
}


def cell(column: str, fault: Fault) -> str:
    """What a column says of a fault; a dash where it cannot meet it."""
    return COLUMNS[column](fault) if can_meet(fault, column) else "–"


def main() -> None:
    """Print the table of the columns that the command line names, or of all."""
    parser = argparse.ArgumentParser(prog="python -m tests.tether.table", allow_abbrev=False)
    parser.add_argument("columns", nargs="*", choices=[*COLUMNS, []], default=[])
    columns = parser.parse_args().columns or list(COLUMNS)
    with ThreadPoolExecutor(2 * len(columns)) as pool:
        cells = {
            (fault, column): pool.submit(cell, column, fault)
            for fault in FAULTS
            for column in columns
        }
        sys.stdout.write(f"| fault | {' | '.join(columns)} |\n|---|{'---|' * len(columns)}\n")
        for fault in FAULTS:
            row = " | ".join(cells[fault, column].result() for column in columns)
            sys.stdout.write(f"| `{fault}` | {row} |\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
