-- wrong: It does not drive towards the ball
robot.turn(math.rad(10))
robot.forward(1.3)
