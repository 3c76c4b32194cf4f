-- The call happens at once, and its result is no function.
-- expect: check 3: task.spawn: the function must be a function, got the result of robot.move
task.spawn(robot.move(40, 40, 1))
