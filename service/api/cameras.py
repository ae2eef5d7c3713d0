"""Routes of cameras."""

from __future__ import annotations

from fastapi import APIRouter

import drivers
from service.api.models import CameraAnswer
from service.api.problems import responses

router = APIRouter(tags=["cameras"])


@router.get("/cameras", response_model=list[CameraAnswer], responses=responses(drivers.DriverError))
def list_cameras() -> list[CameraAnswer]:
    """List cameras that can take a pair now."""
    return [
        CameraAnswer(address=camera.address, make=camera.make, model=camera.model)
        for camera in drivers.list_cameras()
    ]
