"""Direct shear under four normal stresses: the line through shear strength over normal stress gives the friction angle, and a figure."""

import os

import numpy as np
from matplotlib import pyplot

import graintrain

SMALL = bool(os.environ.get("GRAINTRAIN_SMALL"))
n = 1 if SMALL else 3
loads = [5e3, 10e3, 20e3, 40e3]  # Pa, on the press
length, width = (3 * n + 1) * 0.23, (2 * n + 1) * 0.23
area = length * width
boxes = []
for stress in loads:
    box = graintrain.World.from_scene("direct-shear", set={"n": n, "friction": 0.5, "time.step": "5 ms", "press_density": "1000 kg/m^3"})
    box.add_force((0, 0, -stress * area), "press")
    boxes.append(box)
grains = boxes[0].masses[boxes[0].index("press") + 1 :].sum()
press = boxes[0].masses[boxes[0].index("press")]

batch = graintrain.Batch(boxes)
batch.run(1.0)
displacement, shear = [], []
for _ in range(20 if SMALL else 200):
    batch.run(steps=1)
    displacement.append(boxes[0].positions[boxes[0].index("lower"), 0] - 0.5 * length)
    shear.append([box.wrench("upper")[0][0] / area for box in boxes])
# At the height of the shear plane: the load, the press, and half of the grains.
normal = np.array(loads) + 9.81 * (press + 0.5 * grains) / area
shear = np.abs(np.array(shear))

strength = shear[len(shear) // 3 :].mean(axis=0)
slope, cohesion = np.polyfit(normal, strength, 1)
for line in zip(normal, strength, slope * normal + cohesion):
    print("normal stress {:7.0f} Pa: shear strength {:7.0f} Pa, the line {:7.0f} Pa".format(*line))
print(f"friction angle {np.degrees(np.arctan(slope)):.1f} degrees, intercept {cohesion:.0f} Pa")

figure, (left, right) = pyplot.subplots(1, 2, figsize=(9, 4), layout="constrained")
left.plot(displacement, shear, label=[f"{stress / 1e3:.1f} kPa" for stress in normal])
left.set(xlabel="displacement of the lower half, m", ylabel="shear stress, Pa")
left.legend()
right.plot(normal, strength, "o", normal, slope * normal + cohesion, "-")
right.set(xlabel="normal stress, Pa", ylabel="shear strength, Pa", xlim=(0, None), ylim=(0, None))
figure.savefig("direct_shear.png", dpi=120)
if not SMALL:
    assert 10 < np.degrees(np.arctan(slope)) < 45
