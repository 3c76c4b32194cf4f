-- wrong: It has pushed the ball away|It does not drive towards the ball
robot.drive(0.2, 0)
task.wait(60)
