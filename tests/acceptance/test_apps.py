"""What docs/apps.md shows for apps, run as it stands there against a service."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx
import pytest
from PIL import Image

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/apps.md").read_text()


@pytest.fixture
def client(tmp_path: Path) -> Path:
    """A folder with the generated types and, in client.py, the page's Python."""
    (command,) = re.findall(r"^datamodel-codegen (.*)$", PAGE, re.MULTILINE)
    generate = [sys.executable, "-W", "error", "-m", "datamodel_code_generator"]
    made = [*generate, *shlex.split(command), "--input", str(ROOT / "openapi.json")]
    subprocess.run(made, cwd=tmp_path, check=True)
    blocks = re.findall(r"^```python\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE)
    (tmp_path / "client.py").write_text("\n".join(blocks))
    return tmp_path


def test_the_generated_client_is_typed_throughout(client: Path) -> None:
    checked = ["lightlayers_types.py", "client.py"]
    command = [sys.executable, "-m", "mypy", "--strict", "--config-file=", *checked]
    done = subprocess.run(command, cwd=client, capture_output=True, text=True)
    assert done.stdout == "Success: no issues found in 2 source files\n", done.stderr
    wrong = client / "client.py"
    wrong.write_text(wrong.read_text().replace('"quality": "fast"', '"quality": "hasty"'))
    done = subprocess.run(command, cwd=client, capture_output=True, text=True)
    assert "client.py" in done.stdout and '"quality"' in done.stdout


def test_the_generated_client_separates_and_mixes(
    client: Path, service: httpx.Client, scene: Callable[..., Any]
) -> None:
    for name, photograph in zip(("a.jpg", "b.jpg"), scene(2).jpeg, strict=True):
        (client / name).write_bytes(photograph.read_bytes())
    program = client / "client.py"
    address = str(service.base_url).rstrip("/")
    program.write_text(program.read_text().replace("http://localhost:8000", address))
    subprocess.run([sys.executable, "-W", "error", program], cwd=client, check=True)
    for name in ("lamp1.jpg", "mix.jpg"):
        with Image.open(client / name) as picture, Image.open(client / "a.jpg") as photograph:
            assert picture.size == photograph.size
    newest = service.get("/jobs", params={"limit": 1}).json()["jobs"][0]
    assert newest["options"]["mix"]["lamps"][1]["ev"] == -2
    assert {file["name"] for file in newest["files"]} == {"mix.jpg", "manifest.json"}


def test_every_answer_to_the_swift_client_is_looked_at() -> None:
    """There is no Swift here to run it with: what asks is one function, which knows problems."""
    (swift,) = re.findall(r"^```swift\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE)
    (_, loading) = swift.split("func load(")
    assert swift.count("URLSession.shared.data(") == loading.count("URLSession.shared.data(") == 1
    assert "status < 400" in loading and "Problem.self" in loading
