-- spykee lesson 3: moving
-- There and back: forwards for two seconds, a second of rest, and back to where it began.

robot.move(40, 40, 2)
task.wait(1)
robot.move(-40, -40, 2)
