-- wrong: The robot does not drive away
robot.move(40, -40, 2)
task.wait(1)
robot.move(-40, 40, 2)
