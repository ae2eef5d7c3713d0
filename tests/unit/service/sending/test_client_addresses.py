"""What the client makes of the address of a service, and of one that sends requests on."""

from __future__ import annotations

import socketserver
import ssl
import threading
from collections.abc import Callable
from pathlib import Path

import httpx
import pytest

from pipeline.errors import OptionError
from service.sending.client import Client
from service.sending.failures import ServiceAwayError
from tests.certificates import self_signed
from tests.ports import free_port


def _begin_upload(client: Client) -> object:
    return client.create_upload(5)


def _submit_uploads(client: Client) -> object:
    return client.submit_uploads({"no_flash": "1", "flash": "2"}, {}, "key")


def test_a_service_that_sends_on_to_no_hosts_name_is_away(client: Client) -> None:
    def send_on(_request: httpx.Request) -> httpx.Response:
        return httpx.Response(307, headers={"location": "http://a..b/jobs"})

    mounts = {"all://service": httpx.MockTransport(send_on)}
    client._http = httpx.Client(base_url="http://service", mounts=mounts, follow_redirects=True)
    with pytest.raises(ServiceAwayError, match="does not answer: start it, or check its address"):
        client.check_ready()


def test_a_certificate_that_nobody_vouches_for_is_told_as_such(tmp_path: Path) -> None:
    certificate = tmp_path / "certificate"
    certificate.write_bytes(self_signed("service"))
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(certificate)
    with socketserver.TCPServer(("127.0.0.1", 0), socketserver.StreamRequestHandler) as server:
        server.socket = context.wrap_socket(server.socket, server_side=True)
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        place = f"https://127.0.0.1:{server.server_address[1]}"
        with pytest.raises(
            ServiceAwayError, match=f"service at {place} is none that this computer trusts for it"
        ) as raised:
            Client(place).check_ready()
        server.shutdown()
        thread.join()
    assert not raised.value.passes


@pytest.mark.parametrize("use", [_begin_upload, _submit_uploads])
def test_an_address_that_sends_on_what_it_is_asked_is_told(
    client: Client, use: Callable[[Client], object]
) -> None:
    """As proxies send http:// on to https://, where a POST arrives as a GET."""

    def send_on(request: httpx.Request) -> httpx.Response:
        if request.url.scheme == "https":
            return httpx.Response(405)
        return httpx.Response(301, headers={"location": str(request.url.copy_with(scheme="https"))})

    mounts = {"all://service": httpx.MockTransport(send_on)}
    client._http = httpx.Client(base_url="http://service/api", mounts=mounts, follow_redirects=True)
    with pytest.raises(
        ServiceAwayError, match=r"sends requests on to https://service/api: give that address"
    ):
        use(client)


@pytest.mark.parametrize(
    "url",
    [
        "",
        "localhost:8000",
        "file:///etc",
        "http://",
        "http:///jobs",
        "http://localhost:abc",
        "http://[::1",
        "http://é..",
        "http://a..b",
        f"http://{'a' * 64}.example",
        f"http://{'a/' * 40000}",
    ],
)
def test_only_addresses_of_services_are_taken(url: str) -> None:
    with pytest.raises(OptionError, match="no address of a service"):
        Client(url)


def test_a_password_of_an_address_is_told_to_nobody() -> None:
    port = free_port()
    client = Client(f"http://studio:secret@127.0.0.1:{port}/api")
    with pytest.raises(ServiceAwayError) as raised:
        client.check_ready()
    place = f"http://127.0.0.1:{port}/api"
    assert str(raised.value).startswith(f"The service at {place} does not answer: start it")


def test_a_key_is_not_given_up_for_a_password() -> None:
    with pytest.raises(OptionError, match="take the place of the key, which would not be sent"):
        Client("http://studio:secret@127.0.0.1", "ll_key")
