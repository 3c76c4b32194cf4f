-- spykee lesson 9: going home
-- Leaves the station, drives half a metre, goes home, and says how it went.
-- Here it beeps whatever happened. The alarm is wanted when it could not get home.

robot.undock()
robot.turn(math.rad(180))
robot.forward(0.5)
robot.dock()
robot.play("bip_2")
