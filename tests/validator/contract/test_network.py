"""Tests reach no network, and say so when they try."""

from __future__ import annotations

import socket

import pytest


def test_internet_sockets_connect_to_nothing() -> None:
    for family in (socket.AF_INET, socket.AF_INET6):
        with socket.socket(family) as client:
            with pytest.raises(RuntimeError, match="tests run without network"):
                client.connect(("localhost", 9))
            with pytest.raises(RuntimeError, match="tests run without network"):
                client.connect_ex(("localhost", 9))


def test_datagrams_are_not_sent() -> None:
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client,
        pytest.raises(RuntimeError, match="tests run without network"),
    ):
        client.sendto(b"", ("localhost", 9))


def test_names_are_not_looked_up() -> None:
    with pytest.raises(RuntimeError, match="tests run without network"):
        socket.create_connection(("localhost", 9), timeout=1)


@pytest.mark.skipif(not hasattr(socket, "AF_UNIX"), reason="the platform has no local sockets")
def test_local_sockets_connect() -> None:
    left, right = socket.socketpair()
    with left, right:
        left.sendall(b"x")
        assert right.recv(1) == b"x"
