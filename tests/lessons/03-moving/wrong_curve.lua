-- wrong: on the way back both tracks need the same speed
robot.move(40, 40, 2)
task.wait(1)
robot.move(-25, -40, 2)
