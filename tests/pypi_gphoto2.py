"""PyPI's gphoto2 as a client: python -m tests.pypi_gphoto2 PORT writes no_flash and flash here.

A program of its own, since the import sends every libgphoto2 below to the plug-ins of the wheel.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import gphoto2

_AGAIN_S = 0.2


def released(camera: gphoto2.Camera) -> gphoto2.CameraFilePath:
    """Take a photograph as soon as the flash is charged, which libgphoto2 does not wait for."""
    while True:
        try:
            return camera.capture(gphoto2.GP_CAPTURE_IMAGE)
        except gphoto2.GPhoto2Error as error:
            if error.code != gphoto2.GP_ERROR_CAMERA_BUSY:
                raise
            time.sleep(_AGAIN_S)


def main(port: str) -> None:
    """Take both photographs of a pair and fetch them."""
    camera = gphoto2.Camera()
    ports, models = gphoto2.PortInfoList(), gphoto2.CameraAbilitiesList()
    ports.load()
    models.load()
    camera.set_port_info(ports[ports.lookup_path(port)])
    camera.set_abilities(models[models.lookup_model("PTP/IP Camera")])
    camera.init()
    try:
        for name, mode in {"no_flash": "Flash off", "flash": "Fill flash"}.items():
            flash = camera.get_single_config("flashmode")
            flash.set_value(mode)
            camera.set_single_config("flashmode", flash)
            taken = released(camera)
            file = camera.file_get(taken.folder, taken.name, gphoto2.GP_FILE_TYPE_NORMAL)
            Path(name).write_bytes(file.get_data_and_size())
    finally:
        camera.exit()


if __name__ == "__main__":
    main(sys.argv[1])
