"""What is said of colliders that pierce the body in a motion, or never touch it."""

from __future__ import annotations

import logging

from softprint.runtime.scenes.simulate import warn_of_contact


def test_what_pierces_the_body_is_not_said_never_to_touch_it(caplog):
    """A needle between the contact points has none in contact, and still is inside."""
    caplog.set_level(logging.WARNING)
    warn_of_contact("press (bare)", 5, [(0.002, "needle", 3), (0.004, "needle", 4)], {"needle", "far"})
    assert caplog.messages == [
        "press (bare): the body is pierced in 2 of 5 frames, most in frame 4: collider 'needle' is 4.0 mm inside it",
        "press (bare): collider 'far' never touches the body",
    ]


def test_a_motion_in_which_all_touch_has_no_warning(caplog):
    caplog.set_level(logging.WARNING)
    warn_of_contact("press (bare)", 5, [], set())
    assert not caplog.messages
