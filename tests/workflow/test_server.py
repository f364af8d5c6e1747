"""`relight ui` and the port that it is to take."""

import os
import socket
from dataclasses import replace

import pytest

from relight.core.errors import UserError
from relight.lab.tracking import server
from relight.settings import Track


@pytest.fixture
def started(tmp_path, monkeypatch):
    """The commands that `serve` became: it stays this process here, in a folder of its own and without a store."""
    commands = []
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(os, "environ", dict(os.environ))
    monkeypatch.setattr(os, "execv", lambda path, words: commands.append(words))
    monkeypatch.setattr(server, "_experiment", lambda track: "1")
    return commands


@pytest.mark.parametrize("taken", ["127.0.0.1", "0.0.0.0", "silent"])
def test_a_port_that_another_program_has_is_refused(started, capsys, taken):
    """Whether it listens on this machine, on all of its addresses as AirPlay does, or only has the port."""
    with socket.socket() as other:
        other.bind(("127.0.0.1" if taken == "silent" else taken, 0))
        port = other.getsockname()[1]
        if taken != "silent":
            other.listen()
        with pytest.raises(UserError, match=rf"port {port} cannot be used \(.+\): give another with --port"):
            server.serve(Track("sqlite:///a.db", "test"), port)
    assert not started and not capsys.readouterr().out


def test_a_port_that_was_closed_just_now_is_free_and_a_server_of_others_needs_none(started, capsys):
    """The connection that the former server closed still waits in the kernel."""
    with socket.create_server(("127.0.0.1", 0)) as former:
        port = former.getsockname()[1]
        with socket.create_connection(("127.0.0.1", port)) as caller:
            former.accept()[0].close()
            assert caller.recv(1) == b""
    server.serve(Track("sqlite:///a.db", "test"), port)
    assert started.pop()[-1] == str(port) and f"http://127.0.0.1:{port}/#/experiments/1" in capsys.readouterr().out
    with socket.create_server(("127.0.0.1", 0)) as other:
        server.serve(Track("http://example.org:5000/", "test"), other.getsockname()[1])
    assert not started and "http://example.org:5000/#/experiments/1" in capsys.readouterr().out


@pytest.mark.slow
def test_an_experiment_that_is_not_among_the_others_is_not_made(tmp_path):
    track = Track(f"sqlite:///{tmp_path}/a.db", "mine")
    assert server._experiment(track) == server._experiment(track) == "1"
    with pytest.raises(UserError, match=r"db has no experiment typo: `relight run name=typo` makes it; there are mine"):
        server._experiment(replace(track, experiment="typo"))
