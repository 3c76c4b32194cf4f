-- A stream that does not exist.
-- expect: check 3: robot.stream: unknown stream 'vido'; did you mean 'video'?
robot.stream("vido", true)
