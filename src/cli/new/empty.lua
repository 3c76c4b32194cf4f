-- {{NAME}}
--
-- Try it:  spykee run {{NAME}}.lua --sim

print("hello, I am", robot.info().name)
