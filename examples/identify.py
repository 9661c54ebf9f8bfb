"""From a robot file and logs to a torque model, and the model in a control loop."""

from pathlib import Path

import numpy as np
import sgpr

data = Path(__file__).resolve().parents[1] / "data/demo"
robot = sgpr.Robot.from_urdf(data / "robot.urdf")
train = [sgpr.read(data / f"train_{k}.csv.gz") for k in (1, 2, 3)]
test = [sgpr.read(data / "test.csv.gz")]
for recording in train:
    for issue in recording.issues:
        print(f"{recording.source}: {issue.message}")

model = sgpr.identify(robot, train, effects=["viscous_friction", "coulomb_friction", "rotor_inertia"])
print(model.parameters)

# On a log that the fit has not seen: the robot file against the identified model.
before = sgpr.compare(robot, test, processing=model)
after = sgpr.compare(model, test)
for name, old, new in zip(robot.joint_names, before.rmse, after.rmse, strict=True):
    print(f"{name}: {old:7.3f} -> {new:.3f} N·m")

# In a control loop: one sample after the other, into the caller's array.
predictor = model.predictor()
tau = np.zeros(robot.dof)
predictor.torque(np.full(6, 0.1), np.full(6, 0.2), np.zeros(6), out=tau)
print("feed-forward torque:", tau.round(2))
