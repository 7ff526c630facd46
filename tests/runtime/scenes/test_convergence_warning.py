"""A motion of which no step has converged is a warning, which is said also where little is."""

from __future__ import annotations

import logging

from tests.toy_experiment import write_experiment


def test_a_motion_without_a_converged_step_is_a_warning(softprint_here, tmp_path, caplog):
    experiment = write_experiment(tmp_path, 2)
    here = ("simulate", experiment, "--quiet", "--model", "bare", "--scene", "held_out")

    def warnings() -> list[str]:
        return [record.getMessage() for record in caplog.records if record.levelno == logging.WARNING]

    assert softprint_here(*here).returncode == 0
    assert not warnings()
    # Less than round-off leaves of the forces.
    assert softprint_here(*here, "--set", "dynamics.tolerance=1e-30").returncode == 0
    (said,) = warnings()
    assert "15 of 15 steps did not converge" in said
