"""The committed Python messages are those of schemas/showc.proto, and documented."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

from google.protobuf.descriptor_pb2 import FileDescriptorSet

from showc.log import schema
from showc.log import showc_pb2 as pb

SCHEMAS = Path(__file__).parents[2] / "schemas"


def test_generated_messages_are_up_to_date(tmp_path):
    found = tmp_path / "set.bin"
    command = [
        *(sys.executable, "-m", "grpc_tools.protoc"),
        *("-I", SCHEMAS, f"--descriptor_set_out={found}", SCHEMAS / "showc.proto"),
    ]
    subprocess.run(command, check=True)
    wanted = FileDescriptorSet.FromString(found.read_bytes())
    for file in wanted.file:
        file.ClearField("source_code_info")
    ours = FileDescriptorSet.FromString(schema.descriptor_set(pb.Rules))
    # protoc fills in the JSON names, which say nothing new.
    for files in (wanted.file, ours.file):
        for file in files:
            for message in file.message_type:
                for field in message.field:
                    field.ClearField("json_name")
                for nested in message.nested_type:
                    for field in nested.field:
                        field.ClearField("json_name")
    assert ours == wanted


def test_every_topic_and_message_is_documented():
    text = (SCHEMAS / "README.md").read_text()
    topics = {
        schema.FLEET,
        schema.PREDICTED,
        schema.TRANSFORMS,
        schema.SCENE,
        schema.RULES,
        schema.SEGMENTS,
        "/drone/NNNN/state",
        "/drone/NNNN/trajectory",
    }
    assert topics <= set(re.findall(r"`(/[^`]+)`", text))
    for name in pb.DESCRIPTOR.message_types_by_name:
        assert f"`{name}`" in text or f"showc.{name}" in text


def test_messages_load_without_the_planner():
    code = (
        "import sys, showc.log.showc_pb2; "
        "print(*(m for m in sys.modules if m.startswith('showc')))"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], check=True, capture_output=True, text=True
    )
    allowed = {"showc", "showc._version", "showc.log", "showc.log.showc_pb2"}
    assert set(result.stdout.split()) <= allowed
