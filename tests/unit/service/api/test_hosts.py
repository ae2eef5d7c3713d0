from __future__ import annotations

import socket

import httpx
import pytest

from service.settings import Settings


@pytest.mark.parametrize("host", ["evil.example", "evil.example:8000", "192.168.1.7"])
@pytest.mark.parametrize(("method", "path"), [("GET", "/jobs"), ("POST", "/jobs")])
def test_a_service_on_loopback_answers_to_no_other_name(
    method: str, path: str, host: str, http: httpx.Client
) -> None:
    answer = http.request(method, path, headers={"host": host})
    assert answer.status_code == 421
    assert answer.json()["type"] == "urn:lightlayers:problem:foreign-host"


@pytest.mark.parametrize(
    "host",
    [
        "a`b.evil.example:8000",
        'a"b.evil.example',
        "a{b}.evil.example",
        "a b",
        "[",
        "[::1",
        "localhost:abc",
        "127.0.0.1:99999999",
        "127.0.0.1:65536",
        "evil.example@localhost",
        "",
    ],
)
def test_a_host_that_cannot_be_read_is_not_taken_for_the_service(
    host: str, http: httpx.Client
) -> None:
    answer = http.get("/jobs", headers={"host": host})
    assert answer.status_code == 421
    assert answer.json()["type"] == "urn:lightlayers:problem:foreign-host"


def test_a_request_without_a_host_is_refused(http: httpx.Client) -> None:
    with socket.create_connection((http.base_url.host, http.base_url.port or 80), 60) as client:
        client.sendall(b"GET /jobs HTTP/1.0\r\n\r\n")
        assert client.recv(12) == b"HTTP/1.1 421"


@pytest.mark.parametrize("host", ["localhost", "LOCALHOST:8000", "127.0.0.1:9", "[::1]:8000"])
def test_it_answers_to_its_own_names(host: str, http: httpx.Client) -> None:
    assert http.get("/jobs", headers={"host": host}).status_code == 200


class TestEveryNetwork:
    @pytest.fixture
    def settings(self, settings: Settings) -> Settings:
        return settings.model_copy(update={"host": "0.0.0.0"})

    def test_a_service_on_every_network_answers_to_any_name(self, http: httpx.Client) -> None:
        assert http.get("/healthz", headers={"host": "studio.example"}).status_code == 200
