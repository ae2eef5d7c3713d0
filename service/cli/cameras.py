"""The commands of cameras: what there is, take pairs, and the simulated one."""

from __future__ import annotations

import contextlib
import signal
import sys
from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from service.cli.files import say, shown
from service.cli.parameters import (
    AsJson,
    a_number,
    output,
    with_flags,
)
from service.cli.shooting import (
    RECIPE,
    Shooting,
    ShootingFlags,
    ending,
    new_shot,
    paced,
)

if TYPE_CHECKING:
    import drivers

_PAIR_ATTEMPTS = 3
"""How often a pair is begun where the camera goes away in the middle."""


def list_cameras(
    as_json: AsJson = False,
) -> None:
    """List the cameras that are there, and which of them cannot take a pair.

    On the network these are the ones that announce themselves (mDNS), and those that
    LIGHTLAYERS_CAMERAS names. Canon EOS, Sony, Fuji, Panasonic and Olympus take pairs by
    gphoto2:// alone, and many bodies let no computer switch their flash: capture says so first.
    """
    from service.cli.display import print_json

    found = _found()
    if as_json:
        print_json([asdict(info) | {"unable": refusal} for info, refusal in found])
        return
    for info, refusal in found:
        battery = "" if info.battery_percent is None else f", battery {info.battery_percent} %"
        print(f"{info.address}  {f'{info.make} {info.model}'.strip()}{battery}")
        if refusal:
            print(f"  {refusal}")


def _found() -> list[tuple[drivers.CameraInfo, str | None]]:
    """Find the cameras that are there, and why each cannot take a pair; None: it can."""
    import drivers
    from service.settings import Settings

    named = [
        each
        for each in Settings().cameras.split()
        if each.startswith("ptp+ip://") and drivers.names_one_camera(each)
    ]
    drivers.listen_to_network()
    seen = {camera.address: camera for camera in drivers.list_cameras()}
    found = []
    for address in dict.fromkeys((*seen, *named)):
        info, refusal = seen.get(address), None
        # one on the network that was not named may be in use, and drop that for another's look
        if address.startswith("ptp+usb://") or address in named:
            try:
                info, refusal = _look(address)
            except drivers.DriverError as error:
                say(str(error) if address in named else f"{address}: {error}")
        if info:
            found.append((info, refusal))
    return found


def _look(address: str) -> tuple[drivers.CameraInfo, str | None]:
    """What a camera tells of itself, and why it cannot take a pair."""
    import drivers

    with drivers.open_camera(address) as camera:
        info = camera.info()
        try:
            camera.check_release()
        except drivers.SettingError as error:
            return info, str(error)
        return info, None


@with_flags
def capture(
    address: Annotated[str, typer.Argument(metavar="ADDRESS", help="Camera, like sim://studio.")],
    output: Annotated[Path, output("DIR", "Folder of the photographs.")],
    flags: ShootingFlags,
    pairs: Annotated[int, typer.Option(min=1, help="How many pairs.")] = 1,
    interval: Annotated[
        float,
        typer.Option(
            min=0,
            max=86400,
            callback=a_number,
            help="Seconds from the beginning of a pair to the next.",
        ),
    ] = 0.0,
    wait: Annotated[
        float,
        typer.Option(
            min=0,
            callback=a_number,
            help="Seconds to wait for a camera that is not there; a pair in which it goes away is "
            "taken anew once it is back.",
        ),
    ] = 0.0,
    delete: Annotated[
        bool,
        typer.Option("--delete", help="Take the photographs off the camera's card once saved."),
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Have a camera take pairs, and save all of their photographs.

    The files of a pair begin with its time, and beside them is its recipe, the settings, for
    --recipe.
    """
    import drivers
    from service.cli.display import print_json

    shooting = flags.shooting()
    saved: list[dict[str, Any]] = []
    try:
        with contextlib.closing(drivers.ReturningCamera(address, say)) as camera:
            for _ in paced(pairs, interval):
                about, clear = _take(camera, wait, output, shooting)
                saved.append(about)
                if not as_json:
                    print(*map(shown, about["files"]), sep="\n", flush=True)
                if delete:  # the card's copy goes only now that there is another
                    clear()
    finally:
        if as_json and saved:
            print_json({"pairs": saved})


def _take(
    camera: drivers.ReturningCamera,
    wait_s: float,
    output: Path,
    shooting: Shooting,
) -> tuple[dict[str, Any], Callable[[], None]]:
    """Take and save one pair; its name and its files, and what takes it off the card."""
    from pipeline.errors import InputError, reason_of
    from service import durable
    from service.cli.results_folder import new_results
    from service.sending.recipe import Recipe

    with new_results(output) as folder:
        opened, taker, pair = _capture(camera, wait_s, shooting)
        shot = new_shot()
        recipe, made = f"{shot}{RECIPE}", Recipe.of(pair, taker)
        frames = {"no_flash": pair.no_flash, "flash": pair.flash}
        photographs = {
            f"{shot}_{frame}.{ending(kind)}": data
            for frame, taken in frames.items()
            for kind, data in taken.files.items()
        }
        names = list(photographs)
        try:
            for name, data in photographs.items():
                durable.write(folder / name, data)
            durable.write(folder / recipe, f"{made.model_dump_json(indent=2)}\n".encode())
        except OSError as error:
            raise InputError(
                f"The folder {output} cannot be written: {reason_of(error)}. See to it and its "
                "disk: the pair is on the camera's card alone."
            ) from error
    try:
        durable.flush(output)
    except OSError as error:
        raise InputError(f"The folder {output} cannot be written: {reason_of(error)}.") from error
    paths = [str(output / name) for name in names]
    about = {"shot": shot, "files": paths, "recipe": str(output / recipe)}
    return about, partial(_clear, opened, pair)


def _clear(camera: drivers.Camera, pair: drivers.CapturedPair) -> None:
    """Take a pair off the card, by the connection that took it: another may number it anew."""
    import drivers

    try:
        pair.delete_from(camera)
    except drivers.DriverError as error:
        raise drivers.CaptureError(
            "The pair is saved, but could not be taken off the camera's card: delete it there."
        ) from error


def _capture(
    camera: drivers.ReturningCamera,
    wait_s: float,
    shooting: Shooting,
) -> tuple[drivers.Camera, drivers.CameraInfo, drivers.CapturedPair]:
    """Take a pair; with which camera. It is asked before: after the pair it may be gone."""
    import drivers

    for left in reversed(range(_PAIR_ATTEMPTS)):
        opened = camera.connected(wait_s)  # which has waited already for what it raises
        try:
            taker = opened.info()
            return opened, taker, shooting.take(opened)
        except (
            drivers.CameraDisconnectedError,
            drivers.CameraTimeoutError,
            drivers.ProtocolError,
        ) as error:
            camera.close()
            if not wait_s or not left:
                raise
            say(f"{error} The whole pair is taken anew.")
    raise AssertionError


def simcam(
    address: Annotated[
        str, typer.Argument(metavar="ADDRESS", help="Which simulated camera.")
    ] = "sim://studio",
    host: Annotated[str, typer.Option(help="Address to listen on.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Port to listen on; 0 takes any.")] = 15740,
) -> None:
    """Serve a simulated camera by PTP/IP, for trying things out.

    Lines like "fault busy" on stdin make it go wrong; each is repeated once it holds.

    It announces itself on the network of its host (mDNS).
    """
    import drivers

    camera = drivers.serve_simulated(address, host, port)
    print(f"ptp+ip://{camera.address}", flush=True)
    with contextlib.suppress(KeyboardInterrupt), drivers.announce_simulated(camera) as announced:
        if not announced:
            say("The network lets it not be announced: give its address to who is to find it.")
        for line in sys.stdin:
            try:
                camera.order(line)
            except drivers.BadAddressError as error:
                say(str(error))
            else:
                print(line.strip(), flush=True)
        signal.pause()  # stdin is at its end: it serves until it is stopped
    camera.close()
