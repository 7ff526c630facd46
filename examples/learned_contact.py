# %% [markdown]
# # Learned contact: the reduced model alone, and with a trained correction
#
# The same collider goes the same way into two bodies: the reduced model alone (`bare`) and the one with linear
# mechanics and a learned force correction (`ours`). Both forces are printed, and how far the surfaces differ.
#
#     make demo && python examples/learned_contact.py

# %%
from pathlib import Path

import numpy as np

import softprint

run = Path("runs/jelly3d_small")
experiment = softprint.load_experiment("examples/jelly3d_small.toml")
body = softprint.load_body(run / "body.h5")

# %% [markdown]
# The collider is the one that the experiment was trained with. It goes along the positions of a motion that training
# never saw.

# %%
scene = experiment.scenes_of_role("test")[0]
placed = scene.colliders[0]
shape = softprint.build_collider(experiment.collider(placed.name), experiment.base_dir)
keys = placed.keyframes
path = softprint.KeyframedPath([key.time for key in keys], [key.position for key in keys])

# %% [markdown]
# A correction belongs to the body with its mechanics, which are found beside it in the run directory. A file of another
# body is refused.

# %%
correction = softprint.load_correction(run / "corrections" / "ours.safetensors", body, shape)

# %% [markdown]
# Everything else is the same in both simulators. Contact has to be that of the training data.


# %%
def simulator(mechanics=None, correction=None):
    return softprint.Simulator(
        body,
        [softprint.PlacedCollider(placed.name, shape, path, correction)],
        contact=softprint.PenaltyContact.of(experiment.contact),
        mechanics=mechanics,
        gravity=experiment.dynamics.gravity,
        kinematic=[softprint.KinematicHandle("base")],
    )


bare, ours = simulator(), simulator(correction.mechanics, correction)

# %%
bare_state, our_state = bare.settle().state, ours.settle().state
differences = []
for step in range(75):
    bare_result, our_result = bare.step(bare_state), ours.step(our_state)
    bare_state, our_state = bare_result.state, our_result.state
    moved = ours.surface_positions(our_state) - bare.surface_positions(bare_state)
    differences.append(np.linalg.norm(moved, axis=1).max())
    if step % 5 == 4:
        force = np.linalg.norm(bare_result.contacts[placed.name].force)
        our_force = np.linalg.norm(our_result.contacts[placed.name].force)
        print(
            f"{our_state.time:5.2f} s  bare {force:6.3f} N  ours {our_force:6.3f} N  "
            f"surfaces differ by up to {1e3 * differences[-1]:5.2f} mm"
        )

# %% [markdown]
# The body under the reduced model alone is too stiff to form a dent, so it pushes back harder. Which of the two is
# right is what `softprint report` measures, against full space.
