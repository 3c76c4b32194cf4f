-- right
robot.move(50, 50)
task.wait(2)
robot.stop()
task.wait(1)
robot.move(-50, -50)
task.wait(2)
robot.stop()
