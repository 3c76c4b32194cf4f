-- right
local speed = 0.2
robot.drive(speed, 0, 2)
task.wait(1)
robot.drive(-speed, 0, 2)
