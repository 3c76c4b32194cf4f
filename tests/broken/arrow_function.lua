-- A function of another language.
-- expect: check 3: a function is not written with =>
robot.on("noise", (n) => print(n))
