-- wrong: The left light was on for 0.
robot.blink("left", { on = 0.2, off = 0.2, count = 3 }):join()
robot.blink("right", { on = 0.2, off = 0.2, count = 3 }):join()
