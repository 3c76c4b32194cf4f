-- Drives in circles, and asks for that once.
robot.move(40, 15)
robot.wait_for("battery_ok")
