"""Side files are read by VTK's own XDMF reader, an independent check of what ParaView shows."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

from softprint.runtime.io.xdmf import Step, Values, write_xdmf

pv = pytest.importorskip("pyvista")


@pytest.mark.parametrize("dim", [2, 3])
def test_vtk_reads_points_vectors_and_tensors_of_each_step(tmp_path: Path, dim: int) -> None:
    rng = np.random.default_rng(0)
    points = np.vstack([np.zeros(dim), np.eye(dim)])
    vectors = rng.random((3, dim + 1, dim)).astype(np.float32)
    tensors = rng.random((3, 1, dim, dim))
    with h5py.File(tmp_path / "heavy.h5", "w") as file:
        file["points"], file["cells"] = points, np.arange(dim + 1)[None]
        file["u"], file["P"], file["s"] = vectors, tensors, np.arange(3.0 * (dim + 1)).reshape(3, -1)
        mesh = {"points": Values.of(file["points"]), "cells": Values.of(file["cells"])}
        write_xdmf(
            tmp_path / "light.xdmf",
            [
                Step(
                    time=0.5 * k,
                    **mesh,
                    node_fields={"u": Values.of(file["u"], k), "s": Values.of(file["s"], k)},
                    cell_fields={"P": Values.of(file["P"], k)},
                )
                for k in range(3)
            ],
        )
    reader = pv.get_reader(tmp_path / "light.xdmf")
    assert reader.time_values == [0.0, 0.5, 1.0]
    for k in range(3):
        reader.set_active_time_value(0.5 * k)
        grid = reader.read()
        np.testing.assert_array_equal(grid.points[:, :dim], points)
        np.testing.assert_array_equal(grid.point_data["u"][:, :dim], vectors[k])
        np.testing.assert_array_equal(grid.point_data["s"], np.arange(dim + 1.0) + k * (dim + 1))
        np.testing.assert_array_equal(np.ravel(grid.cell_data["P"]), tensors[k].ravel())


def test_a_failure_leaves_no_side_file(tmp_path: Path) -> None:
    values = Values("x.h5", "/x", (4, 7), np.dtype(float))  # no cell has seven nodes
    with pytest.raises(KeyError):
        write_xdmf(tmp_path / "bad.xdmf", [Step(0.0, values, values)])
    assert not list(tmp_path.iterdir())
