"""The schema in the real yaml-language-server: diagnostics, completion, hover."""

import json
import subprocess

import pytest
from repository import ROOT

SCHEMA = ROOT / "schemas" / "show.schema.json"


class Server:
    """Speaks the Language Server Protocol with a process over its streams."""

    def __init__(self, command):
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
        self.number = 0

    def send(self, method, params, number=None):
        message = {"jsonrpc": "2.0", "method": method, "params": params}
        if number is not None:
            message["id"] = number
        self._write(message)

    def _write(self, message):
        body = json.dumps(message).encode()
        self.process.stdin.write(b"Content-Length: %d\r\n\r\n" % len(body) + body)
        self.process.stdin.flush()

    def receive(self):
        size = 0
        while line := self.process.stdout.readline().strip():
            if line.lower().startswith(b"content-length:"):
                size = int(line.split(b":")[1])
        return json.loads(self.process.stdout.read(size))

    def until(self, wanted):
        while True:
            message = self.receive()
            if "id" in message and "method" in message:  # the server asks us
                count = len(message["params"].get("items", []))
                self._write(
                    {"jsonrpc": "2.0", "id": message["id"], "result": [None] * count}
                )
            elif wanted(message):
                return message

    def ask(self, method, params):
        self.number += 1
        number = self.number
        self.send(method, params, number)
        return self.until(lambda message: message.get("id") == number)["result"]


@pytest.fixture(scope="module")
def server(npm):
    modules = npm("yaml-language-server")
    binary = modules / "yaml-language-server" / "bin" / "yaml-language-server"
    server = Server(["node", binary, "--stdio"])
    server.ask("initialize", {"processId": None, "rootUri": None, "capabilities": {}})
    server.send("initialized", {})
    yield server
    server.process.kill()
    server.process.wait()


@pytest.fixture
def opened(server, tmp_path):
    """Open a script; return its URI and what the server finds wrong with it."""

    def open_(text):
        text = f"# yaml-language-server: $schema={SCHEMA}\n{text}"
        path = tmp_path / f"show{server.number}.yaml"
        path.write_text(text, encoding="utf-8")
        server.number += 1
        document = {
            "uri": path.as_uri(), "languageId": "yaml", "version": 1, "text": text,
        }  # fmt: skip
        server.send("textDocument/didOpen", {"textDocument": document})
        found = server.until(
            lambda message: (
                message.get("method") == "textDocument/publishDiagnostics"
                and message["params"]["uri"] == path.as_uri()
            )
        )
        return path.as_uri(), found["params"]["diagnostics"]

    return open_


SCRIPT = (
    "showc: 1\nseparation: 2 m\nformations:\n"
    "  ring: {type: circle, radius: 8, colour: gold}\ntransitions:\n  - to: ring\n"
)


def test_a_right_script_is_right(opened):
    assert opened(SCRIPT)[1] == []


@pytest.mark.parametrize("name", ["grid", "swap", "chapters", "first"])
def test_the_shows_are_right(opened, name):
    assert (
        opened((ROOT / "shows" / f"{name}.yaml").read_text(encoding="utf-8"))[1] == []
    )


def test_faults_are_on_their_lines(opened):
    _, found = opened(
        "showc: 1\nseperation: 2\nlimits: {tilt: 200}\nformations:\n"
        "  ring: {type: circle, radius: 8}\ntransitions:\n  - to: ring\n"
    )
    lines = {item["range"]["start"]["line"] for item in found}
    assert lines == {2, 3}
    assert any("seperation" in item["message"] for item in found)


def test_keys_are_completed(opened, server):
    uri, _ = opened("showc: 1\nlimits:\n  t\n")
    completed = server.ask(
        "textDocument/completion",
        {"textDocument": {"uri": uri}, "position": {"line": 3, "character": 3}},
    )
    items = completed["items"] if isinstance(completed, dict) else completed
    labels = {item["label"] for item in items}
    assert {"tilt", "thrust_max", "torque"} <= labels


def test_a_formations_own_keys_are_completed(opened, server):
    uri, _ = opened("showc: 1\nformations:\n  ring:\n    type: circle\n    ra\n")
    completed = server.ask(
        "textDocument/completion",
        {"textDocument": {"uri": uri}, "position": {"line": 5, "character": 6}},
    )
    items = completed["items"] if isinstance(completed, dict) else completed
    assert "radius" in {item["label"] for item in items}


def test_hovering_explains_a_key(opened, server):
    uri, _ = opened(SCRIPT)
    hover = server.ask(
        "textDocument/hover",
        {"textDocument": {"uri": uri}, "position": {"line": 2, "character": 3}},
    )
    assert "Distance that any two drones keep" in json.dumps(hover)
