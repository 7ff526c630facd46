# %% [markdown]
# # A tactile pad as a Gymnasium environment
#
# A ball is pressed onto a pad of soft silicone until the wanted force is reached, by a policy that is told nothing but
# what it feels. Any library of reinforcement learning can take its place: the environment is one of Gymnasium's.
#
#     python examples/tactile_environment.py

# %%
import gymnasium
import numpy as np

import softprint

softprint.register_environments()
# Linear mechanics of the pad, computed now: nothing has been trained. With a trained pad: experiment=..., model="ours".
env = gymnasium.make("softprint/PressToForce-v0", model="mechanics", observe=("markers", "force"))
seen, info = env.reset(seed=0)
wanted = seen["target"][0]

# %% [markdown]
# The force of a round contact grows as depth^1.5. So this is a step of Newton's method for the depth that is missing.

# %%
over, moved = False, 0.0
while not over:
    force, depth = np.linalg.norm(seen["force"]), 4.0 - seen["indenter"][2]  # N, mm: the ball has 4 mm
    down = (wanted - force) / (1.5 * force / depth) if force > 1e-3 else 0.1  # mm
    action = np.array(
        [0.0, 0.0, -np.clip(3.0 * down, -1.0, 1.0)], np.float32
    )  # one action moves by up to 1/3 mm
    seen, reward, success, stopped, info = env.step(action)
    moved = max(moved, np.abs(seen["markers"][:, :2]).max())
    over = success or stopped
    print(
        f"force {info['force']:.3f} N of {wanted:.3f} N  reward {reward:6.2f}  markers up to {moved:.3f} mm"
    )
