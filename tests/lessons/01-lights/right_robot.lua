-- right
robot.led("left", true)
task.wait(1)
robot.led("left", false)
robot.led("right", true)
task.wait(1)
robot.led("right", false)
