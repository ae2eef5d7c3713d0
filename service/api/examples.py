"""Examples for the OpenAPI document; those of problems are written with the problems."""

from __future__ import annotations

import json
from typing import Any

_ID = "4aab9f8e1d6c495a96330fdd958d0610"
_OTHER_ID = "7c1f0a52b7e94d0f8a3f6b1d2c9e8f70"
_SHA256 = "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08"
_WEBHOOK = {
    "url": "https://example.org/hook",
    "secret": "whsec_bGF0ZXIgdGhpcyBrZXkgc2lnbnMgd2hhdCBjb21lcw==",
}
_PLACE = f"1764085200.5-{_ID}"
_UPLOADS = {"no_flash": _ID, "flash": _OTHER_ID}
_JOB: dict[str, Any] = {
    "id": _ID,
    "owner": "",
    "state": "queued",
    "priority": "normal",
    "stage": None,
    "fraction": 0.0,
    "progress": 0.0,
    "position": 3,
    "eta": "2026-01-01T12:00:21Z",
    "attempt": 0,
    "options": {"lights": 2},
    "capture": None,
    "camera_settings": None,
    "operator": None,
    "inputs": {"no_flash": {"sha256": _SHA256}, "flash": {"sha256": _SHA256[::-1]}},
    "taken_with": None,
    "error": None,
    "files": [],
    "created": "2026-01-01T12:00:00Z",
    "started": None,
    "finished": None,
    "deadline": None,
    "expires": None,
    "webhook": None,
    "links": {
        "self": f"/jobs/{_ID}",
        "cancel": f"/jobs/{_ID}/cancel",
        "confirm": None,
        "results": None,
        "zip": None,
    },
}
_DONE: dict[str, Any] = {
    **_JOB,
    "state": "succeeded",
    "position": None,
    "eta": None,
    "fraction": 1.0,
    "progress": 1.0,
    "attempt": 1,
    "files": [
        {
            "name": "lamp1.jpg",
            "size": 1883412,
            "sha256": _SHA256,
            "media_type": "image/jpeg",
            "href": f"/jobs/{_ID}/results/lamp1.jpg",
        }
    ],
    "started": "2026-01-01T12:00:09Z",
    "finished": "2026-01-01T12:00:19Z",
    "links": {
        "self": f"/jobs/{_ID}",
        "cancel": None,
        "confirm": None,
        "results": f"/jobs/{_ID}/results",
        "zip": f"/jobs/{_ID}/results.zip",
    },
}

_CAMERA = {
    "id": "c2ltOi8vc3R1ZGlv",
    "address": "sim://studio",
    "make": "Nikon",
    "model": "D5100",
    "serial": "5001234",
    "state": "idle",
    "battery_percent": 84,
    "free_bytes": 31_000_000_000,
    "holder": None,
    "waiting": 0,
}
_CAMERA_SETTINGS = {"iso": {"value": 100, "choices": [100, 200, 400], "writable": True}}

_KEPT: dict[str, Any] = {
    "id": _ID,
    "kind": "flash",
    "setup": "table",
    "camera": "Nikon D5100",
    "made": "2026-01-01T12:00:21Z",
    "links": _DONE["links"],
}
SCHEMAS: dict[str, list[Any]] = {
    "CalibrationRequest": [
        {"uploads": _UPLOADS, "options": {"kind": "flash", "card": {"x": 30, "y": 12, "radius": 5}}}
    ],
    "CameraAnswer": [_CAMERA],
    "CameraCapture": [{"flash": "operator", "settings": {"iso": 100}, "options": {"lights": 2}}],
    "CaptureRequest": [
        {"capture": {"camera": "sim://studio"}},
        {
            "capture": {"camera": "ptp+usb://"},
            "options": {"lights": 3},
            "priority": "high",
            "deadline_seconds": 600,
            "webhook": _WEBHOOK,
        },
    ],
    "Handling": [{"priority": "high", "deadline_seconds": 600, "webhook": _WEBHOOK}],
    "Health": [{"status": "ok"}],
    "JobAnswer": [_JOB, _DONE],
    "JobList": [{"jobs": [_JOB]}],
    "JobPage": [{"jobs": [_DONE], "next": f"/jobs?limit=1&after={_PLACE}"}],
    "KeptCalibrations": [{"calibrations": [_KEPT]}],
    "MixJob": [{"lamps": [{"ev": -2, "neutral": True}, {"temperature_k": 2700}], "format": "tiff"}],
    "RerunRequest": [{"options": {"lights": 3}, "priority": "low"}, {"swapped": True}],
    "SettingsRequest": [{"iso": 200}],
    "UploadsRequest": [{"uploads": _UPLOADS, "options": {"lights": 2}}],
}
"""Of the bodies of requests and answers, by the names of their schemas."""

_PARAMETERS: dict[str, Any] = {
    "after": _PLACE,
    "camera": "d5100",
    "camera_id": _CAMERA["id"],
    "idempotency-key": "6f2c1a4e-9d0b-4c53-8f3e-2a7d5b1c0e94",
    "if-none-match": f'"{_SHA256}"',
    "if-range": f'"{_SHA256}"',
    "job_id": _ID,
    "last-event-id": "7",
    "height": 600,
    "left": 1200,
    "limit": 50,
    "name": "lamp1.jpg",
    "prefer": "wait=30",
    "range": "bytes=0-1023",
    "request": 1,
    "setup": "table",
    "tus-resumable": "1.0.0",
    "upload-checksum": "sha256 n4bQgYhMfWWaL+qgxVrQFaO/TxsrC4Is0V1sFbDwCgg=",
    "upload-length": "7340032",
    "upload-metadata": "filename YS5kbmc=",
    "upload-offset": "4194304",
    "top": 800,
    "upload_id": _ID,
    "width": 900,
}
_FORM = {
    "no_flash": "(the bytes of a.dng)",
    "flash": "(the bytes of b.dng)",
    "handling": '{"priority": "high"}',
}
_FORMS = {
    "/jobs": {**_FORM, "options": '{"lights": 2}'},
    "/calibrations": {
        **_FORM,
        "options": '{"kind": "flash", "card": {"x": 30, "y": 12, "radius": 5}}',
    },
}
_WARNING = {
    "code": "flash_too_weak",
    "message": "The flash does not reach 12 % of the picture; bring it nearer.",
    "figures": {"share": 0.12},
}
_ANSWERS: dict[str, Any] = {
    "/cameras/events": f"data: {json.dumps([_CAMERA])}\n\n",
    "/cameras/{camera_id}/settings": _CAMERA_SETTINGS,
    "/jobs/{job_id}/events": f'id: 7\ndata: {{"id": "{_ID}", "state": "running"}}\n\n',
    "/jobs/{job_id}/results": {
        "exposure_ratio": 1.0,
        "exposure_source": "exif",
        "files": [{"name": "lamp1.jpg", "sha256": _SHA256}],
        "warnings": [_WARNING],
        "versions": {"lightlayers": "0.1.0"},
    },
}


def add(document: dict[str, Any]) -> None:
    """Put the examples into an OpenAPI document."""
    for name, examples in SCHEMAS.items():
        document["components"]["schemas"][name]["examples"] = examples
    for path, operations in document["paths"].items():
        for operation in operations.values():
            for parameter in operation.get("parameters", []):
                if parameter["name"] in _PARAMETERS:
                    parameter["example"] = _PARAMETERS[parameter["name"]]
            body = operation.get("requestBody", {}).get("content", {})
            if "multipart/form-data" in body:
                body["multipart/form-data"]["example"] = _FORMS[path]
            if path in _ANSWERS:
                for media in operation["responses"]["200"]["content"].values():
                    media["example"] = _ANSWERS[path]
