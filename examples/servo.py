"""A servo between a source of twists and the driver of the joints, whatever the source sends."""

import json
import sys
import time

import numpy as np

import spacearm as sa

PERIOD = 0.01  # of the driver [s]
arm = sa.load("planar2")
servo = sa.Servo(arm, rates=0.5, accelerations=2.0)


def twists(count):
    """Yield what an operator's stick says [m/s]; here it pushes outward, then back, and breaks."""
    for i in range(count):
        t = i * PERIOD
        yield np.full(2, np.nan) if 9.0 < t < 9.2 else [0.2 * np.cos(0.4 * t), 0.03 * np.sin(t)]


class Driver:
    """Takes joint rates and says where the joints are; a real one talks to the arm."""

    def __init__(self, q):
        self.q, self.log = np.array(q), []

    def send(self, t, rates):
        """Move until the next tick."""
        self.q = self.q + PERIOD * rates
        self.log.append(json.dumps({"t": t, "q": self.q.tolist()}))


driver, said = Driver([0.3, 1.2]), ""
servo.start(arm.at(driver.q))
slowest = 0.0
for i, twist in enumerate(twists(1500)):
    begun = time.perf_counter()
    step = servo.step((driver.q, [0, 0, 0, 1]), twist, PERIOD)
    slowest = max(slowest, time.perf_counter() - begun)
    driver.send((i + 1) * PERIOD, step.rates)
    causes = step.halted or ", ".join(step.slowed)
    if causes != said:
        print(f"{i * PERIOD:6.2f} s  {np.degrees(step.distance):5.1f}°  {causes or 'free'}")
        said = causes
print(f"the slowest step took {1e3 * slowest:.1f} ms", file=sys.stderr)

# what a monitor beside it says of the joint states, knowing nothing of the servo
levels = [state.level for state in servo.watch(driver.log, ahead=1.0)]
print({level: levels.count(level) for level in dict.fromkeys(levels)})
