"""Type identifiers equal the vendor's: the difference is invisible on the wire and crashes cyclonedds 0.10 peers."""

import hashlib
import json
from pathlib import Path
from typing import Any

import pytest

from sim.backends.unitree.dds import INSTALL_HINT

pytest.importorskip("cyclonedds", reason=INSTALL_HINT)

from sim.backends.unitree import idl
from sim.backends.unitree.messages import LowState

pytestmark = pytest.mark.hardware
GOLDEN = json.loads((Path(__file__).parent / "golden" / "unitree.json").read_text())
KINDS = {"LowCmd_": idl.LowCmd_, "LowState_": idl.LowState_, "Request_": idl.Request_, "Response_": idl.Response_}


def type_blobs(kind: Any) -> tuple[bytes, bytes]:
    kind.__idl__.populate()
    kind.__idl__.fill_type_data()
    return kind.__idl__._xt_bytedata


@pytest.mark.parametrize("name", KINDS)
def test_type_information_equals_the_vendor_python_classes(name: str) -> None:
    information, mapping = type_blobs(KINDS[name])
    assert information.hex() == GOLDEN["type_info"][name]
    assert hashlib.sha256(mapping).hexdigest() == GOLDEN["type_map_sha256"][name]


@pytest.mark.parametrize("name", ["LowCmd_", "LowState_"])
def test_type_information_equals_the_vendor_cpp_headers(name: str) -> None:
    assert type_blobs(KINDS[name])[0].hex() == GOLDEN["type_info_cpp"][name]


@pytest.mark.parametrize("name", ["Request_", "Response_"])
def test_rpc_type_identifiers_equal_the_vendor_cpp_headers(name: str) -> None:
    """The order of the listed dependencies differs between the generators; the identifiers themselves may not."""
    ours, theirs = type_blobs(KINDS[name])[0], bytes.fromhex(GOLDEN["type_info_cpp"][name])
    identifiers = {theirs[i : i + 15] for i in range(len(theirs) - 14) if theirs[i - 4 : i] == b"\x14\0\0\0"}
    assert len(ours) == len(theirs) and len(identifiers) >= 8
    for identifier in identifiers:
        assert identifier in ours


def test_every_unsigned_byte_is_a_byte() -> None:
    _, mapping = type_blobs(idl.LowState_)
    name = b"level_flag\0"
    # A member's type kind stands 6 bytes before its name: TK_BYTE is 2, TK_UINT8 would be 13.
    assert mapping[mapping.index(name) - 6] == 2


def test_rpc_bytes_equal_the_vendor_serialiser() -> None:
    request = idl.make_request(123456789012, 1001, '{"name": "normal"}')
    request.header.lease.id = 7
    request.header.policy = idl.RequestPolicy_(-2, True)
    binary: Any = [1, 2, 255]
    request.binary = binary
    response = idl.make_response(123456789012, 1001, -3, '{"form":"0","name":""}')
    assert request.serialize().hex() == GOLDEN["request"]["cdr_hex"]
    assert response.serialize().hex() == GOLDEN["response"]["cdr_hex"]


def test_a_sample_without_data_is_tolerated() -> None:
    sample = LowState().encode()
    assert idl.LowState_.deserialize(sample).serialize() == sample
    idl.LowState_.deserialize_key(b"\x00\x01\x00\x00")  # what the library passes when a peer leaves
