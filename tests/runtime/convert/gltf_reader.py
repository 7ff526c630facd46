"""A glTF 2.0 reader for tests, written from the specification: checks the rules that players rely on, and plays.

Section numbers are those of the specification (Khronos, 2021).
"""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

BYTES = {5121: "u1", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTH = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


class Gltf:
    """A file, checked as it is read."""

    def __init__(self, path: Path) -> None:
        if path.suffix == ".glb":
            self.json, self.binary = self._chunks(path.read_bytes())
            assert "uri" not in self.json["buffers"][0]
        else:
            self.json = json.loads(path.read_text())
            self.binary = (path.parent / unquote(self.json["buffers"][0]["uri"])).read_bytes()
        assert self.json["asset"]["version"] == "2.0"
        assert self.json["buffers"][0]["byteLength"] == len(self.binary)
        for number in range(len(self.json["accessors"])):
            self.accessor(number)
        self._check_meshes()

    @staticmethod
    def _chunks(data: bytes) -> tuple[dict[str, Any], bytes]:
        magic, version, length = struct.unpack_from("<4sII", data)  # 4.4.2
        assert (magic, version, length) == (b"glTF", 2, len(data))
        text_length, kind = struct.unpack_from("<I4s", data, 12)
        assert (kind, text_length % 4) == (b"JSON", 0)
        place = 20 + text_length
        binary_length, kind = struct.unpack_from("<I4s", data, place)
        assert (kind, binary_length % 4) == (b"BIN\0", 0)
        assert place + 8 + binary_length == len(data)
        return json.loads(data[20:place]), data[place + 8 :]

    def _view(self, number: int, component: int, count: int, width: int) -> np.ndarray:
        view = self.json["bufferViews"][number]
        kind = np.dtype(BYTES[component])
        assert view["byteOffset"] % kind.itemsize == 0  # 3.6.2.4
        assert view["byteLength"] >= count * width * kind.itemsize
        assert view["byteOffset"] + view["byteLength"] <= len(self.binary)
        return np.frombuffer(self.binary, kind, count * width, view["byteOffset"]).reshape(count, width)

    def accessor(self, number: int) -> np.ndarray:
        """(n,) or (n, 2 to 4) values; without a view they are zero, but for the sparse ones (3.6.2.3)."""
        told = self.json["accessors"][number]
        width, count = WIDTH[told["type"]], told["count"]
        assert count >= 1
        if "bufferView" in told:
            values = self._view(told["bufferView"], told["componentType"], count, width).copy()
        else:
            values = np.zeros((count, width), BYTES[told["componentType"]])
        if "sparse" in told:
            sparse = told["sparse"]
            n = sparse["count"]
            index = self._view(sparse["indices"]["bufferView"], sparse["indices"]["componentType"], n, 1)[
                :, 0
            ]
            assert (np.diff(index.astype(int)) > 0).all()
            assert index[-1] < count
            values[index] = self._view(sparse["values"]["bufferView"], told["componentType"], n, width)
        assert np.isfinite(values).all()
        for key, extreme in (("min", values.min(axis=0)), ("max", values.max(axis=0))):
            if key in told:
                np.testing.assert_array_equal(np.float32(told[key]), extreme)
        return values[:, 0] if width == 1 else values

    def _check_meshes(self) -> None:
        for mesh in self.json["meshes"]:
            for primitive in mesh["primitives"]:
                attributes = primitive["attributes"]
                count = self.json["accessors"][attributes["POSITION"]]["count"]
                index = self.accessor(primitive["indices"])
                assert index.max() < count
                assert len(index) % (2 if primitive.get("mode") == 1 else 3) == 0
                if "NORMAL" in attributes:
                    normals = self.accessor(attributes["NORMAL"])
                    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-5)
                assert len(mesh.get("weights", [])) == len(primitive.get("targets", []))  # 3.7.2.2
                for target in primitive.get("targets", []):
                    assert target.keys() <= attributes.keys()
                    for accessor in target.values():
                        assert self.json["accessors"][accessor]["count"] == count
                for part in (attributes, *primitive.get("targets", [])):
                    assert {"min", "max"} <= self.json["accessors"][part["POSITION"]].keys()

    def node(self, name: str) -> int:
        (number,) = [k for k, node in enumerate(self.json["nodes"]) if node["name"] == name]
        return number

    def primitive(self, name: str) -> dict[str, Any]:
        (primitive,) = self.json["meshes"][self.json["nodes"][self.node(name)]["mesh"]]["primitives"]
        return primitive

    def channel(self, name: str, path: str) -> tuple[np.ndarray, np.ndarray]:
        """Times (n,) and values (n, ...) that a node is animated with."""
        (animation,) = self.json["animations"]
        target = {"node": self.node(name), "path": path}
        (channel,) = [channel for channel in animation["channels"] if channel["target"] == target]
        sampler = animation["samplers"][channel["sampler"]]
        assert sampler["interpolation"] == "LINEAR"
        times, values = self.accessor(sampler["input"]), self.accessor(sampler["output"])
        assert (np.diff(times) > 0).all()
        assert times[0] == 0
        assert {"min", "max"} <= self.json["accessors"][sampler["input"]].keys()
        assert len(values) % len(times) == 0
        return times, values.reshape(len(times), -1)

    def played(self, name: str, time: float, attribute: str = "POSITION") -> np.ndarray:
        """An attribute of a morphed mesh at a time, in the coordinates of its node (3.7.2.2)."""
        primitive = self.primitive(name)
        values = self.accessor(primitive["attributes"][attribute]).astype(float)
        times, weights = self.channel(name, "weights")
        at = [np.interp(time, times, column) for column in weights.T]
        for weight, target in zip(at, primitive["targets"], strict=True):
            if weight and attribute in target:
                values += weight * self.accessor(target[attribute])
        return values

    def moved(self, name: str, time: float) -> np.ndarray:
        """The vertices of a rigid mesh at a time, in the coordinates of the root."""
        turns, places = self.channel(name, "rotation"), self.channel(name, "translation")
        rotation = Slerp(turns[0], Rotation.from_quat(turns[1]))(time)
        shift = [np.interp(time, places[0], column) for column in places[1].T]
        return rotation.apply(self.accessor(self.primitive(name)["attributes"]["POSITION"])) + shift

    def to_y_up(self, points: np.ndarray) -> np.ndarray:
        """Points of the root in the scene."""
        turn = self.json["nodes"][self.node("softprint")].get("rotation", [0, 0, 0, 1])
        return Rotation.from_quat(turn).apply(points)
