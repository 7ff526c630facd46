"""What the tolerance of a step costs: distances and means over the frames in contact."""

import numpy as np

from benchmarks.step_tolerance import Played, line

STEPS, NODES = 4, 5
IN_CONTACT = np.array([False, True, True, False])


def motion(moved, force, milliseconds):
    """One whose nodes are all moved by so many mm along x in each step, with so many newtons along z."""
    position = np.zeros((STEPS, NODES, 3))
    position[..., 0] = 1e-3 * np.asarray(moved)[:, None]
    forces = np.zeros((STEPS, 1, 3))
    forces[:, 0, 2] = force
    seconds = 1e-3 * np.asarray(milliseconds, dtype=float)
    return Played(position, forces, seconds, np.full(STEPS, 2), np.full(STEPS, True), IN_CONTACT)


def cells(own, tight):
    return [cell.strip() for cell in line("1e-03", own, tight).strip("|").split("|")]


def test_only_frames_in_contact_count():
    """Steps 1 and 2; what is far off or slow in the others is left out."""
    tight = motion([0, 0, 0, 0], [0, 3, 4, 0], [9, 9, 9, 9])
    name, mean, slow, iterations, distance, force, converged = cells(
        motion([50, 3, 4, 50], [9, 3, 5, 9], [99, 1, 3, 99]), tight
    )
    assert (name, mean, slow, iterations, converged) == ("1e-03", "2.0", "2.9", "2.00", "100.0%")
    assert distance == f"{np.sqrt(12.5):.4f}, 4.0000"  # RMS of 3 and 4 mm, and the worst
    # RMS of 0 and 1 N, and the worst, of the RMS of 3 and 4 N.
    assert force == f"{np.sqrt(0.5):.4f}, 1.0000 of {np.sqrt(12.5):.2f}"


def test_a_motion_is_not_off_itself():
    tight = motion([0, 3, 4, 0], [0, 3, 4, 0], [1, 1, 1, 1])
    assert cells(tight, tight)[4] == "0.0000, 0.0000"
    assert cells(tight, tight)[5].startswith("0.0000, 0.0000 of")
